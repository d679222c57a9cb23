import json
from dataclasses import replace

import numpy as np
import pytest

from navcore.errors import ConfigError, DataError
from navcore.prior import BiasPrior, load_prior, split_prior
from navcore.trajectory import Trajectory
from tests.navcore.recordings import sequence

S = 1_000_000_000
DEVICE = {
    "b_g": [1e-3, 2e-3, 3e-3],
    "b_a": [0.1, 0.2, 0.3],
    "covariance": [1e-6, 1e-6, 1e-6, 1e-2, 1e-2, 1e-2],
}


def device_file(folder, **change):
    path = folder / "device.json"
    path.write_text(json.dumps({**DEVICE, **change}))
    return path


def rows_file(folder, stamps=(10 * S, 20 * S, 30 * S), sigma=0.1):
    path = folder / "priors.csv"
    lines = ["t_ns,b_g_x,b_g_y,b_g_z,b_a_x,b_a_y,b_a_z,s1,s2,s3,s4,s5,s6"]
    lines += [f"{t},0.1,0.2,0.3,1,2,3," + ",".join([str(sigma * (k + 1) ** 2)] * 6) for k, t in enumerate(stamps)]
    path.write_text("\n".join(lines))
    return path


def recording(t_s, b_g, b_a):
    n = len(t_s)
    t_ns = np.round(np.array(t_s) * S).astype(np.int64)
    truth = Trajectory(t_ns, np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)), np.zeros((n, 3)), None, b_g, b_a)
    return replace(sequence(), truth=truth)


def test_none_knows_nothing():
    source = load_prior("none")
    assert source.device() is None
    assert source.poll(2**62) == []
    assert not source.constant_covariance.any()


@pytest.mark.parametrize("as_matrix", [False, True])
def test_constant_is_memory_of_the_device_and_no_measurement(tmp_path, as_matrix):
    covariance = np.diag(DEVICE["covariance"]).tolist() if as_matrix else DEVICE["covariance"]
    source = load_prior(f"constant:{device_file(tmp_path, covariance=covariance)}", sequence())
    device = source.device()
    np.testing.assert_array_equal(device.b_g, DEVICE["b_g"])
    np.testing.assert_array_equal(device.b_a, DEVICE["b_a"])
    np.testing.assert_array_equal(device.covariance, np.diag(DEVICE["covariance"]))
    assert device.t_ns == sequence().imu.t_ns[0]
    assert source.poll(2**62) == []


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"b_q": [1, 2, 3]}, r"keys are \['b_a', 'b_g', 'b_q', 'covariance'\], expected exactly"),
        ({"recordings": "all"}, r"recordings is 'all', expected a list of names"),
        ({"b_g": [1, 2]}, r"b_g has shape \(2,\), expected \(3,\)"),
        ({"b_g": "small"}, "b_g does not hold numbers"),
        ({"covariance": [1.0] * 5}, r"covariance has shape \(5,\), expected \(6, 6\)"),
        ({"covariance": [1.0] * 5 + [-1.0]}, "not positive definite"),
        ({"b_a": [1, float("nan"), 3]}, "not finite"),
    ],
)
def test_a_wrong_device_file_is_named(tmp_path, change, says):
    path = device_file(tmp_path, **change)
    with pytest.raises(DataError, match=says) as error:
        load_prior(f"constant:{path}")
    assert str(path) in str(error.value)


@pytest.mark.parametrize(("content", "says"), [("{", "not JSON"), ("[1]", "keys are list")])
def test_a_device_file_that_is_no_mapping(tmp_path, content, says):
    path = tmp_path / "device.json"
    path.write_text(content)
    with pytest.raises(DataError, match=says):
        load_prior(f"constant:{path}")


def test_a_missing_device_file_and_a_missing_key(tmp_path):
    with pytest.raises(DataError, match=r"gone\.json: no such file; expected JSON with b_g"):
        load_prior(f"constant:{tmp_path / 'gone.json'}")
    path = tmp_path / "device.json"
    path.write_text(json.dumps({"b_g": [0, 0, 0]}))
    with pytest.raises(DataError, match=r"keys are \['b_g'\]"):
        load_prior(f"constant:{path}")


def test_a_row_of_a_file_comes_when_its_window_is_over_and_only_once(tmp_path):
    source = load_prior(f"file:{rows_file(tmp_path)}?window=8")
    assert source.window_s == 8.0
    assert source.device() is None
    assert source.poll(14 * S - 1) == []
    assert [m.t_ns for m in source.poll(14 * S)] == [10 * S]
    assert source.poll(14 * S) == []
    assert source.poll(5 * S) == []
    assert [m.t_ns for m in source.poll(100 * S)] == [20 * S, 30 * S]


def test_a_rows_variance_is_split(tmp_path):
    source = load_prior(f"file:{rows_file(tmp_path, sigma=0.1)}?constant_share=0.25")
    assert source.window_s == 5.0
    np.testing.assert_allclose(source.constant_covariance, 0.25 * 0.4**2 * np.eye(6))  # the median row's
    for k, row in enumerate(source.poll(2**62)):
        np.testing.assert_allclose(row.covariance, 0.75 * (0.1 * (k + 1) ** 2) ** 2 * np.eye(6))
        np.testing.assert_array_equal(row.vector, [0.1, 0.2, 0.3, 1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("?windw=5", "option 'windw' of bias prior 'file' is unknown; known are window, constant_share"),
        ("?window=long", "option window of bias prior 'file' is 'long', expected a number"),
        ("?window=-1", "window is -1.0"),
        ("?window=nan", "window is nan"),
        ("?constant_share=1", "constant_share is 1.0, expected 0 <= share < 1"),
    ],
)
def test_wrong_options_of_a_file(tmp_path, options, says):
    with pytest.raises(ConfigError, match=says):
        load_prior(f"file:{rows_file(tmp_path)}{options}")


def test_a_sigma_that_is_none(tmp_path):
    with pytest.raises(DataError, match=r"sigma at 10000000000 ns is .*, expected six positive numbers"):
        load_prior(f"file:{rows_file(tmp_path, sigma=0.0)}")
    with pytest.raises(DataError, match=r"gone\.csv: no such file"):
        load_prior(f"file:{tmp_path / 'gone.csv'}")


def test_truth_comes_once_a_second_at_its_own_time():
    t_s = np.arange(0.0, 3.3, 0.1)
    b_g = np.outer(t_s, [1.0, 2.0, 3.0])
    source = load_prior("truth", recording(t_s, b_g, -b_g))
    assert not source.constant_covariance.any()
    assert source.poll(S - 1)[0].t_ns == 0
    rows = source.poll(2**62)
    assert [m.t_ns for m in rows] == [S, 2 * S, 3 * S]
    np.testing.assert_allclose(rows[1].vector, [2.0, 4.0, 6.0, -2.0, -4.0, -6.0], atol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diag(rows[0].covariance)), [2e-4] * 3 + [0.02] * 3)


def test_truth_with_stated_sigmas():
    (row,) = load_prior("truth:1e-3,0.5", recording([0.0, 0.5], np.zeros((2, 3)), np.ones((2, 3)))).poll(2**62)
    np.testing.assert_allclose(np.sqrt(np.diag(row.covariance)), [1e-3] * 3 + [0.5] * 3)


def test_truth_says_nothing_where_its_biases_are_unknown():
    t_s = np.arange(0.0, 10.0, 0.5)
    b = np.ones((20, 3))
    b[6:14] = np.nan  # 3.0 s to 6.5 s
    rows = load_prior("truth", recording(t_s, b, b)).poll(2**62)
    assert [m.t_ns // S for m in rows] == [0, 1, 2, 7, 8, 9]


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (None, "needs a recording"),
        (replace(sequence(), truth=None), "recording still has no truth"),
        (sequence(biases=False), "the truth of recording still has no biases"),
        (recording([0.0], np.full((1, 3), np.nan), np.zeros((1, 3))), "no finite biases"),
    ],
)
def test_truth_needs_a_recording_with_true_biases(given, says):
    with pytest.raises(ConfigError, match=says):
        load_prior("truth", given)


@pytest.mark.parametrize("argument", ["1", "1,2,3", "a,b", "0,1", "1,-1", "nan,1", "inf,1"])
def test_wrong_sigmas_of_truth(argument):
    with pytest.raises(ConfigError, match="expected truth or truth:SIGMA_G,SIGMA_A"):
        load_prior(f"truth:{argument}", sequence())


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_device_and_a_source_of_measurements_are_joined(tmp_path, order):
    specs = f"constant:{device_file(tmp_path)}", f"file:{rows_file(tmp_path)}?window=8&constant_share=0.25"
    known, says = (load_prior(spec) for spec in specs)
    both = load_prior(",".join(specs[k] for k in order))
    np.testing.assert_array_equal(both.device().vector, known.device().vector)
    np.testing.assert_array_equal(both.device().covariance, known.device().covariance)
    np.testing.assert_array_equal(both.constant_covariance, says.constant_covariance)
    assert both.window_s == says.window_s == 8.0
    both.add_imu(sequence().imu)
    for t_ns in (14 * S - 1, 14 * S, 100 * S):
        np.testing.assert_array_equal([m.vector for m in both.poll(t_ns)], [m.vector for m in says.poll(t_ns)])
    assert both.poll(2**62) == []


@pytest.mark.parametrize(
    ("spec", "parts"),
    [
        ("none", ("none",)),
        ("truth:1e-3,0.5", ("truth:1e-3,0.5",)),
        ("truth:1e-3,0.5,constant:a.json", ("truth:1e-3,0.5", "constant:a.json")),
        ("constant:a,b.json,truth", ("constant:a,b.json", "truth")),
        ("file:a.csv?window=5&constant_share=0,none", ("file:a.csv?window=5&constant_share=0", "none")),
        ("constant:truth,nonesuch.json", ("constant:truth,nonesuch.json",)),
        ("nine,none", ("nine", "none")),
    ],
)
def test_a_comma_separates_sources_only_before_the_name_of_one(spec, parts):
    assert split_prior(spec) == parts


def test_what_cannot_be_joined_is_named(tmp_path):
    device, rows = f"constant:{device_file(tmp_path)}", f"file:{rows_file(tmp_path)}"
    for spec, says in (
        (f"{device},{device}", "joins 2 sources that know the device and 0 that do not"),
        (f"{rows},none", "joins 0 sources that know the device and 2 that do not"),
        (f"{device},{rows},none", "joins 1 sources that know the device and 2 that do not"),
    ):
        with pytest.raises(ConfigError, match=says):
            load_prior(spec, sequence())
    with pytest.raises(ConfigError, match="bias prior 'nine' is unknown"):
        load_prior(f"nine:x,{device}", sequence())


@pytest.mark.parametrize(
    ("spec", "says"),
    [
        ("nine", "bias prior 'nine' is unknown; known are .*constant, .*file, .*none, .*truth"),
        ("none:x", "takes no argument, got 'x'"),
        ("constant", "needs a file: constant:FILE.json"),
        ("file", "needs a file: file:FILE.csv"),
    ],
)
def test_wrong_specifications(spec, says):
    with pytest.raises(ConfigError, match=says):
        load_prior(spec, sequence())


@pytest.mark.parametrize(
    ("covariance", "says"),
    [
        (np.eye(5), r"covariance has shape \(5, 5\)"),
        (np.diag([1.0] * 5 + [0.0]), "not positive definite"),
        (np.eye(6) + np.eye(6, k=1), "not positive definite"),
        (np.full((6, 6), np.nan), "not finite"),
    ],
)
def test_a_prior_with_an_impossible_covariance(covariance, says):
    with pytest.raises(DataError, match=says):
        BiasPrior(1, np.zeros(3), np.zeros(3), covariance)

"""Every example runs as it stands, and does what it says."""

import runpy
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from eval import records
from eval.outcome import Index
from msckf import Filter
from navcore.odometry import Run, RunRecorder, run
from sim.points import simulate_points

FOLDER = Path(__file__).parents[2] / "examples"


@pytest.fixture
def execute(monkeypatch, capsys):
    """Runs an example; returns its names and what it printed."""

    def execute(name, *arguments):
        monkeypatch.setattr("sys.argv", [name, *map(str, arguments)])
        names = runpy.run_path(str(FOLDER / name), run_name="__main__")
        return names, capsys.readouterr().out

    return execute


@pytest.fixture(scope="module")
def flight():
    """What the examples fly without a recording."""
    return simulate_points("quadrotor", seconds=6.0)


@pytest.fixture(scope="module")
def expected(flight):
    return run(Filter(flight.calibration), flight)


def collected(estimates) -> Run:
    recorder = RunRecorder()
    recorder.add(list(estimates))
    return recorder.result()


def assert_same(a: Run, b: Run):
    """To the last bit."""
    assert [e.t_ns for e in a.estimates] == [e.t_ns for e in b.estimates]
    assert [(e.health, e.reasons, e.tracked) for e in a.estimates] == [
        (e.health, e.reasons, e.tracked) for e in b.estimates
    ]
    for name in ("p_WB", "q_WB", "v_WB", "b_g", "b_a"):
        np.testing.assert_array_equal(getattr(a.trajectory, name), getattr(b.trajectory, name))
    np.testing.assert_array_equal(a.covariances, b.covariances)


def test_each_is_tested_and_fits_on_a_page():
    scripts = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.py")}
    tested = Path(__file__).read_text(encoding="utf-8")
    assert scripts and all(len(text.splitlines()) < 100 for text in scripts.values())
    assert all(f'execute("{name}"' in tested for name in scripts)


def test_fed_sample_by_sample(execute, expected):
    _, said = execute("feed.py")
    lines = said.splitlines()
    assert len(lines) == len(expected.estimates) and "not enough" not in lines[-1]
    x, y, z = (float(word) for word in lines[-1].split(" at ")[1].split(" m,")[0].split())
    np.testing.assert_allclose([x, y, z], expected.trajectory.p_WB[-1], atol=6e-4)


def test_callbacks_in_any_order_give_the_same_estimates(execute, expected):
    names, said = execute("callbacks.py")
    assert_same(collected(names["estimates"]), expected)
    assert "TRACKING" in said


def test_what_is_known_of_the_prior(execute):
    names, said = execute("prior.py")
    known, prior = names["vio"].prior, names["prior"]
    assert known.applied == said.count("NIS") >= 2 and 0.0 < known.nis < 25.0
    assert known.c.shape == (6,)
    sigma, before = np.sqrt(np.diagonal(known.covariance)), np.sqrt(np.diagonal(prior.constant_covariance))
    assert np.all(sigma <= before * (1.0 + 1e-9)) and sigma[4] < before[4]


def test_drawn_is_the_same_run(execute, expected, tmp_path):
    file = tmp_path / "run.rrd"
    names, said = execute("draw.py", file)
    assert_same(names["result"], expected)
    assert file.stat().st_size > 100_000 and str(file) in said


def test_the_bound_is_of_the_truth(execute):
    names, text = execute("bound.py", 1, 1, 5)
    assert np.shape(names["ratios"]) == (1, 2) and np.isfinite(names["ratios"]).all()
    times = np.array([prior.t_ns for prior in names["told"]])
    before = len(names["measurements"])
    assert times[before - 1] < names["dark_ns"] <= times[before]
    assert text.startswith("seed 1: ATE ") and "median change: told throughout " in text


def test_biases_in_the_dark_are_of_the_runs_of_a_study(execute, tmp_path):
    t_s = np.arange(0.0, 20.0, 0.5)
    keys, configs = ["a", "b", "c"], []
    for key, off in zip(keys, (1.0, 2.0, 6.0), strict=True):
        error = np.where(t_s <= 5.0, off, np.where(t_s <= 10.0, 50.0, np.where(t_s <= 15.0, 10.0 * off, 70.0)))
        zero = np.zeros_like(t_s)
        series = {"t_s": t_s} | {f"{to}b_{n}_{axis}": zero for to in ("", "true_") for n in "ga" for axis in "xyz"}
        source = {"kind": "PointsFlight", "degrade": "blackout@5-15"}
        config = {"source": source, "platform": "rover", "regime": "r", "condition": "dark"}
        configs.append(config | {"estimator": "msckf", "arm": "motion"})
        said = pd.DataFrame({"t_s": [4.0, 14.0, 16.0]})
        series = pd.DataFrame(series | {"b_a_y": error})
        records.write(records.Record(key, key, configs[-1], {}, series=series, statements=said), tmp_path)
    Index("study", "none", {}, 1.0, keys, keys, configs).write(tmp_path)

    _, text = execute("dark.py", tmp_path)

    told = "b_g 0.00000, then 0.00000; b_a 2.00000, then 20.00000; spoken 2 times"
    assert text == f"rover, r, dark, msckf, motion (3 runs): {told}\n"

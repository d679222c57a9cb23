"""Two sources as one."""

import json

import numpy as np
import pytest

from ipnet import joined
from ipnet.errors import ConfigError
from ipnet.joined import Join, JoinedPrior, find_join, write
from ipnet.recordings import Label, Recording
from ipnet.runs import cut, listen
from navcore.imu import ImuNoise, ImuSamples
from navcore.prior import BiasPrior, load_prior
from navcore.priors.listed import ListedPrior

SIGMA = {"a": np.array([0.02, 0.005, 0.005, 0.1, 0.5, 0.5]), "b": np.array([0.01, 0.01, 0.01, 0.3, 0.1, 0.1])}
"""Along and across the force, which is along x."""
JOIN = Join(("a", "b"), (1.0, 0.0, 0.0), (1, 0, 0, 1), ("r0",))


def spans(n):
    t_ns = np.arange(300) * 200_000_000
    imu = ImuSamples(t_ns, np.zeros((300, 3)), np.tile([9.81, 0.0, 0.0], (300, 1)))
    noise = ImuNoise(1e-4, 0.0, 1e-3, 0.0)
    return cut([Recording(f"r{k}", imu, noise, None, Label(f"r{k}", np.zeros(6), 1e-12 * np.eye(6))) for k in range(n)])


def source(name, sequence):
    """Statements every 5 s, of windows of 5 s; the two sources' errors are the same but for their size."""
    rng = np.random.default_rng(int(sequence.name[1:]))
    errors = SIGMA[name] * rng.normal(size=(11, 6))
    rows = [
        BiasPrior(round((2.5 + 5 * k) * 1e9), e[:3], e[3:], np.diag(SIGMA[name] ** 2)) for k, e in enumerate(errors)
    ]
    return ListedPrior(rows, window_s=5.0, constant_covariance=1e-4 * np.diag(SIGMA[name] ** 2))


def spread(rng):
    A = rng.standard_normal((6, 6))
    return 1e-4 * (A @ A.T + 0.1 * np.eye(6))


def test_each_axis_is_the_one_source_s_and_nothing_of_the_other_s():
    """In axes along and across a force that is along none of the IMU's."""
    rng = np.random.default_rng(1)
    join = Join(("a", "b"), (0.6, 0.0, 0.8), (0, 1, 1, 0), ())
    cover = spread(rng)
    z = BiasPrior(0, *rng.normal(size=(2, 3)), cover)
    along = np.array([0.6, 0.0, 0.8])
    first, second = join.told(z, 0), join.told(z, 1)
    np.testing.assert_array_equal(first.vector, z.vector)
    np.testing.assert_allclose(along @ first.covariance[:3, :3] @ along, along @ cover[:3, :3] @ along, rtol=1e-6)
    np.testing.assert_allclose(along @ second.covariance[:3, :3] @ along, 25.0)
    side = np.array([0.8, 0.0, -0.6])
    np.testing.assert_allclose(side @ second.covariance[:3, :3] @ side, side @ cover[:3, :3] @ side, rtol=1e-6)
    np.testing.assert_allclose(side @ first.covariance[3:, 3:] @ side, side @ cover[3:, 3:] @ side, rtol=1e-6)
    np.testing.assert_allclose(side @ first.covariance[:3, :3] @ side, 25.0)


def test_the_constant_error_of_an_axis_is_that_of_the_source_that_speaks():
    rng = np.random.default_rng(2)
    A, B = spread(rng), spread(rng)
    constant = JOIN.constant([A, B])
    np.testing.assert_allclose(constant[np.ix_([1, 2, 3], [1, 2, 3])], A[np.ix_([1, 2, 3], [1, 2, 3])], atol=1e-12)
    np.testing.assert_allclose(constant[np.ix_([0, 4, 5], [0, 4, 5])], B[np.ix_([0, 4, 5], [0, 4, 5])], atol=1e-12)
    np.testing.assert_allclose(constant[np.ix_([1, 2, 3], [0, 4, 5])], 0.0, atol=1e-12)


def test_all_that_both_say_is_told_in_order_of_stamps():
    cover = np.eye(6)
    late = ListedPrior([BiasPrior(9_500_000_000, np.ones(3), np.ones(3), cover)], window_s=19.0)
    early = [BiasPrior(round(t * 1e9), np.zeros(3), np.zeros(3), cover) for t in (2.5, 7.5, 12.5)]
    both = JoinedPrior(ListedPrior(early, window_s=5.0), late, JOIN)
    said = [z for t in range(30) for z in both.poll(t * 1_000_000_000)]
    assert [z.t_ns for z in said] == [2_500_000_000, 7_500_000_000, 12_500_000_000, 12_500_000_001]
    np.testing.assert_array_equal(said[-1].vector, 1.0)
    assert both.window_s == 0.0 and both.poll(40_000_000_000) == []


def test_a_source_without_an_axis_says_nothing():
    z = [BiasPrior(1_000_000_000, np.zeros(3), np.zeros(3), np.eye(6))]
    one = JoinedPrior(ListedPrior(z, 5.0), ListedPrior(z, 5.0), Join(("a", "b"), (1.0, 0.0, 0.0), (0, 0, 0, 0), ()))
    assert len(one.poll(2_000_000_000)) == 1


def test_the_better_source_of_each_axis_is_found(monkeypatch):
    monkeypatch.setattr(joined, "load_prior", source)
    found = find_join(("a", "b"), spans(12))
    assert found.sources == (1, 0, 0, 1)
    np.testing.assert_allclose(found.force, [1.0, 0.0, 0.0], atol=1e-12)
    assert found.recordings == tuple(f"r{k}" for k in range(12))
    runs = [listen(joined.joined(found, s.sequence), s) for s in spans(42)[12:]]
    ends = [r.fused(joined.nothing_known(r.span.begin_ns)) for r in runs]
    nees = np.mean([e.vector @ np.linalg.solve(e.covariance, e.vector) for e in ends]) / 6.0
    assert 0.5 < nees < 1.6


def test_a_join_comes_back_from_its_file():
    assert Join.from_dict(json.loads(write(JOIN))) == JOIN


def test_what_cannot_be_is_said(tmp_path):
    with pytest.raises(ConfigError, match="'balloon' is unknown; known are"):
        load_prior("ipnet+motion:balloon")
    with pytest.raises(ConfigError, match="expected four times 0 or 1"):
        Join(("a", "b"), (1.0, 0.0, 0.0), (0, 1, 2, 0), ())
    with pytest.raises(ConfigError, match="not joined ones"):
        Join(("a", "ipnet+motion:b"), (1.0, 0.0, 0.0), (0, 1, 1, 0), ())
    with pytest.raises(ConfigError, match="expected \\['force', 'recordings', 'sources', 'specs'\\]"):
        Join.from_dict({"specs": ["a", "b"]})
    (tmp_path / "j.json").write_text("# not JSON")
    with pytest.raises(ConfigError, match="not a join"):
        load_prior(f"ipnet+motion:{tmp_path / 'j.json'}")
    with pytest.raises(ConfigError, match="1 runs to choose by"):
        find_join(("none", "none"), spans(1))

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

SIGMA = {"a": np.repeat([0.02, 0.1], 3), "b": np.repeat([0.01, 0.3], 3)}


def spans(n):
    t_ns = np.arange(300) * 200_000_000
    imu = ImuSamples(t_ns, np.zeros((300, 3)), np.zeros((300, 3)))
    noise = ImuNoise(1e-4, 0.0, 1e-3, 0.0)
    return cut([Recording(f"r{k}", imu, noise, None, Label(f"r{k}", np.zeros(6), 1e-12 * np.eye(6))) for k in range(n)])


def source(rho):
    """Statements every 5 s whose errors have that correlation with the other source's."""

    def make(name, sequence):
        rng = np.random.default_rng(int(sequence.name[1:]))
        shared, own = rng.normal(size=(11, 6)), rng.normal(size=(2, 11, 6))["ab".index(name)]
        e = SIGMA[name] * (np.sqrt(rho) * shared + np.sqrt(1.0 - rho) * own)
        rows = [BiasPrior(round((2.5 + 5 * k) * 1e9), x[:3], x[3:], np.diag(SIGMA[name] ** 2)) for k, x in enumerate(e)]
        return ListedPrior(rows, window_s=5.0, constant_covariance=1e-4 * np.diag(SIGMA[name] ** 2))

    return make


def spread(rng, size=6):
    A = rng.standard_normal((size, size))
    return A @ A.T + 0.1 * np.eye(size)


def test_one_statement_of_each_fuses_to_covariance_intersection():
    rng = np.random.default_rng(1)
    A, B, C_a, C_b = spread(rng), spread(rng), 0.1 * spread(rng), 0.1 * spread(rng)
    z = [BiasPrior(k, *rng.normal(size=(2, 3)), cover) for k, cover in enumerate((A, B))]
    join = Join(("a", "b"), 0.3, 2.0, ())
    constant = join.constant(C_a, C_b)
    told = [join.told(z[0], 0, C_a, constant), join.told(z[1], 1, C_b, constant)]
    total = [t.covariance + constant for t in told]
    np.testing.assert_allclose(total[0], 2.0 / 0.3 * (A + C_a), rtol=1e-6)
    expected = 2.0 * np.linalg.inv(0.3 * np.linalg.inv(A + C_a) + 0.7 * np.linalg.inv(B + C_b))
    np.testing.assert_allclose(np.linalg.inv(sum(np.linalg.inv(t) for t in total)), expected, rtol=1e-6)
    assert np.linalg.eigvalsh(2.0 * A / 0.3 + 2.0 * C_a / 0.3 - constant).min() > 0.0  # inversion turns order around


def test_all_that_both_say_is_told_in_order_of_stamps():
    cover = np.eye(6)
    late = ListedPrior([BiasPrior(9_500_000_000, np.ones(3), np.ones(3), cover)], window_s=19.0)
    early = [BiasPrior(round(t * 1e9), np.zeros(3), np.zeros(3), cover) for t in (2.5, 7.5, 12.5)]
    both = JoinedPrior(ListedPrior(early, window_s=5.0), late, Join(("a", "b"), 0.5, 1.0, ()))
    said = [z for t in range(30) for z in both.poll(t * 1_000_000_000)]
    assert [z.t_ns for z in said] == [2_500_000_000, 7_500_000_000, 12_500_000_000, 12_500_000_001]
    np.testing.assert_array_equal(said[-1].vector, 1.0)
    np.testing.assert_allclose(said[0].covariance, 2.0 * cover, rtol=1e-6)
    assert both.window_s == 0.0 and both.poll(40_000_000_000) == []


@pytest.mark.parametrize(("rho", "least", "most"), [(0.0, 0.25, 0.75), (0.9, 0.5, 2.0)])
def test_the_factor_knows_how_related_errors_are(monkeypatch, rho, least, most):
    monkeypatch.setattr(joined, "load_prior", source(rho))
    found = find_join(("a", "b"), spans(12))
    assert least <= found.factor <= most
    assert found.recordings == tuple(f"r{k}" for k in range(12))
    runs = [listen(joined.joined(found, s.sequence), s) for s in spans(42)[12:]]
    ends = [r.fused(joined.nothing_known(r.span.begin_ns)) for r in runs]
    nees = np.mean([e.vector @ np.linalg.solve(e.covariance, e.vector) for e in ends]) / 6.0
    assert 0.5 < nees < 1.6


def test_a_join_comes_back_from_its_file():
    join = Join(("ipnet:x", "motion:x"), 0.35, 1.5, ("r1", "r2"))
    assert Join.from_dict(json.loads(write(join))) == join


def test_what_cannot_be_is_said():
    with pytest.raises(ConfigError, match="'balloon' is unknown; known are"):
        load_prior("ipnet+motion:balloon")
    with pytest.raises(ConfigError, match="expected 0 < share"):
        Join(("a", "b"), 1.0, 1.0, ())
    with pytest.raises(ConfigError, match="expected"):
        Join.from_dict({"specs": ["a", "b"]})
    silent = spans(3)
    with pytest.raises(ConfigError, match="speak together in 0 of 3"):
        find_join(("none", "none"), silent)

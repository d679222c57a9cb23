"""Two sources as one."""

import json

import numpy as np
import pytest

from ipnet import joined
from ipnet.calibration import ErrorModel
from ipnet.errors import ConfigError
from ipnet.joined import Join, JoinedPrior, find_join, least_variance
from ipnet.recordings import Label, Recording
from ipnet.runs import cut, listen
from navcore.imu import ImuNoise, ImuSamples
from navcore.prior import BiasPrior, load_prior
from navcore.priors.listed import ListedPrior

SIGMA = {"a": np.repeat([0.02, 0.1], 3), "b": np.repeat([0.01, 0.3], 3)}
RHO = 0.6


def spans(n):
    t_ns = np.arange(600) * 100_000_000
    imu = ImuSamples(t_ns, np.zeros((600, 3)), np.zeros((600, 3)))
    noise = ImuNoise(1e-4, 0.0, 1e-3, 0.0)
    return cut([Recording(f"r{k}", imu, noise, None, Label(f"r{k}", np.zeros(6), 1e-12 * np.eye(6))) for k in range(n)])


def source(name, sequence):
    """Statements every 5 s whose errors have the correlation RHO with the other's."""
    rng = np.random.default_rng(int(sequence.name[1:]))
    shared, own = rng.normal(size=(11, 6)), rng.normal(size=(2, 11, 6))["ab".index(name)]
    e = SIGMA[name] * (np.sqrt(RHO) * shared + np.sqrt(1.0 - RHO) * own)
    cover = np.diag(SIGMA[name] ** 2)
    rows = [BiasPrior(round((2.5 + 5 * k) * 1e9), x[:3], x[3:], 0.9 * cover) for k, x in enumerate(e)]
    return ListedPrior(rows, window_s=5.0, constant_covariance=0.1 * cover)


@pytest.fixture
def two(monkeypatch):
    monkeypatch.setattr(joined, "load_prior", source)


def test_weights_give_the_least_variance():
    rng = np.random.default_rng(1)
    a, b = (BiasPrior(0, *rng.normal(size=(2, 3)), np.diag(rng.uniform(0.5, 2.0, 6))) for _ in range(2))
    correlation = rng.uniform(-0.5, 0.5, 6)
    mean, variance = least_variance(a, b, correlation)
    for k in range(6):
        pair = np.array([a.vector[k], b.vector[k]])
        cross = correlation[k] * np.sqrt(a.covariance[k, k] * b.covariance[k, k])
        S = np.array([[a.covariance[k, k], cross], [cross, b.covariance[k, k]]])
        best = 1.0 / np.linalg.inv(S).sum()  # generalised least squares
        assert variance[k] == pytest.approx(best)
        assert mean[k] == pytest.approx(best * np.linalg.inv(S).sum(axis=0) @ pair)


def test_a_worse_one_that_says_the_same_gets_no_weight():
    a, b = (BiasPrior(0, np.full(3, x), np.full(3, x), s * np.eye(6)) for x, s in ((1.0, 1.0), (2.0, 100.0)))
    mean, variance = least_variance(a, b, np.full(6, 0.9))
    np.testing.assert_array_equal(mean, 1.0)
    np.testing.assert_array_equal(variance, 1.0)


def test_correlation_and_error_come_back(two, tmp_path):
    found = find_join(("a", "b"), spans(80))
    np.testing.assert_allclose(found.correlation, RHO, atol=0.1)
    runs = [listen(joined.joined(found, s.sequence), s) for s in spans(120)[80:]]
    errors = np.vstack([r.errors.error for r in runs])
    best = [
        1.0 / np.linalg.inv([[a * a, RHO * a * b], [RHO * a * b, b * b]]).sum()
        for a, b in zip(SIGMA["a"], SIGMA["b"], strict=True)
    ]
    np.testing.assert_allclose((errors**2).mean(axis=0), best, rtol=0.2)
    stated = found.errors.variance(np.array(best)) + np.diagonal(found.errors.constant)
    np.testing.assert_allclose(stated, best, rtol=0.15)
    assert Join.from_dict(json.loads(json.dumps(found.as_dict()))).specs == ("a", "b")


def test_before_both_speak_one_does():
    cover = np.eye(6)
    late = ListedPrior([BiasPrior(20_000_000_000, np.ones(3), np.ones(3), cover)], window_s=10.0)
    early = ListedPrior([BiasPrior(2_500_000_000, np.zeros(3), np.zeros(3), cover)], window_s=5.0)
    plain = Join(("a", "b"), np.zeros(6), ErrorModel(1e-12 * np.eye(6), np.ones(6), np.zeros(6)), ())
    both = JoinedPrior(early, late, plain)
    assert both.window_s == 10.0
    assert both.poll(4_000_000_000) == []
    (first,) = both.poll(6_000_000_000)
    np.testing.assert_array_equal(first.vector, 0.0)
    (second,) = both.poll(30_000_000_000)
    assert second.t_ns == 20_000_000_000
    np.testing.assert_allclose(second.vector, 0.5)
    np.testing.assert_allclose(np.diagonal(second.covariance), 0.5)


def test_an_unknown_name_is_answered_with_the_list():
    with pytest.raises(ConfigError, match="'balloon' is unknown; known are"):
        load_prior("ipnet+motion:balloon")

"""Measurements of a run become one estimate."""

import subprocess
import sys

import numpy as np

from ipnet.fusion import SPREAD, Fusion, nothing_known
from navcore.imu import ImuNoise
from navcore.prior import BiasPrior

STILL = ImuNoise(1e-4, 0.0, 1e-3, 0.0)
WALKING = ImuNoise(1e-4, 1e-3, 1e-3, 1e-2)
E = np.diag(np.repeat([0.01, 0.1], 3) ** 2)
C = np.diag(np.repeat([0.005, 0.02], 3) ** 2)


def measured(values, every_s=5.0, covariance=E):
    return [
        BiasPrior(round((2.5 + k * every_s) * 1e9), value[:3], value[3:], covariance) for k, value in enumerate(values)
    ]


def fused(measurements, noise, spread=SPREAD):
    """The stamps of the measurements that count, and the estimate after the last of all."""
    fusion = Fusion(nothing_known(0, spread), C, 5.0, noise)
    return [z.t_ns for z in measurements if fusion.add(z)], fusion.at(measurements[-1].t_ns)


def test_it_is_the_posterior_of_all_measurements_at_once():
    """Oracle: the joint Gaussian of b at the start and at ten times, c and e, conditioned in one step."""
    rng = np.random.default_rng(1)
    z = measured(rng.normal(size=(10, 6)) * 0.1)
    _, found = fused(z, WALKING)
    t = np.array([m.t_ns for m in z]) * 1e-9
    walk = np.diag(np.repeat([1e-3, 1e-2], 3) ** 2)
    start = nothing_known(0).covariance
    of_b = np.kron(np.ones((10, 10)), start) + np.kron(np.minimum.outer(t, t), walk)
    S = of_b + np.kron(np.ones((10, 10)), C) + np.kron(np.eye(10), E)
    gain = of_b[-6:] @ np.linalg.inv(S)
    np.testing.assert_allclose(found.vector, gain @ np.concatenate([m.vector for m in z]), atol=1e-10)
    np.testing.assert_allclose(found.covariance, of_b[-6:, -6:] - gain @ of_b[:, -6:], atol=1e-12)


def test_what_is_constant_never_averages_out():
    z = measured(np.zeros((1000, 6)))
    _, found = fused(z, STILL, (10.0, 10.0))
    left = np.sqrt(np.diagonal(found.covariance))
    np.testing.assert_allclose(left, np.sqrt(np.diagonal(C)), rtol=0.02)


def test_windows_that_overlap_count_once():
    (once_ns, once), (often_ns, often) = (
        fused(measured(np.ones((n, 6)), every_s), STILL) for n, every_s in ((4, 5.0), (16, 1.25))
    )
    assert often_ns == once_ns
    np.testing.assert_array_equal(often.covariance, once.covariance)


def test_between_measurements_the_bias_walks():
    fusion = Fusion(nothing_known(0), C, 5.0, WALKING)
    (z,) = measured(np.ones((1, 6)))
    assert fusion.add(z)
    now, later = fusion.at(z.t_ns), fusion.at(z.t_ns + 4_000_000_000)
    np.testing.assert_array_equal(now.vector, later.vector)
    np.testing.assert_allclose(
        np.diagonal(later.covariance - now.covariance), 4.0 * np.repeat([1e-6, 1e-4], 3), rtol=1e-9
    )


def test_a_run_is_consistent():
    """Drawn from the model itself, the error is what the covariance says: two-sided, over 300 runs of 6 axes."""
    rng = np.random.default_rng(2)
    start = nothing_known(0)
    squares = []
    for _ in range(300):
        b, c = rng.multivariate_normal(np.zeros(6), start.covariance), rng.multivariate_normal(np.zeros(6), C)
        z = measured(b + c + rng.multivariate_normal(np.zeros(6), E, size=8))
        _, found = fused(z, STILL)
        r = found.vector - b
        squares.append(r @ np.linalg.solve(found.covariance, r) / 6.0)
    assert abs(np.mean(squares) - 1.0) < 3.3 * np.sqrt(2.0 / 1800.0)


def test_sources_do_not_need_filterpy():
    """It imports matplotlib, which takes a second: not where an estimator starts."""
    code = (
        "import sys; from navcore.prior import load_prior; load_prior('window-mean'); "
        "assert not {'filterpy', 'matplotlib', 'torch'} & set(sys.modules), sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)

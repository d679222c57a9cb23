"""Increments against the integral of a known motion, and their derivatives against differences."""

import numpy as np
import pytest

from ipnet.errors import ConfigError
from ipnet.preintegration import preintegrate
from navcore import so3
from navcore.imu import ImuNoise, ImuSamples

RATE = 200.0
EDGES = np.array([0, 1_000_000_000, 1_500_000_000, 2_300_000_000])


def turning(b_g=(0.0, 0.0, 0.0), b_a=(0.0, 0.0, 0.0)):
    """Constant rate and specific force, known in closed form; stamps are centres of 5 ms."""
    t_ns = np.arange(480) * 5_000_000 + 2_500_000
    omega, force = np.array([0.3, -0.5, 0.8]), np.array([1.0, -2.0, 9.0])
    return omega, force, ImuSamples(t_ns, np.tile(omega + b_g, (480, 1)), np.tile(force + b_a, (480, 1)))


def closed_form(omega, force, T):
    """By the integrals of Rodrigues' formula, from a fine sum."""
    n = 20_000
    s = (np.arange(n) + 0.5) * T / n
    R = so3.exp(omega * s[:, None])
    a = R @ force
    return so3.exp(omega * T), a.sum(axis=0) * T / n, ((T - s)[:, None] * a).sum(axis=0) * T / n


def test_increments_are_the_integrals_of_a_known_motion():
    b_g, b_a = np.array([0.02, -0.01, 0.03]), np.array([0.1, 0.2, -0.3])
    omega, force, samples = turning(b_g, b_a)
    got = preintegrate(samples, EDGES, b_g, b_a)
    for k, T in enumerate(np.diff(EDGES) * 1e-9):
        R, v, p = closed_form(omega, force, T)
        np.testing.assert_allclose(got.delta_R[k], R, atol=1e-9)
        np.testing.assert_allclose(got.delta_v[k], v, atol=1e-7)
        np.testing.assert_allclose(got.delta_p[k], p, atol=1e-7)


def test_edges_may_cut_samples():
    omega, force, samples = turning()
    T = 0.7213
    got = preintegrate(samples, np.array([1_234_567, 1_234_567 + round(T * 1e9)]), np.zeros(3), np.zeros(3))
    R, v, p = closed_form(omega, force, T)
    np.testing.assert_allclose(got.delta_R[0], R, atol=1e-9)
    np.testing.assert_allclose(got.delta_v[0], v, atol=1e-7)
    np.testing.assert_allclose(got.delta_p[0], p, atol=1e-7)


def moving(rng):
    t_ns = np.arange(480) * 5_000_000 + 2_500_000
    smooth = np.cumsum(rng.standard_normal((480, 6)), axis=0) * 0.05
    return ImuSamples(t_ns, smooth[:, :3], smooth[:, 3:] + [0.0, 0.0, 9.81])


def test_derivatives_by_the_biases_agree_with_differences():
    samples = moving(np.random.default_rng(1))
    bias, h = np.array([0.01, -0.02, 0.03, 0.1, -0.2, 0.3]), 1e-5
    at = preintegrate(samples, EDGES, bias[:3], bias[3:])
    for axis in range(6):
        more, less = bias + h * np.eye(6)[axis], bias - h * np.eye(6)[axis]
        up, down = (preintegrate(samples, EDGES, b[:3], b[3:]) for b in (more, less))
        d_R = so3.log(np.swapaxes(at.delta_R, 1, 2) @ up.delta_R) - so3.log(
            np.swapaxes(at.delta_R, 1, 2) @ down.delta_R
        )
        numeric = np.hstack([d_R, up.delta_v - down.delta_v, up.delta_p - down.delta_p]) / (2.0 * h)
        np.testing.assert_allclose(at.J[:, :, axis], numeric, atol=2e-4)


def test_noise_is_that_of_many_draws():
    rng = np.random.default_rng(2)
    samples = moving(rng)
    noise = ImuNoise(1e-3, 0.0, 1e-2, 0.0, RATE)
    clean = preintegrate(samples, EDGES, np.zeros(3), np.zeros(3), noise)
    errors = []
    for _ in range(600):
        n_g, n_a = rng.standard_normal((2, len(samples), 3)) * np.sqrt(RATE)
        noisy = ImuSamples(samples.t_ns, samples.gyro + 1e-3 * n_g, samples.accel + 1e-2 * n_a)
        got = preintegrate(noisy, EDGES, np.zeros(3), np.zeros(3))
        d_R = so3.log(np.swapaxes(clean.delta_R, 1, 2) @ got.delta_R)
        errors.append(np.hstack([d_R, got.delta_v - clean.delta_v, got.delta_p - clean.delta_p]))
    drawn = np.array(errors)  # (600, 3, 9)
    for k in range(3):
        whitened = np.linalg.solve(np.linalg.cholesky(clean.Q[k]), drawn[:, k].T)
        nees = np.mean(np.sum(whitened**2, axis=0)) / 9.0
        assert 0.93 < nees < 1.07


def test_edges_outside_the_samples_are_refused():
    _, _, samples = turning()
    with pytest.raises(ConfigError, match="samples cover"):
        preintegrate(samples, np.array([0, 3_000_000_000]), np.zeros(3), np.zeros(3))
    with pytest.raises(ConfigError, match="increase"):
        preintegrate(samples, np.array([5, 5]), np.zeros(3), np.zeros(3))


def test_means_over_an_interval_are_those_of_its_parts():
    samples = moving(np.random.default_rng(3))
    zero, R_0 = np.zeros(3), so3.exp(np.array([0.4, -0.2, 1.0]))
    v_0, g = np.array([1.0, -0.5, 0.2]), np.array([0.0, 0.0, -9.81])
    whole = preintegrate(samples, np.array([0, 500_000_000]), zero, zero)
    got = whole.mean_RT[0] @ R_0.T @ v_0 + whole.mean_tRT[0] @ R_0.T @ g + whole.mean_RTv[0]
    R, v, seen = R_0, v_0, []
    for k in range(1000):  # half a millisecond each
        part = preintegrate(samples, np.array([k, k + 1]) * 500_000, zero, zero)
        seen.append(R.T @ v)
        v = v + g * part.dt[0] + R @ part.delta_v[0]
        R = R @ part.delta_R[0]
    np.testing.assert_allclose(got, np.mean(seen, axis=0), atol=3e-3)

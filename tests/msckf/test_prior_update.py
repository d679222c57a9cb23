"""The bias prior: Bayes' rule before the start, a measurement with its own constant error after it."""

import numpy as np
import pytest

from msckf.blocks import BIASES
from msckf.config import PriorConfig, StartConfig
from msckf.prior_update import PriorUpdate
from msckf.state import FilterState
from navcore.imu import ImuNoise
from navcore.prior import BiasPrior
from navcore.priors.listed import ListedPrior
from tests.msckf.scenes import start_state

NOISE = ImuNoise(1.7e-4, 2e-5, 2.0e-3, 3.0e-3, 200.0)
STILL = ImuNoise(1.7e-4, 0.0, 2.0e-3, 0.0, 200.0)  # biases that do not walk
S = 1_000_000_000
C = np.diag(np.repeat([0.003**2, 0.03**2], 3))
E = np.diag(np.repeat([0.002**2, 0.02**2], 3))


def measurement(t_s, seed=0, covariance=E):
    rng = np.random.default_rng(seed)
    return BiasPrior(round(t_s * S), 0.01 * rng.standard_normal(3), 0.1 * rng.standard_normal(3), covariance)


def device(scale=1.0):
    rng = np.random.default_rng(9)
    A = rng.standard_normal((6, 12)) * np.repeat([0.01, 0.1], 3)[:, None]
    return BiasPrior(0, np.full(3, 0.005), np.full(3, -0.05), scale * A @ A.T / 12.0)


def told(measurements=(), known=None, window_s=5.0, constant=C, noise=STILL, **settings):
    return PriorUpdate(ListedPrior(measurements, known, window_s, constant), PriorConfig(**settings), noise)


def conditioned(known, constant, measurements):
    """Mean and covariance of (b, c) given all measurements at once: the Gaussian, conditioned in one step."""
    n = len(measurements)
    H = np.tile(np.hstack([np.eye(6), np.eye(6)]), (n, 1))
    prior = np.zeros((12, 12))
    prior[:6, :6], prior[6:, 6:] = known.covariance, constant
    R = np.kron(np.eye(n), E)
    mean = np.concatenate([known.vector, np.zeros(6)])
    z = np.concatenate([m.vector for m in measurements])
    K = prior @ H.T @ np.linalg.inv(H @ prior @ H.T + R)
    return mean + K @ (z - H @ mean), prior - K @ H @ prior


def started(prior, t_s, state=None):
    """A state that has begun with what is known, its covariance of (b, c) in that order."""
    bias = prior.starting_bias(StartConfig(), round(t_s * S))
    if state is None:
        snapshot = start_state()
        P = snapshot.covariance.copy()
        P[:9, 9:15] = P[9:15, :9] = 0.0
        P[BIASES, BIASES] = bias.device.covariance
        snapshot.b_g[:], snapshot.b_a[:] = bias.device.b_g, bias.device.b_a
        object.__setattr__(snapshot, "covariance", P)
        state = FilterState(snapshot)
    prior.begin(state, bias)
    return state, bias


def joint(state):
    where = np.r_[BIASES, state.prior_error]
    return state.covariance[np.ix_(where, where)]


def test_the_starting_bias_is_the_conditioned_gaussian():
    known, zs = device(), [measurement(2.5, 1), measurement(7.5, 2), measurement(12.5, 3)]
    state, bias = started(told(zs, known), 20.0)
    mean, P = conditioned(known, C, zs)
    np.testing.assert_allclose(bias.device.vector, mean[:6], rtol=1e-9)
    np.testing.assert_allclose(bias.device.covariance, P[:6, :6], atol=1e-15)
    np.testing.assert_allclose(state.c, mean[6:], atol=1e-12)
    np.testing.assert_allclose(joint(state), P, atol=1e-12)


def test_what_came_before_a_start_that_failed_is_not_forgotten():
    """A start is tried at every frame; the source says each thing once."""
    known, zs = device(), [measurement(2.5, 1), measurement(7.5, 2), measurement(12.5, 3)]
    prior = told(zs, known)
    for t_s in (4.0, 6.0, 11.0, 12.0):
        prior.starting_bias(StartConfig(), round(t_s * S))
    state, bias = started(prior, 20.0)
    mean, P = conditioned(known, C, zs)
    np.testing.assert_allclose(bias.device.vector, mean[:6], rtol=1e-9)
    np.testing.assert_allclose(joint(state), P, atol=1e-12)


def test_where_the_prior_alone_sets_the_bias_their_errors_are_opposite():
    """Nothing known of the device: b = z - c - e, so cov(b, c) = -cov(c)."""
    wide = BiasPrior(0, np.zeros(3), np.zeros(3), 1e6 * np.eye(6))
    state, _ = started(told([measurement(2.5)], wide), 5.0)
    P = joint(state)
    np.testing.assert_allclose(P[:6, 6:], -C, rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(P[:6, :6], C + E, rtol=1e-5, atol=1e-12)


def test_without_measurements_the_device_is_all_that_is_known():
    state, bias = started(told([], device()), 5.0)
    np.testing.assert_allclose(bias.device.covariance, device().covariance, atol=1e-18)
    np.testing.assert_allclose(joint(state)[6:, 6:], C, atol=1e-18)
    assert not joint(state)[:6, 6:].any()
    unknown = told().starting_bias(StartConfig(gyro_bias_sigma=0.3, accel_bias_sigma=0.7), 0)
    np.testing.assert_allclose(np.diagonal(unknown.device.covariance), np.repeat([0.09, 0.49], 3))


def test_a_start_that_learned_more_of_the_bias_learned_of_the_error_too():
    """Vision halves the bias's covariance during the start: `c` follows through its regression on the bias."""
    known, zs = device(), [measurement(2.5, 1)]
    prior = told(zs, known)
    bias = prior.starting_bias(StartConfig(), 5 * S)
    snapshot = start_state()
    P = snapshot.covariance.copy()
    P[:9, 9:15] = P[9:15, :9] = 0.0
    P[BIASES, BIASES] = bias.device.covariance
    object.__setattr__(snapshot, "covariance", P)
    snapshot.b_g[:], snapshot.b_a[:] = bias.device.b_g, bias.device.b_a
    late, early = FilterState(snapshot), FilterState(snapshot)
    r, R = np.full(6, 0.01), bias.device.covariance
    late.update(np.eye(6), np.r_[BIASES], r, R)  # first the vision, then `c`
    prior.begin(late, bias)
    prior.begin(early, bias)  # the other way round
    early.update(np.eye(6), np.r_[BIASES], r, R)
    np.testing.assert_allclose(joint(late), joint(early), atol=1e-12)
    np.testing.assert_allclose(late.c, early.c, atol=1e-12)


def test_repeating_itself_makes_the_prior_no_surer_than_its_constant_error():
    zs = [measurement(5.0 * k, 1) for k in range(1, 400)]
    prior = told(zs, BiasPrior(0, np.zeros(3), np.zeros(3), 100.0 * C))
    state, _ = started(prior, 0.0)
    for k in range(1, 400):
        prior.update(state, 5 * k * S + 3 * S)
    assert prior.applied > 390
    P = joint(state)
    bound = np.linalg.inv(np.linalg.inv(C) + np.linalg.inv(100.0 * C))  # b given b + c
    np.testing.assert_allclose(P[:6, :6], bound, rtol=0.05, atol=1e-9)
    assert np.linalg.eigvalsh(P[:6, :6] - bound).min() > -1e-12


def test_without_a_constant_error_there_is_nothing_to_estimate():
    prior = told([measurement(2.5)], device(), constant=np.zeros((6, 6)))
    assert not prior.models_error
    state, bias = started(prior, 5.0)
    assert state.c is None
    assert bias.c is None
    K = device().covariance @ np.linalg.inv(device().covariance + E)
    np.testing.assert_allclose(bias.device.covariance, (np.eye(6) - K) @ device().covariance, atol=1e-15)


def plain_state():
    state = FilterState(start_state())
    return state, np.array(state.covariance), state.biases


@pytest.mark.parametrize("weight", [50.0, 400.0])
def test_plain_is_the_papers_factor(weight):
    """Residual W (b - b_hat), Jacobian W I, unit noise (Yi et al., eqs. 4 and 5): every measurement, no `c`."""
    zs = [measurement(1.0, 1), measurement(1.1, 2)]
    prior = told(zs, window_s=0.0, mode="plain", weight=weight)
    assert not prior.models_error
    state, P, b = plain_state()
    assert prior.update(state, 10 * S) == ()
    assert prior.applied == 2
    I = np.eye(6)  # noqa: E741
    information = np.linalg.inv(P[BIASES, BIASES]) + 2.0 * (weight * I).T @ (weight * I)
    np.testing.assert_allclose(np.linalg.inv(state.covariance[BIASES, BIASES]), information, rtol=1e-5)
    gradient = sum((weight * I).T @ (weight * (z.vector - b)) for z in zs)
    np.testing.assert_allclose(state.biases, b + np.linalg.solve(information, gradient), rtol=1e-6)


def test_modelled_takes_one_measurement_per_window():
    """Windows of 5 s every second: those in between share their noise."""
    zs = [measurement(2.5 + k, k) for k in range(12)]
    prior = told(zs)
    state, _ = started(prior, 0.0)
    for k in range(20):
        prior.update(state, k * S)
    assert prior.applied == 3  # stamped 2.5, 7.5 and 12.5
    thick = told(zs, mode="plain")
    thick.update(FilterState(start_state()), 30 * S)
    assert thick.applied == 12


def test_a_late_measurement_is_weaker_by_what_the_bias_may_have_walked():
    z = measurement(10.0, 1)
    walking = told([z], constant=np.zeros((6, 6)), window_s=8.0, noise=NOISE)
    state, P, b = plain_state()
    object.__setattr__(z, "b_g", b[:3])
    object.__setattr__(z, "b_a", b[3:])
    walking.update(state, 14 * S)
    R = E + 4.0 * np.diag(np.repeat([NOISE.gyroscope_random_walk, NOISE.accelerometer_random_walk], 3) ** 2)
    expected = np.linalg.inv(P[BIASES, BIASES]) + np.linalg.inv(R)
    np.testing.assert_allclose(np.linalg.inv(state.covariance[BIASES, BIASES]), expected, rtol=1e-6)
    assert walking.nis == pytest.approx(0.0, abs=1e-12)


def off_by(state, sigmas, R=E):
    """A measurement whose innovation is `sigmas` times its standard deviation, along one direction."""
    L = np.linalg.cholesky(state.covariance[BIASES, BIASES] + R)
    vector = state.biases + L @ np.array([sigmas, 0, 0, 0, 0, 0])
    return BiasPrior(S, vector[:3], vector[3:], R)


@pytest.mark.parametrize("sigmas", [0.5, 3.0, 10.0])
def test_students_weight(sigmas):
    """As Gaussian where the innovation is usual; beyond, the noise grows so that S is S / weight."""
    state, P, b = plain_state()
    z = off_by(state, sigmas)
    prior = told([z], constant=np.zeros((6, 6)), window_s=0.0, student_dof=5.0)
    prior.update(state, S)
    assert prior.nis == pytest.approx(sigmas**2)
    weight = min((5.0 + 6.0) / (5.0 + sigmas**2), 1.0)
    assert (weight < 1.0) == (sigmas > 2.5)
    S_weighted = (P[BIASES, BIASES] + E) / weight
    K = P[BIASES, BIASES] @ np.linalg.inv(S_weighted)
    np.testing.assert_allclose(state.biases - b, K @ (z.vector - b), rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(state.covariance[BIASES, BIASES], P[BIASES, BIASES] - K @ P[BIASES, BIASES], atol=1e-12)


def test_a_run_of_surprises_opens_the_biases_and_is_told():
    state, _, b = plain_state()
    z = off_by(state, 30.0)
    zs = [BiasPrior(k * S, z.b_g, z.b_a, E) for k in range(1, 6)]
    prior = told(zs, constant=np.zeros((6, 6)), window_s=0.0, surprises=3)
    findings, sigmas = [], []
    for k in range(1, 6):
        findings.append(prior.update(state, k * S))
        sigmas.append(np.sqrt(np.diagonal(state.covariance)[BIASES].max()))
    assert findings[:2] == [(), ()]
    assert findings[2] == ("bias prior and filter disagree",)
    assert sigmas[0] >= sigmas[1]
    assert sigmas[2] > 3.0 * sigmas[1]
    assert np.linalg.norm(state.biases - z.vector) < 0.2 * np.linalg.norm(b - z.vector)  # now the prior is heard


def test_one_surprise_is_forgotten_when_the_next_fits():
    state, *_ = plain_state()
    zs = []
    for k in range(1, 9):
        z = off_by(state, 30.0 if k % 2 else 0.0)
        zs.append(BiasPrior(k * S, z.b_g, z.b_a, 1e4 * E if k % 2 == 0 else E))
    prior = told(zs, constant=np.zeros((6, 6)), window_s=0.0, surprises=2)
    assert [prior.update(state, k * S) for k in range(1, 9)] == [()] * 8

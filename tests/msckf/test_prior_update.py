"""The bias prior: Bayes' rule before the start, a measurement with its own constant error after it."""

import numpy as np
import pytest

from msckf.blocks import BIASES
from msckf.config import PriorConfig, StartConfig
from msckf.prior_update import PriorUpdate, retrodiction
from msckf.state import FilterState
from navcore.imu import ImuNoise, ImuSamples
from navcore.prior import BiasPrior
from navcore.priors.listed import ListedPrior
from tests.msckf.scenes import ONE, filter_state, start_state

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
        state = FilterState(snapshot, ONE)
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
    late, early = FilterState(snapshot, ONE), FilterState(snapshot, ONE)
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
    state = filter_state()
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
    thick.update(filter_state(), 30 * S)
    assert thick.applied == 12


def walk_of(noise, age_s):
    return age_s * np.diag(np.repeat([noise.gyroscope_random_walk, noise.accelerometer_random_walk], 3) ** 2)


def test_a_late_measurement_speaks_of_the_bias_before_its_walk():
    """Nothing was seen since: b, what it has walked in 4 s, and c are one Gaussian, conditioned in one step."""
    z = measurement(10.0, 1)
    late = told([z], window_s=8.0, noise=NOISE)
    state, _ = started(late, 10.0)
    before, b = joint(state), state.biases
    W = walk_of(NOISE, 4.0)
    P = np.zeros((18, 18))  # b now, c, walk
    P[:12, :12] = before
    P[12:, 12:] = P[:6, 12:] = P[12:, :6] = W
    H = np.hstack([np.eye(6), np.eye(6), -np.eye(6)])
    S_z = H @ P @ H.T + E
    K = P @ H.T @ np.linalg.inv(S_z)
    r = z.vector - b - state.c
    late.update(state, 14 * S)
    assert late.applied == 1
    np.testing.assert_allclose(late.nis, r @ np.linalg.solve(S_z, r), rtol=1e-9)
    np.testing.assert_allclose(joint(state), (P - K @ S_z @ K.T)[:12, :12], rtol=1e-6, atol=1e-13)
    np.testing.assert_allclose(state.biases, b + K[:6] @ r, rtol=1e-9)


def test_measurements_before_the_start_are_as_old_as_they_are():
    """b at their times and at the start differ by its walk."""
    times, at_s = (2.5, 7.5, 12.5), 20.0
    zs = [measurement(t, k) for k, t in enumerate(times)]
    _, bias = started(told(zs, device(), noise=NOISE), at_s)
    unit = walk_of(NOISE, 1.0)
    ages = at_s - np.array(times)
    P_b = device().covariance + unit * ages[0]  # at the start; known when the first was true
    cross = np.hstack([device().covariance + unit * (ages[0] - age) for age in ages])
    then = np.minimum.outer(ages[0] - ages, ages[0] - ages)
    S_z = np.kron(then, unit) + np.kron(np.ones((3, 3)), device().covariance + C) + np.kron(np.eye(3), E)
    r = np.concatenate([z.vector - device().vector for z in zs])
    K = cross @ np.linalg.inv(S_z)
    np.testing.assert_allclose(bias.device.vector, device().vector + K @ r, rtol=1e-9)
    np.testing.assert_allclose(bias.device.covariance, P_b - K @ cross.T, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_error_and_walk_share_no_more_than_either_has(size):
    """Seen well since, the biases' error is all walk; seen badly, the walk is all in their error."""
    rng = np.random.default_rng(1)
    A = rng.standard_normal((6, 6))
    W = np.diag(rng.uniform(0.5, 2.0, 6))
    P = size * (A @ A.T + np.eye(6))
    H, rest = retrodiction(P, W)
    shared = (np.eye(6) - H) @ P
    np.testing.assert_allclose(shared, shared.T, rtol=1e-7, atol=1e-12)
    whole = np.block([[P, shared], [shared.T, W]])
    assert np.linalg.eigvalsh(whole).min() > -1e-9 * max(size, 1.0)
    np.testing.assert_allclose(rest, W - shared @ np.linalg.solve(P, shared), rtol=1e-6, atol=1e-9)
    if size != 1.0:
        np.testing.assert_allclose(shared, P if size < 1.0 else W, rtol=1e-6, atol=1e-9)
    H, rest = retrodiction(P, np.zeros((6, 6)))
    np.testing.assert_allclose(H, np.eye(6), atol=1e-12)
    np.testing.assert_allclose(rest, 0.0, atol=1e-12)


@pytest.mark.parametrize(("window_s", "apart_s"), [(20, 20), (40, 40), (20, 5)])
def test_long_windows_over_biases_that_walk_leave_the_filter_honest(window_s, apart_s):
    """Windows every 5 s whose noise is that of their samples, biases that walk by 3 sigma in one, and for a minute
    something that sees them: NEES of biases and NIS stay near 1. One statement a window is taken; or all, if the source
    states the variance of each one after the first times the overlap."""
    seconds, runs, scale = 160, 24, np.repeat([0.002, 0.02], 3)
    walk = 3.0 * scale / np.sqrt(window_s)
    noise = ImuNoise(1e-4, walk[0], 1e-3, walk[3], 200.0)
    known = BiasPrior(0, np.zeros(3), np.zeros(3), np.diag((5.0 * scale) ** 2))
    nees, nis = [], []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        b = 5.0 * scale * rng.standard_normal(6) + np.cumsum(walk * rng.standard_normal((seconds + 1, 6)), axis=0)
        white = scale * np.sqrt(window_s) * rng.standard_normal((seconds, 6))
        c = np.sqrt(np.diagonal(C)) * rng.standard_normal(6)
        zs = []
        for end in range(window_s, seconds + 1, 5):
            middle = end - window_s // 2
            z = b[middle] + c + white[end - window_s : end].mean(axis=0)
            shared = window_s / apart_s if zs else 1.0
            zs.append(BiasPrior(middle * S, z[:3], z[3:], shared * np.diag(scale**2)))
        prior = told(zs, known, float(window_s), noise=noise, student_dof=1e9)
        prior.source.window_s = float(apart_s)  # they still come at the end of their windows
        state, _ = started(prior, 0.0)
        for t in range(1, seconds + 1):
            state.widen_biases(np.diag(walk**2))
            if t < 60:
                seen = b[t] + scale * rng.standard_normal(6)
                state.update(np.eye(6), np.r_[BIASES], seen - state.biases, np.diag(scale**2))
            prior.update(state, t * S)
            if prior.nis is not None:
                nis.append(prior.nis / 6.0)
            error = b[t] - state.biases
            nees.append(error @ np.linalg.solve(state.covariance[BIASES, BIASES], error) / 6.0)
        assert prior.applied == 1 + (seconds - window_s) // apart_s
    assert 0.85 < np.mean(nees) < 1.15
    assert 0.8 < np.mean(nis) < 1.2 or apart_s < window_s  # what is stated is more than one statement's own error


class Counting(ListedPrior):
    """Says at every poll how many samples it has; knows nothing of time."""

    def __init__(self):
        super().__init__()
        self.samples = 0

    def add_imu(self, samples):
        self.samples += len(samples)

    def poll(self, t_ns):
        return [BiasPrior(t_ns, np.full(3, self.samples), np.zeros(3), np.eye(6))]


@pytest.mark.parametrize("chunk", [1, 7, 400])
def test_a_source_is_told_no_more_than_the_filter_has_reached(chunk):
    """However the samples come, the same is said at the same frame: live, late, or all at once."""
    t_ns = (np.arange(400) * S) // 200
    samples = ImuSamples(t_ns, np.zeros((400, 3)), np.zeros((400, 3)))
    source = Counting()
    prior = PriorUpdate(source, PriorConfig(), NOISE)
    for k in range(0, 400, chunk):
        prior.add_imu(samples[k : k + chunk])
    state, *_ = plain_state()
    had = []
    for frame_ns in (-1, 0, S // 2, S // 2, S, 3 * S):
        prior.update(state, frame_ns)
        had.append(source.samples)
    assert had == [0, 1, 101, 101, 201, 400]
    prior.starting_bias(StartConfig(), 4 * S)
    assert source.samples == 400


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

"""State and covariance move together, as explicit matrix algebra and a textbook filter say."""

from itertools import pairwise

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.spatial.transform import Rotation

from msckf.blocks import ACCEL_BIAS, BIASES, GYRO_BIAS, IMU_SIZE, POSITION, THETA, VELOCITY
from msckf.filter import continued
from msckf.imu_buffer import Cells
from msckf.propagation import integrate, noise_in_world, predict, transition
from msckf.state import FilterState
from msckf.views import Rig
from navcore.imu import ImuNoise
from tests.msckf.scenes import mount, start_state

NOISE = ImuNoise(1.7e-4, 1.9e-5, 2.0e-3, 3.0e-3, 200.0)


def increment(state, seed=0):
    rng = np.random.default_rng(seed)
    force = np.array([0.0, 0.0, 9.8]) + rng.standard_normal((10, 3))
    return integrate(Cells(np.full(10, 0.005), rng.standard_normal((10, 3)), force, np.zeros(10)), *state, NOISE)


def moved(state, seed=0):
    """The state after one interval of IMU."""
    state.propagate(increment((state.b_g, state.b_a), seed))
    return state


def with_window(clones=3, prior_error=True, fej=True, seed=0):
    """A state with clones that lie apart and, if wanted, the prior's error."""
    state = FilterState(start_state(seed), fej=fej)
    for k in range(clones):
        moved(state, k)
        state.add_clone(50_000_000 * k)
    if prior_error:
        gain = -0.3 * np.eye(6)
        state.add_prior_error(np.full(6, 0.01), gain, 1e-3 * np.eye(6))
    return state


def rotvec(R):
    return Rotation.from_matrix(R).as_rotvec()


def test_blocks_lie_in_the_documented_order():
    order = (THETA, POSITION, VELOCITY, GYRO_BIAS, ACCEL_BIAS)
    assert order[0].start == 0
    assert all(a.stop == b.start for a, b in pairwise(order))
    assert slice(GYRO_BIAS.start, ACCEL_BIAS.stop) == BIASES
    assert ACCEL_BIAS.stop == IMU_SIZE
    state = with_window(2)
    assert (state.prior_error, state.clone(0), state.clone(1)) == (slice(15, 21), slice(21, 27), slice(27, 33))
    assert state.size == 33
    bare = with_window(2, prior_error=False)
    assert (bare.prior_error, bare.clone(0)) == (slice(15, 15), slice(15, 21))


def test_an_update_is_the_textbooks():
    """filterpy's filter on the error state, Joseph's form and all; then what it says, applied on the manifold."""
    state = with_window()
    n, rng = state.size, np.random.default_rng(5)
    columns = np.r_[THETA, VELOCITY, BIASES, state.prior_error, state.clone(1)]
    H = rng.standard_normal((4, len(columns)))
    R = np.diag([0.01, 0.02, 0.03, 0.04])
    r = 0.05 * rng.standard_normal(4)
    kalman = KalmanFilter(dim_x=n, dim_z=4)
    kalman.P, kalman.R, kalman.H = np.array(state.covariance), R, np.zeros((4, n))
    kalman.H[:, columns] = H
    before = FilterState(state.snapshot())
    c, clones = state.c.copy(), state.clones
    clones_R, clones_p = clones.R_WB.copy(), clones.p_WB.copy()
    kalman.update(r)
    state.update(H, columns, r, R)

    np.testing.assert_allclose(state.covariance, kalman.P, atol=1e-14)
    dx = kalman.x[:, 0]
    np.testing.assert_allclose(rotvec(before.R_WB.T @ state.R_WB), dx[THETA], atol=1e-9)
    for name, where in (("p_WB", POSITION), ("v_WB", VELOCITY), ("b_g", GYRO_BIAS), ("b_a", ACCEL_BIAS)):
        np.testing.assert_allclose(getattr(state, name) - getattr(before, name), dx[where], atol=1e-13)
    np.testing.assert_allclose(state.c - c, dx[15:21], atol=1e-13)
    for k in range(3):
        d = dx[state.clone(k)]
        np.testing.assert_allclose(rotvec(clones_R[k].T @ state.clones.R_WB[k]), d[:3], atol=1e-9)
        np.testing.assert_allclose(state.clones.p_WB[k] - clones_p[k], d[3:], atol=1e-13)


@pytest.mark.parametrize("prior_error", [False, True])
def test_propagation_moves_the_covariance(prior_error):
    state = with_window(prior_error=prior_error)
    P = np.array(state.covariance)
    at = (state.R_WB, state.p_WB, state.v_WB)
    inc = increment((state.b_g, state.b_a), 9)
    state.propagate(inc)
    F = np.eye(len(P))
    F[:15, :15] = transition(inc, at, predict(*at, inc))
    Q = np.zeros_like(P)
    Q[:15, :15] = noise_in_world(inc, at[0])
    np.testing.assert_allclose(state.covariance, F @ P @ F.T + Q, atol=1e-15)


def test_a_clone_is_a_copy_of_the_pose():
    state = moved(with_window(2))
    n = state.size
    J = np.vstack([np.eye(n), np.eye(n)[np.r_[THETA, POSITION]]])
    expected = J @ state.covariance @ J.T
    state.add_clone(7)
    np.testing.assert_allclose(state.covariance, expected, atol=1e-16)
    np.testing.assert_array_equal(state.clones.R_WB[-1], state.R_WB)
    np.testing.assert_array_equal(state.clones.p_first[-1], state.p_WB)
    assert state.clones.t_ns.tolist() == [0, 50_000_000, 7]


@pytest.mark.parametrize("k", [0, 1, 2])
def test_dropping_a_clone_drops_its_rows_only(k):
    state = with_window()
    keep = np.delete(np.arange(state.size), state.clone(k))
    expected, t_ns = state.covariance[np.ix_(keep, keep)], np.delete(state.clones.t_ns, k)
    p_WB, R_first = np.delete(state.clones.p_WB, k, axis=0), np.delete(state.clones.R_first, k, axis=0)
    state.drop_clone(k)
    np.testing.assert_array_equal(state.covariance, expected)
    np.testing.assert_array_equal(state.clones.t_ns, t_ns)
    np.testing.assert_array_equal(state.clones.p_WB, p_WB)
    np.testing.assert_array_equal(state.clones.R_first, R_first)


def test_the_priors_error_joins_by_its_regression_on_the_biases():
    """c = mean + gain (b - b_hat) + rest, so cov(c, x) = gain cov(b, x)."""
    state = with_window(prior_error=False)
    n, rng = state.size, np.random.default_rng(1)
    gain, conditional = rng.standard_normal((6, 6)), np.diag(rng.uniform(0.1, 1.0, 6))
    P = np.array(state.covariance)
    state.add_prior_error(np.arange(6.0), gain, conditional)
    G = np.zeros((6, n))
    G[:, BIASES] = gain
    J = np.vstack([np.eye(15, n), G, np.eye(n)[15:]])
    expected = J @ P @ J.T
    expected[15:21, 15:21] += conditional
    np.testing.assert_allclose(state.covariance, expected, atol=1e-13)
    np.testing.assert_array_equal(state.c, np.arange(6.0))


def test_where_the_cameras_sit_is_known_as_well_as_the_calibration():
    state = FilterState(start_state())
    P = np.array(state.covariance)
    rig = Rig((mount(), mount()))
    state.estimate_extrinsics(rig, 0.01, 0.02)
    state.add_prior_error(np.zeros(6), np.zeros((6, 6)), np.eye(6))
    moved(state).add_clone(0)
    assert (state.extrinsics, state.prior_error, state.clone(0)) == (slice(15, 27), slice(27, 33), slice(33, 39))
    assert state.seen_columns.tolist() == [*range(15, 27), *range(33, 39)]
    np.testing.assert_allclose(state.covariance[15:27, 15:27], np.diag(np.tile(np.repeat([1e-4, 4e-4], 3), 2)))
    assert not state.covariance[15:27, :15].any()
    np.testing.assert_array_equal(np.diagonal(state.covariance)[9:15] >= np.diagonal(P)[9:15], True)
    d = 0.01 * np.arange(1.0, 13.0)
    state.update(np.eye(12), np.r_[state.extrinsics], d, 1e-12 * np.eye(12))
    for c in range(2):
        np.testing.assert_allclose(rotvec(rig.R_BC[c].T @ state.rig.R_BC[c]), d[6 * c : 6 * c + 3], atol=1e-6)
        np.testing.assert_allclose(state.rig.p_BC[c] - rig.p_BC[c], d[6 * c + 3 : 6 * c + 6], atol=1e-6)


def test_widening_doubts_the_biases_only():
    state = with_window()
    before = np.array(state.covariance)
    extra = np.diag(np.arange(1.0, 7.0))
    state.widen_biases(extra)
    difference = state.covariance - before
    np.testing.assert_allclose(difference[BIASES, BIASES], extra, atol=1e-12)
    difference[BIASES, BIASES] = 0.0
    assert not difference.any()


def test_covariance_stays_symmetric_and_positive_over_a_long_life():
    """A window's worth of exact and inexact measurements, again and again."""
    rng = np.random.default_rng(0)
    state = with_window(clones=0)
    for k in range(200):
        moved(state, k)
        state.add_clone(k)
        columns = np.arange(state.clone_start, state.size)
        m = min(12, len(columns))
        H = rng.standard_normal((m, len(columns)))
        state.update(H, columns, 1e-3 * rng.standard_normal(m), 10.0 ** rng.uniform(-10, 0) * np.eye(m))
        if len(state.clones) > 6:
            state.drop_clone(0)
        np.testing.assert_array_equal(state.covariance, state.covariance.T)
        sigma = np.sqrt(np.diagonal(state.covariance))
        assert np.linalg.eigvalsh(state.covariance / np.outer(sigma, sigma)).min() > -1e-9
        np.testing.assert_allclose(state.R_WB @ state.R_WB.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("fej", [True, False])
def test_first_estimates_stay_when_updates_move_the_window(fej):
    state = with_window(fej=fej)
    first = state.clones.R_first.copy(), state.clones.p_first.copy()
    state.update(np.eye(6), np.r_[state.clone(1)], np.full(6, 0.1), 1e-6 * np.eye(6))
    assert np.abs(state.clones.p_WB - first[1]).max() > 0.01
    R_lin, p_lin = state.linearisation_clones
    expected = first if fej else (state.clones.R_WB, state.clones.p_WB)
    np.testing.assert_array_equal(R_lin, expected[0])
    np.testing.assert_array_equal(p_lin, expected[1])


@pytest.mark.parametrize(
    ("columns", "d", "anew"),
    [(VELOCITY, 0.02, False), (VELOCITY, 0.04, True), (THETA, 0.008, False), (THETA, 0.012, True)],
    ids=["slower", "faster", "less", "more"],
)
def test_first_estimates_are_given_up_after_a_large_correction_only(columns, d, anew):
    state = with_window()
    state.add_landmarks(np.arange(2), np.ones((2, 3)), np.zeros((2, 3)), np.zeros((6, 18)), np.eye(6))
    state.update(np.eye(3), np.r_[columns], np.array([d, 0.0, 0.0]), 1e-12 * np.eye(3))
    first = (state.clones.R_first, state.clones.p_first, state.landmarks.p_first)
    now = (state.clones.R_WB, state.clones.p_WB, state.landmarks.p_WF)
    assert np.abs(first[1] - now[1]).max() > 1e-4
    moved(state)
    linear = (*state.linearisation_clones, state.linearisation_landmarks)
    for found, expected in zip(linear, now if anew else first, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_nobody_else_changes_the_state():
    start = start_state()
    state = FilterState(start)
    shot = state.snapshot()
    moved(state).widen_biases(np.eye(6))
    np.testing.assert_array_equal(shot.covariance, start.covariance)
    np.testing.assert_array_equal(shot.p_WB, start.p_WB)
    assert np.abs(start.covariance - state.covariance).max() > 0.5
    with pytest.raises(ValueError, match="read-only"):
        state.covariance[0, 0] = 1.0


def test_a_restart_goes_on_in_heading_and_position():
    """Turning the new world about z and moving it changes nothing that can be observed."""
    start = start_state(3)
    last = Rotation.from_euler("ZYX", [2.0, 0.3, -0.4]).as_matrix()
    state = continued(start, last, np.array([5.0, 6.0, 7.0]))
    np.testing.assert_array_equal(state.p_WB, [5.0, 6.0, 7.0])
    heading = Rotation.from_matrix(state.R_WB).as_euler("ZYX")[0]
    assert heading == pytest.approx(2.0, abs=1e-9)
    np.testing.assert_allclose(state.R_WB.T @ [0, 0, 1], start.R_WB.T @ [0, 0, 1], atol=1e-12)  # tilt
    np.testing.assert_allclose(state.R_WB.T @ state.v_WB, start.R_WB.T @ start.v_WB, atol=1e-12)
    P_body = [
        s.R_WB.T @ s.covariance[VELOCITY, VELOCITY] @ s.R_WB for s in (state, start)
    ]  # as seen from the body: the same
    np.testing.assert_allclose(*P_body, atol=1e-12)
    np.testing.assert_array_equal(state.covariance[BIASES, BIASES], start.covariance[BIASES, BIASES])


def test_a_large_correction_ends_the_first_estimates_and_a_small_one_does_not():
    for velocity, stays in ((0.001, True), (0.2, False)):
        state = with_window(prior_error=False)
        first = state.linearisation_clones[1].copy()
        state.update(np.eye(3), np.arange(6, 9), np.full(3, velocity), 1e-9 * np.eye(3))
        moved(state)
        kept = np.array_equal(state.linearisation_clones[1], first)
        assert kept == stays
        assert stays or np.array_equal(state.linearisation_clones[1], state.clones.p_WB)

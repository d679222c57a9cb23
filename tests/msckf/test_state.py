"""State and covariance move together, as explicit matrix algebra and a textbook filter say."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from jacobians import assert_jacobian
from scipy.spatial.transform import Rotation

from msckf.blocks import ACCEL_BIAS, BIASES, GYRO_BIAS, IMU_SIZE, POSITION, THETA, VELOCITY
from msckf.config import CalibrationConfig
from msckf.estimated import Estimated
from msckf.landmarks import Landmarks
from msckf.propagation import integrate, noise_in_world, predict, transition
from msckf.state import FilterState, _bordered
from navcore.imu import ImuNoise
from navcore.imu_buffer import Cells
from navcore.last_pose import LastPose, continued
from tests.msckf.scenes import ONE, STEREO, filter_state, start_state

OMEGA = np.array([0.3, -0.5, 0.8])
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
    state = filter_state(seed, fej=fej)
    for k in range(clones):
        moved(state, k)
        state.add_clone(50_000_000 * k, OMEGA)
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


def test_a_heading_that_nobody_knows_is_no_doubt_about_the_velocity():
    """The covariance of a turn of the world about its vertical, by 0.2 rad, at 10 m/s; and what is left beside it."""
    start = start_state()
    start = replace(start, v_WB=np.array([6.0, 0.0, 8.0]))
    vertical = np.array([0.0, 0.0, 1.0])
    turn = np.zeros(IMU_SIZE)
    turn[THETA], turn[VELOCITY] = start.R_WB.T @ vertical, np.cross(vertical, start.v_WB)
    state = FilterState(replace(start, covariance=0.04 * np.outer(turn, turn)), ONE)
    assert np.sqrt(np.diagonal(state.covariance)[VELOCITY].max()) > 1.0
    assert state.velocity_sigma < 1e-6
    along = start.R_WB[:, 0]  # of the body's x axis
    unsure = np.zeros(IMU_SIZE)
    unsure[VELOCITY] = 0.03 * along
    state = FilterState(replace(start, covariance=0.04 * np.outer(turn, turn) + np.outer(unsure, unsure)), ONE)
    assert state.velocity_sigma == pytest.approx(0.03, rel=1e-6)


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
    before = FilterState(state.snapshot(), ONE)
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
    state.add_clone(7, OMEGA)
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


ALL = Estimated(time_offset=True, extrinsics=True, intrinsics=True)


def test_the_calibration_is_known_as_well_as_it_is_said_to_be():
    """Time offset, then camera by camera pose and lens; an update moves each by its own part of the correction."""
    state = filter_state(rig=STEREO)
    state.dt_cam_imu = 0.1
    P = np.array(state.covariance)
    sigmas = 0.01 * np.arange(1.0, 30.0)
    state.estimate_calibration(ALL, np.diag(sigmas**2))
    state.add_prior_error(np.zeros(6), np.zeros((6, 6)), np.eye(6))
    moved(state).add_clone(0, OMEGA)
    assert (state.time_offset, state.cameras, state.calibration) == (slice(15, 16), slice(16, 44), slice(15, 44))
    assert (state.prior_error, state.clone(0)) == (slice(44, 50), slice(50, 56))
    assert state.seen_columns.tolist() == [*range(16, 44), *range(50, 56)]
    np.testing.assert_allclose(state.covariance[15:44, 15:44], np.diag(sigmas**2))
    assert not state.covariance[15:44, :15].any()
    assert (np.diagonal(state.covariance)[9:15] >= np.diagonal(P)[9:15]).all()
    d = 0.001 * np.arange(1.0, 30.0)
    state.update(np.eye(29), np.r_[state.calibration], d, 1e-14 * np.eye(29))
    assert state.dt_cam_imu == pytest.approx(0.101, abs=1e-8)
    for c in range(2):
        own = d[1 + 14 * c : 15 + 14 * c]
        np.testing.assert_allclose(rotvec(STEREO.R_BC[c].T @ state.rig.R_BC[c]), own[:3], atol=1e-6)
        np.testing.assert_allclose(state.rig.p_BC[c] - STEREO.p_BC[c], own[3:6], atol=1e-6)
        intrinsics = state.rig.cameras[c].intrinsics - STEREO.cameras[c].intrinsics
        np.testing.assert_allclose(intrinsics, own[6:], atol=1e-6)


@pytest.mark.parametrize(
    ("estimated", "sizes"),
    [
        (Estimated(), (0, 0)),
        (Estimated(time_offset=True), (1, 0)),
        (Estimated(extrinsics=True), (0, 12)),
        (Estimated(intrinsics=True), (0, 16)),
        (Estimated(time_offset=True, intrinsics=True), (1, 16)),
    ],
)
def test_only_what_is_estimated_has_a_place(estimated, sizes):
    state = filter_state(rig=STEREO)
    config = CalibrationConfig(time_sigma=0.5, rotation_sigma=0.1, position_sigma=0.2, distortion_sigma=0.03)
    sigmas = estimated.sigmas(config, 2)
    state.estimate_calibration(estimated, np.diag(sigmas**2))
    lengths = [x.stop - x.start for x in (state.time_offset, state.cameras)]
    assert tuple(lengths) == sizes
    assert state.size == 15 + sum(sizes) == state.clone_start
    expected = {"time": [0.5], "pose": [0.1] * 3 + [0.2] * 3, "lens": [2.5] * 4 + [0.03] * 4}
    camera = expected["pose"] * estimated.extrinsics + expected["lens"] * estimated.intrinsics
    assert sigmas.tolist() == expected["time"] * estimated.time_offset + camera * 2
    rig = state.rig
    state.update(np.eye(3), np.arange(3), np.full(3, 0.1), np.eye(3))
    assert (rig is state.rig) == (estimated.camera_size == 0)


def test_a_clone_depends_on_when_its_image_was_taken():
    """Against a body that goes on as it does: turning by omega in its own frame, moving by v."""
    state = filter_state()
    state.estimate_calibration(Estimated(time_offset=True), np.array([[0.02**2]]))
    moved(state)
    P, R, p, v = np.array(state.covariance), state.R_WB.copy(), state.p_WB.copy(), state.v_WB.copy()
    state.add_clone(0, OMEGA)
    J = np.zeros((6, 16))
    J[:, :6] = np.eye(6)

    def pose(late):
        return R @ Rotation.from_rotvec(late[0] * OMEGA).as_matrix(), p + late[0] * v

    def local(x, y):
        return np.concatenate([rotvec(x[0].T @ y[0]), y[1] - x[1]])

    by_offset = state.covariance[16:22, 15] - P[:6, 15]  # J P J^T with P_tt known
    J[:, 15] = by_offset / P[15, 15]
    assert_jacobian(pose, np.zeros(1), J[:, 15:], local=local)
    np.testing.assert_allclose(state.covariance[16:22, :16], J @ P, atol=1e-14)
    np.testing.assert_allclose(state.covariance[16:22, 16:22], J @ P @ J.T, atol=1e-14)
    # What tells the offset moves the clone, and not the body: the pose at the frame's IMU time stays.
    before = state.clones.p_WB[0].copy(), state.p_WB.copy(), state.clones.R_WB[0].copy()
    state._P[:15, 15] = state._P[15, :15] = 0.0
    state.update(np.eye(1), np.array([15]), np.array([0.01]), np.array([[1e-14]]))
    assert state.dt_cam_imu == pytest.approx(0.01)
    np.testing.assert_allclose(state.clones.p_WB[0] - before[0], 0.01 * v, atol=1e-7)
    np.testing.assert_allclose(rotvec(before[2].T @ state.clones.R_WB[0]), 0.01 * OMEGA, atol=1e-7)
    np.testing.assert_array_equal(state.p_WB, before[1])


def test_a_clones_dependence_on_time_is_taken_at_the_first_estimate():
    state = filter_state()
    state.estimate_calibration(Estimated(time_offset=True), np.array([[0.02**2]]))
    moved(state)
    v_first = state.v_WB.copy()
    state.update(np.eye(3), np.r_[VELOCITY], np.full(3, 0.01), 1e-12 * np.eye(3))
    P = np.array(state.covariance)
    state.add_clone(0, OMEGA)
    np.testing.assert_allclose(state.covariance[19:22, 15], P[3:6, 15] + v_first * P[15, 15], atol=1e-15)


def test_states_put_in_between_border_the_covariance():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((8, 20))
    P = A @ A.T
    for at in (0, 3, 6):
        new = np.r_[at, at + 1]
        old = np.setdiff1d(np.arange(8), new)
        P_old, rows, corner = P[np.ix_(old, old)], P[np.ix_(new, old)], P[np.ix_(new, new)]
        skew = np.array([[0.0, 1.0], [-1.0, 0.0]])  # of the corner only the symmetric part is a covariance
        np.testing.assert_allclose(_bordered(P_old, rows, corner + skew, at), P, atol=1e-15)


def sparse(state, seed=0):
    """Row blocks (N, q, m) by columns (N, m) that overlap, and the same as one matrix."""
    rng = np.random.default_rng(seed)
    N, q, m = 5, 2, 7
    columns = np.stack([rng.permutation(state.size)[:m] for _ in range(N)])
    H = rng.standard_normal((N, q, m))
    dense = np.zeros((N, q, state.size))
    for n in range(N):
        dense[n][:, columns[n]] = H[n]
    return H, columns, dense.reshape(N * q, -1)


def test_a_sparse_update_is_the_dense_one():
    state, other = with_window(), with_window()
    H, columns, dense = sparse(state)
    HP, HPH = state.seen_through(H, columns)
    np.testing.assert_allclose(HP, dense @ state.covariance, atol=1e-15)
    np.testing.assert_allclose(HPH, dense @ state.covariance @ dense.T, atol=1e-14)
    r, noise = 0.1 * np.random.default_rng(1).standard_normal(10), 1e-4 * np.eye(10)
    state.correct(HP, HPH + noise, r)
    other.update(dense, np.arange(other.size), r, noise)
    np.testing.assert_allclose(state.covariance, other.covariance, atol=1e-13)
    assert np.abs(state.p_WB - with_window().p_WB).max() > 1e-3
    for name in ("R_WB", "p_WB", "v_WB", "b_g", "b_a", "c"):
        np.testing.assert_allclose(getattr(state, name), getattr(other, name), atol=1e-12)
    np.testing.assert_allclose(state.clones.p_WB, other.clones.p_WB, atol=1e-12)


def landmarks(keys, state):
    n = len(keys)
    p_AF = np.column_stack([np.full(n, 4.0), np.arange(n), np.ones(n)])
    anchors = np.full(n, state.clones.t_ns[-1])
    return Landmarks.at(np.array(keys), anchors, np.tile([0.1, 0.0, 0.0], (n, 1)), p_AF)


def with_landmarks(n=3):
    state, rng = with_window(), np.random.default_rng(3)
    by_seen = 0.1 * rng.standard_normal((3 * n, len(state.seen_columns)))
    state.add_landmarks(landmarks(range(10, 10 + n), state), by_seen, 1e-3 * np.eye(3 * n))
    return state


def test_landmarks_join_behind_everything_else():
    state, rng = with_window(), np.random.default_rng(3)
    by_seen = 0.1 * rng.standard_normal((9, 18))
    J = np.eye(state.size + 9, state.size)
    J[state.size :, state.clone_start :] = by_seen
    expected = J @ state.covariance @ J.T
    expected[-9:, -9:] += 1e-3 * np.eye(9)
    state = with_landmarks()
    np.testing.assert_allclose(state.covariance, expected, atol=1e-14)
    assert state.landmarks.keys.tolist() == [10, 11, 12]
    assert state.landmark_columns(np.array([2, 0])).tolist() == [45, 46, 47, 39, 40, 41]
    state.add_clone(9, OMEGA)  # clones go in before them
    np.testing.assert_allclose(state.covariance[-9:, -9:], expected[-9:, -9:], atol=1e-14)
    np.testing.assert_allclose(state.covariance[-9:, state.clone(3)], expected[-9:, :6], atol=1e-14)


def test_an_update_moves_landmarks_by_their_part():
    state = with_landmarks()
    y = state.landmarks.y.copy()
    d = 0.01 * np.arange(1.0, 10.0)
    state.update(np.eye(9), state.landmark_columns(np.arange(3)), d, 1e-14 * np.eye(9))
    np.testing.assert_allclose(state.landmarks.y - y, d.reshape(3, 3), atol=1e-8)


def test_dropping_landmarks_drops_their_rows_only():
    state = with_landmarks()
    keep = np.r_[: state.clone_stop, state.landmark_columns(np.array([0, 2]))]
    expected = state.covariance[np.ix_(keep, keep)]
    state.drop_landmarks(np.array([False, True, False]))
    np.testing.assert_array_equal(state.covariance, expected)
    assert state.landmarks.keys.tolist() == [10, 12]
    state.drop_landmarks(np.zeros(2, dtype=bool))
    assert state.size == len(expected)


def test_landmarks_described_otherwise_are_a_dense_change_of_states():
    state, rng = with_landmarks(), np.random.default_rng(4)
    mask = np.array([True, False, True])
    columns = np.stack([np.r_[state.clone(0), state.landmark_columns(np.array([k]))] for k in (0, 2)])
    J = rng.standard_normal((2, 3, 9))
    T = np.eye(state.size)
    for n, k in enumerate((0, 2)):
        own = state.landmark_columns(np.array([k]))
        T[own] = 0.0
        T[np.ix_(own, columns[n])] = J[n]
    expected = T @ state.covariance @ T.T
    new, old = landmarks([20, 22], state), state.landmarks
    new.y = new.y + 0.5
    state.move_landmarks(mask, new, J, columns)
    np.testing.assert_allclose(state.covariance, expected, atol=1e-13)
    np.testing.assert_array_equal(state.covariance, state.covariance.T)
    assert state.landmarks.keys.tolist() == [20, 11, 22]
    np.testing.assert_array_equal(state.landmarks.y, np.stack([new.y[0], old.y[1], new.y[1]]))


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
        state.add_clone(k, OMEGA)
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
    ("columns", "size", "anew"),
    [(VELOCITY, 0.8, False), (VELOCITY, 1.2, True), (THETA, 0.8, False), (THETA, 1.2, True)],
    ids=["slower", "faster", "less", "more"],
)
def test_first_estimates_are_given_up_after_a_large_correction_only(columns, size, anew):
    """0.01 rad, or 3 mm/s and a hundredth of the speed."""
    state = with_window()
    d = size * (0.01 if columns == THETA else 0.003 + 0.01 * np.linalg.norm(state.v_WB))
    state.update(np.eye(3), np.r_[columns], np.array([d, 0.0, 0.0]), 1e-12 * np.eye(3))
    first = (state.clones.R_first, state.clones.p_first)
    now = (state.clones.R_WB, state.clones.p_WB)
    assert np.abs(first[1] - now[1]).max() > 1e-4
    moved(state)
    for found, expected in zip(state.linearisation_clones, now if anew else first, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_nobody_else_changes_the_state():
    start = start_state()
    state = FilterState(start, ONE)
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
    zero = np.zeros((3, 3))
    state = continued(start, LastPose(0, 0, last, np.array([5.0, 6.0, 7.0]), 0.0, 0.0, zero), 30.0)
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

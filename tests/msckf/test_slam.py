"""Landmarks: made late, but as if they had been in the state from their first view; then corrected by one view each."""

import numpy as np
import pytest
from jacobians import assert_jacobian
from scipy.spatial.transform import Rotation

from msckf.config import CalibrationConfig, VisionConfig
from msckf.estimated import Estimated
from msckf.landmarks import Landmarks
from msckf.slam import _predict, add_landmarks, move_anchors, promotable, update_landmarks
from msckf.state import FilterState
from msckf.visual import by_calibration, linearise, measure
from navcore import so3
from navcore.frontend import Observations
from navcore.odometry import State
from tests.msckf import scenes

CONFIG = VisionConfig(pixel_noise=1.4)
K, F = 8, 12
E_Z = np.array([0.0, 0.0, 1.0])
NOTHING, EVERYTHING = Estimated(), Estimated(time_offset=True, extrinsics=True, intrinsics=True)
WHAT = pytest.mark.parametrize("what", [NOTHING, Estimated(extrinsics=True), EVERYTHING], ids=["none", "poses", "all"])
RIG = pytest.mark.parametrize("rig", [scenes.ONE, scenes.STEREO], ids=["one", "stereo"])


def window(seed=0, noise=CONFIG.pixel_noise, fej=True, sigma=(0.001, 0.005), what=NOTHING, rig=scenes.ONE, **depths):
    """A state whose clones are a scene's poses, each off by a draw of its covariance, and the scene's views."""
    views, R_WB, p_WB, p_WF = scenes.views(F=F, K=K, rig=rig, seed=seed, noise=noise, **depths)
    rng = np.random.default_rng(seed + 1)
    d = rng.standard_normal((K, 6)) * np.repeat(sigma, 3)
    zero = np.zeros(3)
    state = FilterState(State(R_WB[0], p_WB[0], zero, zero, zero, np.eye(15)), rig, fej=fej)
    state.estimate_calibration(what, np.diag((0.1 * what.sigmas(CalibrationConfig(), len(rig))) ** 2))
    for k in range(K):
        state.R_WB = R_WB[k] @ Rotation.from_rotvec(d[k, :3]).as_matrix()
        state.p_WB = p_WB[k] + d[k, 3:]
        state._keep_first_estimates()
        state.add_clone(1000 * k, zero)
    first = state.clone_start
    A = np.random.default_rng(9).standard_normal((6 * K, 12 * K)) / np.sqrt(12 * K)
    scale = np.tile(np.repeat(sigma, 3), K)
    state._P[first:, :first] = state._P[:first, first:] = 0.0
    state._P[first:, first:] = A @ A.T * np.outer(scale, scale)
    return state, views, p_WF


def shaken(state, size=0.01):
    """Updates have moved the window, each clone in its own way, since its first estimates."""
    d = np.random.default_rng(5).standard_normal((len(state.clones), 6)) * size
    state.clones.R_first = state.clones.R_WB @ so3.exp(d[:, :3])
    state.clones.p_first = state.clones.p_WB + d[:, 3:]
    return state


def measured(state, views):
    columns = state.seen_columns
    P = state.covariance[np.ix_(columns, columns)]
    clones = state.clones
    return measure(views, clones.R_WB, clones.p_WB, *state.linearisation_clones, P, CONFIG, state.estimated)


def add(state, views, m, rows):
    """Landmarks of the features `rows` (U,) behind a measurement, numbered as in the scene."""
    keys, cameras = np.flatnonzero(m.used)[rows], views.cameras[views.last[m.used]][rows]
    add_landmarks(state, keys, cameras, m, rows, CONFIG.pixel_noise)


def with_landmarks(n=4, **scene):
    """A state with the first `n` usable features of a window as landmarks; the scene's views and its points (F, 3)."""
    state, views, p_WF = window(**scene)
    m = measured(state, views)
    assert m.used.sum() >= n
    add(state, views, m, np.arange(int(m.used.sum())) < n)
    state.update(m.H, state.seen_columns, m.r, CONFIG.pixel_noise**2 * np.eye(len(m.r)))
    return state, views, p_WF


def in_world(landmarks, clones):
    """(L, 3) where landmarks are, given (t_ns, R_WB, p_WB) of the clones."""
    t_ns, R_WB, p_WB = clones
    k = [t_ns.tolist().index(t) for t in landmarks.anchors.tolist()]
    return p_WB[k] + np.einsum("nij,nj->ni", R_WB[k], landmarks.p_AF)


def now(state):
    return state.clones.t_ns, state.clones.R_WB, state.clones.p_WB


def test_a_landmark_by_its_three_numbers():
    rng = np.random.default_rng(0)
    p_AF, origins = 3.0 * rng.standard_normal((5, 3)), 0.1 * rng.standard_normal((5, 3))
    landmarks = Landmarks.at(np.arange(5), np.zeros(5, dtype=np.int64), origins, p_AF)
    np.testing.assert_allclose(landmarks.p_AF, p_AF, atol=1e-12)
    np.testing.assert_array_equal(landmarks.y[:, :2], 0.0)
    np.testing.assert_allclose(landmarks.y[:, 2], 1.0 / np.linalg.norm(p_AF - origins, axis=1))
    landmarks.y = landmarks.y + 0.05 * rng.standard_normal((5, 3))
    for k in range(5):
        one = landmarks.rows(np.arange(5) == k)

        def point(y, one=one):
            return Landmarks(one.keys, one.anchors, one.origins, one.frames, y[None]).p_AF[0]

        assert_jacobian(point, one.y[0], one.by_y[0])


@WHAT
@RIG
@pytest.mark.parametrize("fej", [True, False])
def test_delayed_initialisation_is_least_squares_over_clones_and_landmarks(rig, what, fej):
    """One set of normal equations that know nothing of the points but their views; then y by point and anchor."""
    state, views, _ = window(what=what, rig=rig, fej=fej)
    m = measured(state, views)
    rows = np.isin(np.arange(int(m.used.sum())), [0, 2, 3])
    n, U, clones = int(rows.sum()), int(m.used.sum()), slice(state.clone_start, state.clone_stop)
    R_lin, p_lin = state.linearisation_clones
    used = views.rows(m.used)
    r, H_x, H_f, p_linear = linearise(used, state.clones.R_WB, state.clones.p_WB, R_lin, p_lin, m.points.p_WF)
    H_c = by_calibration(used, H_f, R_lin, p_lin, p_linear, what).reshape(*r.shape, -1)
    size = state.size + 3 * U
    H = np.zeros((*r.shape, size))
    for f, v in np.ndindex(r.shape[:2]):
        first = clones.start + 6 * (v // len(rig))
        H[f, v][:, state.cameras] = H_c[f, v]
        H[f, v][:, first : first + 6] = H_x[f, v]
        H[f, v][:, state.size + 3 * f : state.size + 3 * f + 3] = H_f[f, v]
    H = H.reshape(r.size, size) / CONFIG.pixel_noise
    information = H.T @ H
    information[: state.size, : state.size] += np.linalg.inv(state.covariance)
    P = np.linalg.inv(information)
    dx = P @ H.T @ r.ravel() / CONFIG.pixel_noise

    p_before, R_before = state.clones.p_WB.copy(), state.clones.R_WB.copy()
    add(state, views, m, rows)
    at_start = state.landmarks.p_AF.copy(), state.landmarks.by_y.copy()
    state.update(m.H, state.seen_columns, m.r, CONFIG.pixel_noise**2 * np.eye(len(m.r)))
    T = np.zeros((state.size, size))  # from clones and points to clones and y
    T[: state.clone_stop, : state.clone_stop] = np.eye(state.clone_stop)
    anchor = state.clone(K - 1)
    for i, f in enumerate(np.flatnonzero(rows).tolist()):
        own = slice(state.clone_stop + 3 * i, state.clone_stop + 3 * i + 3)
        to_y = np.linalg.inv(R_lin[-1] @ at_start[1][i])
        p_AF = (m.points.p_WF[f] - p_before[-1]) @ R_before[-1]
        T[own, state.clone_stop + 3 * f : state.clone_stop + 3 * f + 3] = to_y
        T[own, anchor] = to_y @ np.hstack([R_lin[-1] @ so3.hat(p_AF), -np.eye(3)])
    sigma = np.sqrt(np.diagonal(state.covariance))
    off = (state.covariance - T @ P @ T.T) / np.outer(sigma, sigma)
    assert np.abs(off).max() < 1e-5
    by_clone = dx[clones].reshape(K, 6)
    np.testing.assert_allclose(state.clones.p_WB - p_before, by_clone[:, 3:], atol=1e-6)
    moved = in_world(state.landmarks, now(state)) - m.points.p_WF[rows]  # to first order in the step
    expected = dx[state.clone_stop :].reshape(-1, 3)[rows]
    assert n == len(moved)
    np.testing.assert_allclose(moved, expected, atol=0.02 * np.abs(expected).max())


@RIG
def test_landmarks_are_where_their_covariance_says(rig):
    """NEES over many windows of three numbers in the anchor's frame, with poses as good as known."""
    values = []
    for seed in range(60):
        state, _, p_WF = with_landmarks(seed=seed, sigma=(1e-5, 1e-5), rig=rig)
        e = np.linalg.solve(
            state.landmarks.by_y,
            ((p_WF[state.landmarks.keys] - in_world(state.landmarks, now(state))) @ state.clones.R_WB[-1])[..., None],
        )[..., 0]
        for k in range(len(e)):
            at = state.landmark_columns(np.array([k]))
            values.append(e[k] @ np.linalg.solve(state.covariance[np.ix_(at, at)], e[k]))
    assert np.mean(values) / 3.0 == pytest.approx(1.0, abs=0.2)


def directions(R_WB, p_WB):
    """Errors of poses (K, ...) when the world moves by x, y, z or turns about z: (K, 6, 4)."""
    N = np.zeros((len(R_WB), 6, 4))
    N[:, 3:, :3], N[:, :3, 3], N[:, 3:, 3] = np.eye(3), R_WB[:, 2], p_WB @ so3.hat(E_Z).T
    return N


@WHAT
@RIG
def test_a_new_landmark_does_not_turn_with_the_world(rig, what):
    """The world moves clone and anchor together: y stays, at the points of linearisation. So nothing has to be kept."""
    state, views, _ = window(rig=rig, what=what)
    shaken(state)
    m = measured(state, views)
    by = []
    state.add_landmarks = lambda landmarks, by_seen, covariance: by.append(by_seen)
    add(state, views, m, np.ones(int(m.used.sum()), dtype=bool))
    N = directions(*state.linearisation_clones).reshape(-1, 4)
    along = by[0][:, -6 * K :] @ N
    turned = by[0][:, -6 * K :] @ (N * np.tile([0.0, 0.0, 0.0, 1.0, 1.0, 1.0], K)[:, None])  # what is no symmetry
    assert np.abs(turned).max() > 0.05
    assert np.abs(along).max() < 1e-9


def test_only_what_is_well_known_is_kept():
    state, views, _ = window(noise=0.3)
    assert promotable(measured(state, views), CONFIG).all()
    state, views, _ = window(noise=0.3, near=40.0, far=80.0)
    assert not promotable(measured(state, views), CONFIG).any()
    state, views, _ = window(noise=0.3)
    m = measured(state, views)
    m.points.rms[2] = 3.1 * CONFIG.pixel_noise
    assert promotable(m, CONFIG).tolist() == [f != 2 for f in range(len(m.points.rms))]


def seen_now(views, keys, shift=0.0):
    """What the newest clone saw of the features `keys`, through every camera."""
    C = len(views.rig)
    which, cameras = [], []
    for c in range(C):
        own = keys[views.seen[keys, c - C]]
        which, cameras = [*which, *own], [*cameras, *[c] * len(own)]
    which, cameras = np.array(which, dtype=np.int64), np.array(cameras, dtype=np.int64)
    uv = views.uv[which, cameras - C] + shift
    return Observations(which, cameras, uv, views.rig.unproject(cameras, uv))


@WHAT
@RIG
@pytest.mark.parametrize("newest", [False, True], ids=["elsewhere", "in the newest"])
@pytest.mark.parametrize("fej", [True, False])
def test_the_jacobian_of_a_view(fej, newest, rig, what):
    """By the camera, the anchor, the newest clone and y; where both clones are one, their columns add up."""
    state, views, _ = with_landmarks(fej=fej, what=what, rig=rig)
    shaken(state)
    if not newest:
        state.landmarks.anchors = np.full(4, state.clones.t_ns[3])
    keys = state.landmarks.keys
    seen = seen_now(views, keys)
    which = np.searchsorted(keys, seen.keys)
    r, H, columns, depth = _predict(state, which, seen.cameras, seen.uv)
    N = len(which)
    assert r.shape == (N, 2)
    assert (depth > 0.0).all()
    assert {1: 4, 2: 6}[len(rig)] == N
    dense = np.zeros((N, 2, state.size))
    for n in range(N):
        np.add.at(dense[n].T, columns[n], H[n].T)
    linear = state.linearisation_clones

    def pixels(x):
        rig, R, p, landmarks = x
        p_WF = in_world(landmarks, (state.clones.t_ns, R, p))
        out = []
        for i, c in zip(which.tolist(), seen.cameras.tolist(), strict=True):
            p_BF = R[-1].T @ (p_WF[i] - p[-1])
            out.append(rig.cameras[c].project(rig.R_BC[c].T @ (p_BF - rig.p_BC[c])))
        return np.concatenate(out)

    def moved(x, d):
        rig, R, p, old = x
        if what.camera_size:
            own = d[state.cameras].reshape(len(rig), -1)
            rig = rig.sits_elsewhere(own[:, :6])
            rig = rig.projects_otherwise(own[:, 6:]) if what.intrinsics else rig
        clones = d[state.clone_start : state.clone_stop].reshape(-1, 6)
        R = R @ Rotation.from_rotvec(clones[:, :3]).as_matrix()
        y = old.y + d[state.clone_stop :].reshape(-1, 3)
        return rig, R, p + clones[:, 3:], Landmarks(old.keys, old.anchors, old.origins, old.frames, y)

    assert_jacobian(pixels, (state.rig, *linear, state.landmarks), dense.reshape(2 * N, -1), moved)
    at = pixels((state.rig, state.clones.R_WB, state.clones.p_WB, state.landmarks))
    np.testing.assert_allclose(r.ravel(), seen.uv.ravel() - at, atol=1e-9)


@RIG
def test_a_view_says_nothing_of_where_the_world_is(rig):
    """Whatever the first estimates are: y stands at its current value and has no part in the four directions."""
    state, views, _ = with_landmarks(rig=rig)
    shaken(state)
    state.landmarks.anchors = np.full(4, state.clones.t_ns[2])
    state.landmarks.y = state.landmarks.y + 0.02
    seen = seen_now(views, state.landmarks.keys)
    _, H, columns, _ = _predict(state, np.searchsorted(state.landmarks.keys, seen.keys), seen.cameras, seen.uv)
    N = np.zeros((state.size, 4))
    N[state.clone_start : state.clone_stop] = directions(*state.linearisation_clones).reshape(-1, 4)
    assert np.abs(H @ N[columns]).max() < 1e-9 * np.abs(H).max()


@RIG
@pytest.mark.parametrize("fej", [True, False])
def test_moving_to_another_anchor_changes_no_estimate(rig, fej):
    """The same points; P as by the dense change of states, whose Jacobian is that of differences."""
    state, _, _ = with_landmarks(rig=rig, fej=fej)
    shaken(state)
    state.landmarks.anchors = state.clones.t_ns[[0, K - 1, 0, 4]]
    state.landmarks.y = state.landmarks.y + 0.02
    before, P, old = in_world(state.landmarks, now(state)), np.array(state.covariance), state.landmarks
    where = state.landmark_columns(np.array([0, 2]))
    move_anchors(state, 0)
    new = state.landmarks
    assert new.anchors.tolist() == state.clones.t_ns[[K - 1, K - 1, K - 1, 4]].tolist()
    np.testing.assert_allclose(in_world(new, now(state)), before, atol=1e-12)
    np.testing.assert_array_equal(new.y[[1, 3]], old.y[[1, 3]])
    np.testing.assert_array_equal(new.origins, old.origins)
    np.testing.assert_allclose(new.y[[0, 2], :2], 0.0, atol=1e-15)

    T = np.eye(state.size)
    T[where] = 0.0
    R_lin, p_lin = state.linearisation_clones
    both = np.r_[state.clone(0), state.clone(K - 1)]
    for i in (0, 2):
        own, leaves = state.landmark_columns(np.array([i])), np.arange(4) == i

        def point(x, leaves=leaves):
            one = old.rows(leaves)
            R_0, p_0, R_1, p_1, y = x
            p_AF = Landmarks(one.keys, one.anchors, one.origins, one.frames, y[None]).p_AF[0]
            return R_1.T @ (R_0 @ p_AF + p_0 - p_1)

        def moved(x, d):
            R_0, p_0, R_1, p_1, y = x
            R_0, R_1 = (R @ Rotation.from_rotvec(w).as_matrix() for R, w in ((R_0, d[:3]), (R_1, d[6:9])))
            return R_0, p_0 + d[3:6], R_1, p_1 + d[9:12], y + d[12:]

        by_point = np.empty((3, 15))
        x = (R_lin[0], p_lin[0], R_lin[-1], p_lin[-1], old.y[i])
        for k in range(15):
            d = 1e-6 * np.eye(15)[k]
            by_point[:, k] = (point(moved(x, d)) - point(moved(x, -d))) / 2e-6
        T[np.ix_(own, np.r_[both, own])] = np.linalg.solve(new.by_y[i], by_point)
    expected = T @ P @ T.T
    sigma = np.sqrt(np.diagonal(expected))
    assert np.abs((state.covariance - expected) / np.outer(sigma, sigma)).max() < 1e-6
    N = directions(*state.linearisation_clones).reshape(-1, 4)
    world = np.zeros((state.size, 4))
    world[state.clone_start : state.clone_stop] = N
    assert np.abs((T @ world)[where]).max() < 1e-6  # y stays where the world moves


def test_nothing_is_moved_where_nothing_is_anchored():
    state, _, _ = with_landmarks()
    P, landmarks = state.covariance, state.landmarks
    move_anchors(state, 0)
    assert state.landmarks is landmarks
    np.testing.assert_array_equal(state.covariance, P)


@RIG
def test_views_of_landmarks_correct_as_one_dense_update(rig):
    state, views, _ = with_landmarks(rig=rig)
    other, _, _ = with_landmarks(rig=rig)
    seen = seen_now(views, state.landmarks.keys)
    which = np.searchsorted(state.landmarks.keys, seen.keys)
    r, H, columns, _ = _predict(other, which, seen.cameras, seen.uv)
    dense = np.zeros((len(which), 2, other.size))
    for n in range(len(which)):
        np.add.at(dense[n].T, columns[n], H[n].T)
    outcome = update_landmarks(state, seen, CONFIG)
    assert (outcome.used, outcome.rejected) == (len(which), 0)
    noise = CONFIG.pixel_noise**2 * np.eye(2 * len(which))
    other.update(dense.reshape(2 * len(which), -1), np.arange(other.size), r.ravel(), noise)
    np.testing.assert_allclose(state.covariance, other.covariance, atol=1e-12)
    np.testing.assert_allclose(state.landmarks.y, other.landmarks.y, atol=1e-10)
    np.testing.assert_allclose(state.clones.p_WB, other.clones.p_WB, atol=1e-12)


def test_landmarks_that_are_not_seen_leave_the_state():
    state, views, _ = with_landmarks()
    keys = state.landmarks.keys
    P = state.covariance[np.ix_(state.landmark_columns(np.array([1, 3])), state.landmark_columns(np.array([1, 3])))]
    seen = seen_now(views, keys[[1, 3]])
    outcome = update_landmarks(state, seen.rows(np.array([1, 0])), CONFIG)  # in any order
    assert state.landmarks.keys.tolist() == keys[[1, 3]].tolist()
    assert (outcome.used, outcome.rejected) == (2, 0)
    after = state.covariance[state.clone_stop :, state.clone_stop :]
    assert (np.diagonal(after) <= np.diagonal(P) + 1e-15).all()
    update_landmarks(state, seen_now(views, keys[:0]), CONFIG)
    assert len(state.landmarks) == 0
    assert state.size == state.clone_stop


def test_a_view_that_does_not_fit_is_refused_and_its_landmark_ends():
    state, views, _ = with_landmarks(noise=0.2)
    keys = state.landmarks.keys
    wrong = np.zeros((4, 2))
    wrong[2] = [30.0, 0.0]
    before = np.delete(in_world(state.landmarks, now(state)), 2, axis=0)
    outcome = update_landmarks(state, seen_now(views, keys, wrong), CONFIG)
    assert (outcome.used, outcome.rejected) == (3, 1)
    assert state.landmarks.keys.tolist() == np.delete(keys, 2).tolist()
    assert np.abs(in_world(state.landmarks, now(state)) - before).max() < 0.05
    assert outcome.dof.tolist() == [2.0] * 4
    assert outcome.nis[2] > 100.0


def test_one_camera_that_does_not_fit_costs_the_other_its_landmark_too():
    """A mismatch between the images of a pair is seen by one camera's view alone; the feature is not to be trusted."""
    state, views, _ = with_landmarks(noise=0.2, rig=scenes.STEREO)
    keys = state.landmarks.keys
    seen = seen_now(views, keys)
    both = next(int(key) for key in keys if (seen.keys == key).sum() == 2)
    wrong = (seen.keys == both) & (seen.cameras == 1)
    seen.uv[wrong] += [30.0, 0.0]
    outcome = update_landmarks(state, seen, CONFIG)
    assert (outcome.used, outcome.rejected) == (len(seen) - 1, 1)
    assert state.landmarks.keys.tolist() == [k for k in keys.tolist() if k != both]


def test_a_landmark_that_turns_out_to_be_infinitely_far_ends():
    state, views, _ = with_landmarks()
    keys = state.landmarks.keys
    state.landmarks.y[1, 2] = 0.5 / CONFIG.max_landmark_depth
    update_landmarks(state, seen_now(views, keys), VisionConfig(pixel_noise=1e3))
    assert state.landmarks.keys.tolist() == np.delete(keys, 1).tolist()

"""Landmarks: made late, but as if they had been in the state from their first view; then corrected by one view each."""

import numpy as np
import pytest
from jacobians import assert_jacobian
from scipy.spatial.transform import Rotation

from msckf.config import VisionConfig
from msckf.frontend import Observations
from msckf.slam import add_landmarks, promotable, update_landmarks
from msckf.state import FilterState
from msckf.visual import by_extrinsics, linearise, measure
from navcore import so3
from navcore.odometry import State
from tests.msckf import scenes

CONFIG = VisionConfig(pixel_noise=1.4)
K = 8


def window(seed=0, noise=CONFIG.pixel_noise, fej=True, sigma=(0.001, 0.005), extrinsics=False, **depths):
    """A state whose clones are a scene's poses, each off by a draw of its covariance, and the scene's views."""
    views, R_WB, p_WB, p_WF = scenes.views(F=10, K=K, seed=seed, noise=noise, **depths)
    rng = np.random.default_rng(seed + 1)
    d = rng.standard_normal((K, 6)) * np.repeat(sigma, 3)
    zero = np.zeros(3)
    state = FilterState(State(R_WB[0], p_WB[0], zero, zero, zero, np.eye(15)), fej=fej)
    if extrinsics:
        state.estimate_extrinsics(views.rig, 0.01, 0.02)
    for k in range(K):
        state.R_WB = R_WB[k] @ Rotation.from_rotvec(d[k, :3]).as_matrix()
        state.p_WB = p_WB[k] + d[k, 3:]
        state._keep_first_estimates()
        state.add_clone(k)
    first = state.clone_start
    A = np.random.default_rng(9).standard_normal((6 * K, 12 * K)) / np.sqrt(12 * K)
    scale = np.tile(np.repeat(sigma, 3), K)
    state._P[first:, :first] = state._P[:first, first:] = 0.0
    state._P[first:, first:] = A @ A.T * np.outer(scale, scale)
    return state, views, p_WF


def measured(state, views):
    columns = state.seen_columns
    P = state.covariance[np.ix_(columns, columns)]
    poses = (state.clones.R_WB, state.clones.p_WB, *state.linearisation_clones)
    return measure(views, *poses, P, CONFIG, extrinsics=state.rig is not None)


def with_landmarks(n=4, **scene):
    """A state with the first `n` features of a window as landmarks."""
    state, views, p_WF = window(**scene)
    m = measured(state, views)
    rows = np.zeros(int(m.used.sum()), dtype=bool)
    rows[:n] = True
    add_landmarks(state, np.arange(10)[m.used][:n], m, rows, CONFIG)
    state.update(m.H, state.seen_columns, m.r, CONFIG.pixel_noise**2 * np.eye(len(m.r)))
    return state, views, p_WF[m.used][:n]


@pytest.mark.parametrize("extrinsics", [False, True])
def test_delayed_initialisation_is_least_squares_over_clones_and_landmarks(extrinsics):
    """One set of normal equations in which nothing is known of the landmarks but their views."""
    state, views, _ = window(extrinsics=extrinsics)
    m = measured(state, views)
    rows = np.arange(10)[m.used] < 4
    n, clones = int(rows.sum()), slice(state.clone_start, state.clone_stop)
    R_lin, p_lin = state.linearisation_clones
    poses = (state.clones.R_WB, state.clones.p_WB, R_lin, p_lin)
    r, H_x, H_f, p_linear = linearise(views.rows(m.used), *poses, m.points.p_WF)
    H_e = by_extrinsics(views.rows(m.used), H_f, R_lin, p_lin, p_linear).reshape(*r.shape, 6)
    size = state.size + 3 * len(r)
    H = np.zeros((*r.shape, size))
    for f in range(len(r)):
        for k in range(K):
            if extrinsics:
                H[f, k][:, state.extrinsics] = H_e[f, k]
            H[f, k][:, clones.start + 6 * k : clones.start + 6 * k + 6] = H_x[f, k]
            H[f, k][:, state.size + 3 * f : state.size + 3 * f + 3] = H_f[f, k]
    H = H.reshape(r.size, size) / CONFIG.pixel_noise
    information = H.T @ H
    information[: state.size, : state.size] += np.linalg.inv(state.covariance)
    P = np.linalg.inv(information)
    dx = P @ H.T @ r.ravel() / CONFIG.pixel_noise

    p_before = state.clones.p_WB.copy()
    add_landmarks(state, np.arange(n), m, rows, CONFIG)
    state.update(m.H, state.seen_columns, m.r, CONFIG.pixel_noise**2 * np.eye(len(m.r)))
    keep = np.r_[: state.clone_stop, state.clone_stop + (3 * np.flatnonzero(rows)[:, None] + np.arange(3)).ravel()]
    sigma = np.sqrt(np.diagonal(state.covariance))
    off = (state.covariance - P[np.ix_(keep, keep)]) / np.outer(sigma, sigma)
    assert np.abs(off).max() < 1e-6
    dx = dx[keep]
    by_clone = dx[clones].reshape(K, 6)
    np.testing.assert_allclose(state.clones.p_WB - p_before, by_clone[:, 3:], atol=1e-6)
    np.testing.assert_allclose(
        state.landmarks.p_WF - m.points.p_WF[rows], dx[state.clone_stop :].reshape(-1, 3), atol=1e-5
    )


def test_landmarks_are_where_their_covariance_says():
    """NEES over many windows, three degrees a landmark."""
    values = []
    for seed in range(60):
        state, _, p_WF = with_landmarks(seed=seed, sigma=(1e-5, 1e-5))  # poses as good as known: no gauge to mind
        for k in range(len(p_WF)):
            at = state.landmark_columns(np.array([k]))
            e = p_WF[k] - state.landmarks.p_WF[k]
            values.append(e @ np.linalg.solve(state.covariance[np.ix_(at, at)], e))
    assert np.mean(values) / 3.0 == pytest.approx(1.0, abs=0.2)


def test_a_new_landmark_turns_with_the_world():
    """Its correlation with the clones carries position and yaw on, at the points of linearisation."""
    state, views, _ = window()
    state.clones.p_WB = state.clones.p_WB + 0.01  # first estimates differ from the present ones
    m = measured(state, views)
    by_clones = []
    state.add_landmarks = lambda keys, p_WF, p_first, by, covariance: by_clones.append((p_first, by))
    add_landmarks(state, np.arange(10)[m.used], m, np.ones(int(m.used.sum()), dtype=bool), CONFIG)
    ((p_first, by),) = by_clones
    e_z = so3.hat(np.array([0.0, 0.0, 1.0]))
    R_lin, p_lin = state.linearisation_clones
    N = np.zeros((K, 6, 4))
    N[:, 3:, :3], N[:, :3, 3], N[:, 3:, 3] = np.eye(3), R_lin[:, 2], p_lin @ e_z.T
    expected = np.concatenate([np.tile(np.eye(3), (len(p_first), 1)), (p_first @ e_z.T).reshape(-1, 1)], axis=1)
    np.testing.assert_allclose(by @ N.reshape(-1, 4), expected, atol=1e-8)


def test_only_what_is_well_known_is_kept():
    state, views, _ = window(noise=0.3)
    assert promotable(state, measured(state, views), CONFIG).all()
    state, views, _ = window(noise=0.3, near=40.0, far=80.0)
    assert not promotable(state, measured(state, views), CONFIG).any()
    state, views, _ = window(noise=0.3)
    state.clones.R_first = state.clones.R_first @ Rotation.from_rotvec([0.0, 0.1, 0.0]).as_matrix()
    assert not promotable(state, measured(state, views), CONFIG).any()


def seen_now(views, keys, shift=0.0):
    """What the newest clone saw of the features `keys`."""
    uv = views.uv[keys, -1] + shift
    return Observations(keys, views.cameras[keys], uv, views.rig.unproject(views.cameras[keys], uv))


@pytest.mark.parametrize("extrinsics", [False, True])
@pytest.mark.parametrize("fej", [True, False])
def test_the_jacobian_of_a_view(fej, extrinsics, monkeypatch):
    state, views, _ = with_landmarks(fej=fej, extrinsics=extrinsics)
    heard = {}
    monkeypatch.setattr(FilterState, "update", lambda self, H, columns, r, R: heard.update(H=H, at=columns, r=r, R=R))
    keys = state.landmarks.keys
    rig = state.rig or views.rig
    update_landmarks(state, rig, seen_now(views, keys), CONFIG)
    clone = range(*state.clone(K - 1).indices(state.size))
    extra = range(*state.extrinsics.indices(state.size))
    assert heard["at"].tolist() == [*extra, *clone, *range(state.clone_stop, state.size)]
    camera = rig.mounts[0].camera

    def pixels(x):
        R, p, features, R_BC, p_BC = x
        return np.concatenate([camera.project(R_BC.T @ (R.T @ (f - p) - p_BC)) for f in features])

    def moved(x, d):
        R, p, features, R_BC, p_BC = x
        if extrinsics:
            R_BC, p_BC, d = R_BC @ Rotation.from_rotvec(d[:3]).as_matrix(), p_BC + d[3:6], d[6:]
        turned = R @ Rotation.from_rotvec(d[:3]).as_matrix()
        return turned, p + d[3:6], features + d[6:].reshape(-1, 3), R_BC, p_BC

    R_lin, p_lin = state.linearisation_clones
    sits = (rig.R_BC[0], rig.p_BC[0])
    assert_jacobian(pixels, (R_lin[-1], p_lin[-1], state.linearisation_landmarks, *sits), heard["H"], moved)
    now = pixels((state.clones.R_WB[-1], state.clones.p_WB[-1], state.landmarks.p_WF, *sits))
    np.testing.assert_allclose(heard["r"], views.uv[keys, -1].ravel() - now, atol=1e-9)
    np.testing.assert_allclose(heard["R"], CONFIG.pixel_noise**2 * np.eye(8))


def test_landmarks_that_are_not_seen_leave_the_state():
    state, views, _ = with_landmarks()
    keys = state.landmarks.keys
    P = state.covariance[np.ix_(state.landmark_columns(np.array([1, 3])), state.landmark_columns(np.array([1, 3])))]
    outcome = update_landmarks(state, views.rig, seen_now(views, keys[[3, 1]]), CONFIG)
    assert state.landmarks.keys.tolist() == keys[[1, 3]].tolist()
    assert (outcome.used, outcome.rejected) == (2, 0)
    after = state.covariance[state.clone_stop :, state.clone_stop :]
    assert (np.diagonal(after) <= np.diagonal(P) + 1e-15).all()
    update_landmarks(state, views.rig, seen_now(views, keys[:0]), CONFIG)
    assert len(state.landmarks) == 0
    assert state.size == state.clone_stop


def test_a_view_that_does_not_fit_is_refused_and_its_landmark_ends():
    state, views, _ = with_landmarks(noise=0.2)
    keys = state.landmarks.keys
    wrong = np.zeros((4, 2))
    wrong[2] = [30.0, 0.0]
    p_before = np.delete(state.landmarks.p_WF, 2, axis=0)
    outcome = update_landmarks(state, views.rig, seen_now(views, keys, wrong), CONFIG)
    assert (outcome.used, outcome.rejected) == (3, 1)
    assert state.landmarks.keys.tolist() == np.delete(keys, 2).tolist()
    assert np.abs(state.landmarks.p_WF - p_before).max() < 0.05
    assert outcome.dof.tolist() == [2.0] * 4
    assert outcome.nis[2] > 100.0

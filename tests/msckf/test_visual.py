"""Vision as a measurement: its Jacobians, what is left when features are projected out, and its statistics."""

from dataclasses import replace

import numpy as np
import pytest
from jacobians import assert_jacobian
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from msckf.config import VisionConfig
from msckf.estimated import Estimated
from msckf.views import Rig, Views
from msckf.visual import (
    by_calibration,
    compress,
    linearise,
    measure,
    normalised_innovations,
    split,
)
from navcore.chi_square import chi_square_quantile
from tests.msckf import scenes

RIGS = {"radtan": scenes.ONE, "equidistant": Rig((scenes.mount(scenes.EQUIDISTANT),)), "stereo": scenes.STEREO}
NOTHING = Estimated()


@pytest.mark.parametrize("rig", RIGS)
def test_jacobians_by_pose_and_feature(rig):
    views, R_WB, p_WB, p_WF = scenes.views(F=4, K=5, rig=RIGS[rig])
    r, H_x, H_f, p_linear = linearise(views, R_WB, p_WB, R_WB, p_WB, p_WF)
    C = len(views.rig)
    assert r.shape == (4, 5 * C, 2)
    np.testing.assert_allclose(p_linear, p_WF, atol=1e-12)
    np.testing.assert_allclose(r, 0.0, atol=1e-9)
    seen = 0
    for f, v in np.argwhere(views.seen).tolist():
        k, m = v // C, views.rig.mounts[v % C]
        seen += 1

        def pixel(x, m=m):
            R, p, p_WF = x
            return m.camera.project(m.R_BC.T @ (R.T @ (p_WF - p) - m.p_BC))

        def moved(x, d):
            R, p, p_WF = x
            return R @ Rotation.from_rotvec(d[:3]).as_matrix(), p + d[3:6], p_WF + d[6:9]

        J = np.hstack([H_x[f, v], H_f[f, v]])
        assert_jacobian(pixel, (R_WB[k], p_WB[k], p_WF[f]), J, moved)
    assert seen == {1: 20, 2: 30}[C]


def nothing_else(r):
    """Derivatives of residuals (F, V, 2) by no other state, (F, 2 V, 0)."""
    return np.zeros((len(r), 2 * r.shape[1], 0))


def test_a_feature_seen_by_both_cameras_is_one_feature():
    """Four rows for each pose, of one point; a feature of one camera has none in the other's place."""
    views, R_WB, p_WB, p_WF = scenes.views(F=3, K=5, rig=scenes.STEREO, noise=1.0)
    assert views.seen.sum(axis=1).tolist() == [10, 5, 5]
    linear = linearise(views, R_WB, p_WB, R_WB, p_WB, p_WF)[:3]
    parts = split(views, *linear, nothing_else(linear[0]))
    for f, ranks in enumerate([(17, 3), (7, 3), (7, 3)]):
        assert np.linalg.matrix_rank(parts.R_1[f]) == ranks[1]
        basis = null_space(linear[2][f][views.seen[f]].reshape(-1, 3).T)
        assert basis.shape[1] == ranks[0]
    for c, f in ((0, 2), (1, 1)):  # what the camera does not see of the feature
        assert not any(x[f, c::2].any() for x in linear)
    m = measure(views, R_WB, p_WB, R_WB, p_WB, 1e-4 * np.eye(30), VisionConfig(), NOTHING)
    assert m.dof.tolist() == [17.0, 7.0, 7.0]
    # The second camera's rows alone, as a rig of its own, say what they say in stereo.
    alone = Views(Rig(views.rig.mounts[1:]), views.uv[2:, 1::2], views.seen[2:, 1::2])
    r, H_x, H_f, _ = linearise(alone, R_WB, p_WB, R_WB, p_WB, p_WF[2:])
    np.testing.assert_allclose(linear[0][2, 1::2], r[0], atol=1e-12)
    np.testing.assert_allclose(linear[1][2, 1::2], H_x[0], atol=1e-9)
    np.testing.assert_allclose(linear[2][2, 1::2], H_f[0], atol=1e-9)


def test_a_baseline_of_known_length_makes_the_scale_seen():
    """Poses and feature shrunk together show one camera the same; two cameras see that they are not where they were."""

    def along_scale(rig):
        views, R_WB, p_WB, p_WF = scenes.views(F=3, K=5, rig=rig)
        at_camera = p_WB + (R_WB @ rig.p_BC[0])  # the first camera's centre is what shrinks
        linear = linearise(views, R_WB, p_WB, R_WB, p_WB, p_WF)[:3]
        parts = split(views, *linear, nothing_else(linear[0]))
        d = np.zeros((5, 6))
        d[:, 3:] = at_camera - at_camera[0]
        return np.linalg.norm(parts.H[0] @ d.ravel())

    assert along_scale(scenes.ONE) < 1e-8
    assert along_scale(scenes.STEREO) > 5.0  # px


CALIBRATIONS = {
    "extrinsics": Estimated(extrinsics=True),
    "intrinsics": Estimated(intrinsics=True),
    "both": Estimated(time_offset=True, extrinsics=True, intrinsics=True),
}


@pytest.mark.parametrize("estimated", CALIBRATIONS)
@pytest.mark.parametrize("rig", RIGS)
def test_jacobians_by_the_calibration(rig, estimated):
    """Rotation local, on the right of R_BC; position in B; then the lens; of the other cameras nothing."""
    what, rig = CALIBRATIONS[estimated], RIGS[rig]
    views, R_WB, p_WB, p_WF = scenes.views(F=3, K=5, rig=rig)
    *_, H_f, p_linear = linearise(views, R_WB, p_WB, R_WB, p_WB, p_WF)
    H = by_calibration(views, H_f, R_WB, p_WB, p_linear, what)
    size = {"extrinsics": 6, "intrinsics": 8, "both": 14}[estimated]
    assert what.camera_size == size
    assert H.shape == (3, 10 * len(rig), size * len(rig))

    def pixels(rig):
        unseen = Views(rig, np.zeros_like(views.uv), views.seen)
        return -linearise(unseen, R_WB, p_WB, R_WB, p_WB, p_WF)[0].ravel()

    def otherwise(rig, d):
        d = d.reshape(len(rig), -1)
        cameras = rig.cameras
        if what.extrinsics:
            R_BC = rig.R_BC @ Rotation.from_rotvec(d[:, :3]).as_matrix()
            rig = replace(rig, poses=(R_BC, rig.p_BC + d[:, 3:6]))
        if what.intrinsics:
            rig = replace(rig, intrinsics=np.stack([c.intrinsics + x for c, x in zip(cameras, d[:, -8:], strict=True)]))
        return rig

    assert_jacobian(pixels, rig, H.reshape(-1, size * len(rig)), otherwise)
    if estimated == "both":
        d = 1e-3 * np.arange(14.0 * len(rig)).reshape(-1, 14)
        by_hand, moved = otherwise(rig, d), rig.sits_elsewhere(d[:, :6]).projects_otherwise(d[:, 6:])
        np.testing.assert_allclose(moved.R_BC, by_hand.R_BC, atol=1e-6)
        np.testing.assert_allclose(moved.p_BC, by_hand.p_BC, atol=1e-12)
        for camera, expected in zip(moved.cameras, by_hand.cameras, strict=True):
            np.testing.assert_allclose(camera.intrinsics, expected.intrinsics, atol=1e-12)


def test_the_calibrations_columns_come_before_the_poses():
    views, R_WB, p_WB, p_WF = scenes.views(F=3, K=5, rig=scenes.STEREO, noise=1.0)
    r, H_x, H_f, p_linear = linearise(views, R_WB, p_WB, R_WB, p_WB, p_WF)
    H_c = by_calibration(views, H_f, R_WB, p_WB, p_linear, Estimated(extrinsics=True))
    without, parts = split(views, r, H_x, H_f, nothing_else(r)), split(views, r, H_x, H_f, H_c)
    np.testing.assert_allclose(parts.H[..., 12:], without.H, atol=1e-12)
    Q = np.linalg.qr(H_f.reshape(3, 20, 3))[0]
    np.testing.assert_allclose(parts.H[..., :12], H_c - Q @ (np.swapaxes(Q, 1, 2) @ H_c), atol=1e-9)
    assert by_calibration(views, H_f, R_WB, p_WB, p_linear, Estimated(time_offset=True)).shape == (3, 20, 0)


def test_residuals_are_taken_at_the_estimate_and_jacobians_where_told():
    """Moving all linearisation poses as one body changes no image, so the feature has to move along."""
    views, R_WB, p_WB, p_WF = scenes.views(F=5, K=6, noise=1.0)
    turn, shift = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix(), np.array([0.4, 0.1, -0.2])
    R_lin, p_lin = turn @ R_WB, p_WB @ turn.T + shift
    r, H_x, H_f, p_linear = linearise(views, R_WB, p_WB, R_lin, p_lin, p_WF)
    np.testing.assert_allclose(p_linear, p_WF @ turn.T + shift, atol=1e-12)
    r_lin, H_x_lin, H_f_lin, _ = linearise(views, R_lin, p_lin, R_lin, p_lin, p_linear)
    np.testing.assert_allclose(r, r_lin, atol=1e-9)
    np.testing.assert_allclose(H_x, H_x_lin, atol=1e-8)
    np.testing.assert_allclose(H_f, H_f_lin, atol=1e-8)


def test_what_was_not_seen_says_nothing():
    views, R_WB, p_WB, p_WF = scenes.views(share_seen=0.5, noise=1.0)
    assert not views.seen.all()
    for array in linearise(views, R_WB, p_WB, R_WB, p_WB, p_WF)[:3]:
        assert not array[~views.seen].any()
        assert array[views.seen].any()


def linear_system(share_seen=0.6):
    views, R_WB, p_WB, p_WF = scenes.views(share_seen=share_seen, noise=1.0)
    rng = np.random.default_rng(2)
    A = rng.standard_normal((48, 60))
    return views, linearise(views, R_WB, p_WB, R_WB, p_WB, p_WF)[:3], 1e-5 * A @ A.T


def explicit(views, r, H_x, H_f, f):
    """Residual and Jacobian of one feature by a basis of the left null space."""
    seen = np.flatnonzero(views.seen[f])
    H = np.zeros((2 * len(seen), 6 * views.seen.shape[1]))
    for row, k in enumerate(seen):
        H[2 * row : 2 * row + 2, 6 * k : 6 * k + 6] = H_x[f, k]
    A = null_space(H_f[f, seen].reshape(-1, 3).T).T
    assert len(A) == 2 * len(seen) - 3
    return A @ r[f, seen].ravel(), A @ H


def test_projection_keeps_what_a_left_null_space_basis_keeps():
    views, (r, H_x, H_f), P = linear_system()
    parts = split(views, r, H_x, H_f, nothing_else(r))
    r_0, H_0 = parts.r, parts.H
    nis = normalised_innovations(r_0, H_0, P, pixel_noise=1.3)
    for f in range(len(r)):
        r_f, H = explicit(views, r, H_x, H_f, f)
        np.testing.assert_allclose(H_0[f].T @ H_0[f], H.T @ H, atol=1e-7)
        np.testing.assert_allclose(H_0[f].T @ r_0[f], H.T @ r_f, atol=1e-7)
        S = H @ P @ H.T + 1.3**2 * np.eye(len(H))
        assert nis[f] == pytest.approx(r_f @ np.linalg.solve(S, r_f), rel=1e-9)


def test_the_two_parts_of_a_split_hold_everything():
    """[H, 0; H_1, R_1] has the normal equations of all rows [H_x, H_f], feature by feature."""
    views, (r, H_x, H_f), _ = linear_system()
    parts = split(views, r, H_x, H_f, nothing_else(r))
    F, K = r.shape[:2]
    for f in range(F):
        whole = np.zeros((2 * K, 6 * K + 3))
        for k in range(K):
            whole[2 * k : 2 * k + 2, 6 * k : 6 * k + 6] = H_x[f, k]
        whole[:, 6 * K :] = H_f[f].reshape(-1, 3)
        apart = np.block([[parts.H[f], np.zeros((2 * K, 3))], [parts.H_1[f], parts.R_1[f]]])
        np.testing.assert_allclose(apart.T @ apart, whole.T @ whole, atol=1e-6)
        residual = np.concatenate([parts.r[f], parts.r_1[f]])
        np.testing.assert_allclose(apart.T @ residual, whole.T @ r[f].ravel(), atol=1e-6)
    some = parts.rows(np.arange(F) % 2 == 0)
    np.testing.assert_array_equal(some.R_1, parts.R_1[::2])
    np.testing.assert_array_equal(some.H, parts.H[::2])


def test_compression_keeps_the_information():
    rng = np.random.default_rng(0)
    H, r = rng.standard_normal((200, 30)), rng.standard_normal(200)
    r_small, H_small = compress(r, H)
    assert H_small.shape == (30, 30)
    np.testing.assert_allclose(H_small.T @ H_small, H.T @ H, atol=1e-10)
    np.testing.assert_allclose(H_small.T @ r_small, H.T @ r, atol=1e-10)
    r_same, H_same = compress(r[:20], H[:20])
    np.testing.assert_array_equal(H_same, H[:20])
    np.testing.assert_array_equal(r_same, r[:20])


def test_quantiles_are_scipys():
    dof = np.arange(1.0, 60.0)
    for probability in (0.5, 0.95, 0.99, 0.999):
        np.testing.assert_allclose(chi_square_quantile(probability, dof), chi2.ppf(probability, dof), rtol=1e-10)


def test_innovations_are_chi_square_with_the_stated_degrees():
    """Poses are off by draws from P, pixels by their noise: then r^T S^-1 r is chi-square, 2 views - 3 per feature."""
    K, total, dof = 8, 0.0, 0.0
    sigma = np.tile(np.repeat([0.002, 0.01], 3), K)
    config = VisionConfig(gate_probability=1.0 - 1e-12)
    shares = []
    for seed in range(30):
        views, R_WB, p_WB, _ = scenes.views(F=20, K=K, seed=seed, noise=1.0, share_seen=0.7)
        d = (sigma * np.random.default_rng(seed).standard_normal(6 * K)).reshape(K, 6)
        R_hat, p_hat = R_WB @ Rotation.from_rotvec(d[:, :3]).as_matrix(), p_WB + d[:, 3:]
        m = measure(views, R_hat, p_hat, R_hat, p_hat, np.diag(sigma**2), config, NOTHING)
        assert m.used.sum() >= 19  # nothing is refused for its innovation
        total, dof = total + m.nis.sum(), dof + m.dof.sum()
        shares.append((m.nis > chi2.ppf(0.95, m.dof)).mean())
    assert total / dof == pytest.approx(1.0, abs=0.05)
    assert np.mean(shares) == pytest.approx(0.05, abs=0.03)


def test_a_feature_that_moved_by_itself_is_refused():
    views, R_WB, p_WB, _ = scenes.views(noise=0.5)
    uv = views.uv.copy()
    uv[3, 4:] += [12.0, -9.0]
    cheated = Views(views.rig, uv, views.seen)
    m = measure(cheated, R_WB, p_WB, R_WB, p_WB, 1e-6 * np.eye(48), VisionConfig(), NOTHING)
    assert m.rejected.tolist() == [f == 3 for f in range(12)]
    assert m.used.tolist() == [f != 3 for f in range(12)]
    assert len(m.points.p_WF) == len(m.p_linear) == len(m.parts.r) == 11
    assert len(m.nis) == len(m.dof) == 12
    clean = measure(cheated.rows(~m.rejected), R_WB, p_WB, R_WB, p_WB, 1e-6 * np.eye(48), VisionConfig(), NOTHING)
    np.testing.assert_allclose(m.H.T @ m.H, clean.H.T @ clean.H, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(m.H.T @ m.r, clean.H.T @ clean.r, rtol=1e-6, atol=1e-6)


def test_nothing_seen_nothing_said():
    views, R_WB, p_WB, _ = scenes.views()
    none = views.rows(np.zeros(12, dtype=bool))
    m = measure(none, R_WB, p_WB, R_WB, p_WB, np.eye(48), VisionConfig(), NOTHING)
    assert len(m.used) == len(m.r) == 0
    behind = Views(views.rig, views.uv[:, ::-1], views.seen)  # parallax the wrong way
    m = measure(behind, R_WB, p_WB, R_WB, p_WB, np.eye(48), VisionConfig(), NOTHING)
    assert not m.used.any()

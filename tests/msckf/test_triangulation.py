"""Many features at once: exact where the views are, honest where they tell no distance."""

import numpy as np
import pytest
from jacobians import assert_jacobian

from msckf.config import VisionConfig
from msckf.triangulation import _ray_frames, _residuals, triangulate
from msckf.views import Views
from tests.msckf import scenes

CONFIG = VisionConfig()
TWO = (scenes.mount(scenes.RADTAN), scenes.mount(scenes.EQUIDISTANT))


@pytest.mark.parametrize("mounts", [TWO[:1], TWO[1:], TWO], ids=["radtan", "equidistant", "both"])
def test_residuals_by_direction_and_inverse_range(mounts):
    views, R_WB, p_WB, p_WF = scenes.views(F=5, K=6, mounts=mounts, share_seen=0.7)
    R_WC, p_WC = views.camera_poses(R_WB, p_WB)
    weight = views.seen.astype(float)
    R_WA, p_WA = R_WC[:, 2], p_WC[:, 2]
    R_CA = np.swapaxes(R_WC, -1, -2) @ R_WA[:, None]
    p_CA = (np.swapaxes(R_WC, -1, -2) @ (p_WA[:, None] - p_WC)[..., None])[..., 0]
    p_AF = (np.swapaxes(R_WA, -1, -2) @ (p_WF - p_WA)[..., None])[..., 0]
    x = np.concatenate([p_AF[:, :2], np.ones((5, 1))], axis=1) / p_AF[:, 2:]
    r, J = _residuals(views, weight, R_CA, p_CA, x)
    np.testing.assert_allclose(r, 0.0, atol=1e-8)
    for f in range(5):

        def predicted(x_f, f=f):
            moved = x.copy()
            moved[f] = x_f
            return -_residuals(views, weight, R_CA, p_CA, moved)[0][f].ravel()

        assert_jacobian(predicted, x[f], J[f].reshape(-1, 3))


@pytest.mark.parametrize("mounts", [TWO[:1], TWO[1:], TWO], ids=["radtan", "equidistant", "both"])
def test_exact_views_give_the_feature_back(mounts):
    views, R_WB, p_WB, p_WF = scenes.views(F=30, mounts=mounts, share_seen=0.7)
    points = triangulate(views, R_WB, p_WB, CONFIG)
    assert points.valid.all()
    assert points.certainty.min() > CONFIG.min_parallax
    np.testing.assert_allclose(points.p_WF, p_WF, atol=1e-4)
    assert points.rms.max() < 1e-3


def test_noise_moves_a_feature_as_far_as_its_least_squares_says():
    """No bias beyond the standard error, and an rms of sqrt((2 K - 3) / K) px: three numbers were fitted to 2 K."""
    errors, rms = [], []
    for seed in range(40):
        views, R_WB, p_WB, p_WF = scenes.views(F=20, K=10, noise=1.0, seed=1)
        noisy = np.random.default_rng(seed).standard_normal(views.uv.shape)
        clean = scenes.project(views.rig.mounts, views.cameras, R_WB, p_WB, p_WF)
        points = triangulate(Views(views.rig, views.cameras, clean + noisy, views.seen), R_WB, p_WB, CONFIG)
        assert points.valid.all()
        errors.append(points.p_WF - p_WF)
        rms.append(points.rms**2)
    mean, spread = np.mean(errors, axis=0), np.std(errors, axis=0)
    assert np.abs(mean / (spread / np.sqrt(40))).max() < 5.0
    assert np.mean(rms) == pytest.approx(2.0 - 3.0 / 10.0, rel=0.03)


def test_a_feature_without_parallax_is_put_far_out_along_its_ray():
    views, R_WB, p_WB, p_WF = scenes.views(F=10, noise=0.5, near=400.0, far=900.0)
    points = triangulate(views, R_WB, p_WB, CONFIG)
    assert points.valid.all()
    assert points.certainty.max() < CONFIG.min_parallax
    R_WC, p_WC = views.camera_poses(R_WB, p_WB)
    ray = (np.swapaxes(R_WC[:, -1], -1, -2) @ (points.p_WF - p_WC[:, -1])[..., None])[..., 0]
    true = (np.swapaxes(R_WC[:, -1], -1, -2) @ (p_WF - p_WC[:, -1])[..., None])[..., 0]
    np.testing.assert_allclose(np.linalg.norm(ray, axis=1), 1000.0, rtol=0.1)
    cosine = np.sum(ray * true, axis=1) / np.linalg.norm(ray, axis=1) / np.linalg.norm(true, axis=1)
    assert np.degrees(np.arccos(np.minimum(cosine, 1.0))).max() < 0.5


def test_what_cannot_be_a_feature_is_not_valid():
    views, R_WB, p_WB, _ = scenes.views(F=6)
    backwards = Views(views.rig, views.cameras, views.uv[:, ::-1], views.seen)  # rays meet behind the cameras
    points = triangulate(backwards, R_WB, p_WB, CONFIG)
    assert points.certainty.max() < CONFIG.min_parallax
    assert points.rms.min() > 10.0
    once = np.zeros_like(views.seen)
    once[:, 3] = True
    single = triangulate(Views(views.rig, views.cameras, views.uv, once), R_WB, p_WB, CONFIG)
    assert not single.valid.any()
    assert np.isfinite(single.p_WF).all()


def test_too_near_and_too_far_by_the_settings():
    views, R_WB, p_WB, _ = scenes.views(F=6, near=3.0, far=5.0)
    assert triangulate(views, R_WB, p_WB, CONFIG).valid.all()
    assert not triangulate(views, R_WB, p_WB, VisionConfig(max_depth=1.5)).valid.any()
    assert not triangulate(views, R_WB, p_WB, VisionConfig(min_depth=8.0)).valid.any()


def test_no_features_no_points():
    views, R_WB, p_WB, _ = scenes.views()
    points = triangulate(views.rows(np.zeros(12, dtype=bool)), R_WB, p_WB, CONFIG)
    assert [len(x) for x in (points.p_WF, points.valid, points.rms, points.certainty)] == [0, 0, 0, 0]


def test_ray_frames_end_in_their_rays():
    rays = np.random.default_rng(0).standard_normal((200, 3))
    rays = np.vstack([rays, np.eye(3), -np.eye(3)])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    frames = _ray_frames(rays)
    np.testing.assert_allclose(frames[..., 2], rays, atol=1e-15)
    np.testing.assert_allclose(frames @ np.swapaxes(frames, 1, 2), np.broadcast_to(np.eye(3), (206, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-12)

"""Many features at once: exact where the views are, honest where they tell no distance."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from msckf.bearings import across_and_along
from msckf.config import VisionConfig
from msckf.triangulation import triangulate
from msckf.views import Rig, Views
from tests.msckf import scenes

CONFIG = VisionConfig()
RIGS = {"radtan": scenes.ONE, "equidistant": Rig((scenes.mount(scenes.EQUIDISTANT),)), "stereo": scenes.STEREO}


@pytest.mark.parametrize("rig", RIGS)
def test_exact_views_give_the_feature_back(rig):
    views, R_WB, p_WB, p_WF = scenes.views(F=30, rig=RIGS[rig], share_seen=0.7)
    points = triangulate(views, R_WB, p_WB, CONFIG)
    assert points.valid.all()
    assert points.certainty.min() > CONFIG.min_parallax
    np.testing.assert_allclose(points.p_WF, p_WF, atol=1e-6)
    assert points.rms.max() < 1e-5


def test_a_feature_seen_by_both_cameras_once_has_a_place():
    """What one camera alone does not know: no motion, but a baseline."""
    views, R_WB, p_WB, p_WF = scenes.views(F=6, K=1, rig=scenes.STEREO)
    points = triangulate(views, R_WB, p_WB, CONFIG)
    assert points.valid.tolist() == [True, False, False, True, False, False]
    np.testing.assert_allclose(points.p_WF[points.valid], p_WF[points.valid], atol=1e-6)


@pytest.mark.parametrize("rig", RIGS)
def test_noisy_views_give_the_least_squares_of_their_angles(rig):
    """SciPy's minimum of how far, in pixels at the centre, each view lies beside the ray to the point."""
    views, R_WB, p_WB, p_WF = scenes.views(F=9, rig=RIGS[rig], share_seen=0.7, noise=1.0)
    points = triangulate(views, R_WB, p_WB, CONFIG)
    R_WC, p_WC = views.camera_poses(R_WB, p_WB)
    focal = np.array([camera.focal for camera in views.rig.cameras])[views.cameras]
    for f in range(9):
        v = np.flatnonzero(views.seen[f])

        def angles(p, f=f, v=v):
            p_CF = np.einsum("vji,vj->vi", R_WC[v], p - p_WC[v])
            return (focal[v, None] * np.cross(views.rays[f, v], p_CF / np.linalg.norm(p_CF, axis=1)[:, None])).ravel()

        best = least_squares(angles, p_WF[f], xtol=1e-14, ftol=1e-14, gtol=1e-14)
        assert points.rms[f] == pytest.approx(np.sqrt(2.0 * best.cost / len(v)), rel=1e-4)
        spread = np.sqrt(np.trace(np.linalg.inv(best.jac.T @ best.jac)))
        assert np.linalg.norm(points.p_WF[f] - best.x) < 0.05 * spread  # weights are those of the step before


def test_noise_moves_a_feature_as_far_as_its_least_squares_says():
    """No bias beyond the standard error, and an rms of sqrt((2 K - 3) / K) px: three numbers were fitted to 2 K."""
    errors, rms = [], []
    views, R_WB, p_WB, p_WF = scenes.views(F=20, K=10, seed=1)
    for seed in range(40):
        noisy = views.uv + np.random.default_rng(seed).standard_normal(views.uv.shape)
        points = triangulate(Views(views.rig, noisy, views.seen), R_WB, p_WB, CONFIG)
        assert points.valid.all()
        errors.append(points.p_WF - p_WF)
        rms.append(points.rms**2)
    mean, spread = np.mean(errors, axis=0), np.std(errors, axis=0)
    assert np.abs(mean / (spread / np.sqrt(40))).max() < 5.0
    scale = np.mean([np.linalg.norm(_per_pixel(views, R_WB, p_WB, p_WF, f)) for f in range(20)])  # angles, not pixels
    assert np.mean(rms) == pytest.approx((2.0 - 3.0 / 10.0) / scale**2, rel=0.03)


def _per_pixel(views, R_WB, p_WB, p_WF, f):
    """Pixels that a feature moves by for each pixel's angle at the centre of the image, rms over its views (1,)."""
    R_WC, p_WC = views.camera_poses(R_WB, p_WB)
    p_CF = np.einsum("vji,vj->vi", R_WC, p_WF[f] - p_WC)
    _, J = views.rig.project_jacobian(views.cameras, p_CF)
    gain = np.linalg.norm(J, axis=(1, 2)) * np.linalg.norm(p_CF, axis=1) / views.rig.cameras[0].focal
    return np.array([1.0 / np.sqrt(np.mean(2.0 / gain**2))])


def test_certainty_is_the_inverse_range_by_its_spread():
    views, R_WB, p_WB, p_WF = scenes.views(F=20, K=6, seed=2)
    _, p_WC = views.camera_poses(R_WB, p_WB)
    distance = np.linalg.norm(p_WF - p_WC[-1], axis=1)
    rho, certainty = [], []
    for seed in range(60):
        noisy = views.uv + np.random.default_rng(seed).standard_normal(views.uv.shape)
        points = triangulate(Views(views.rig, noisy, views.seen), R_WB, p_WB, CONFIG)
        rho.append(1.0 / np.linalg.norm(points.p_WF - p_WC[-1], axis=1))
        certainty.append(points.certainty)
    ratio = np.mean(certainty, axis=0) / (1.0 / distance / np.std(rho, axis=0))
    assert np.median(ratio) == pytest.approx(1.0, abs=0.1)
    assert ratio.min() > 0.6
    assert ratio.max() < 1.5


@pytest.mark.parametrize("rig", ["radtan", "stereo"])
def test_a_feature_without_parallax_is_put_far_out_along_its_ray(rig):
    views, R_WB, p_WB, p_WF = scenes.views(F=10, rig=RIGS[rig], noise=0.5, near=400.0, far=900.0)
    points = triangulate(views, R_WB, p_WB, CONFIG)
    assert points.valid.all()
    assert points.certainty.max() < CONFIG.min_parallax
    R_WC, p_WC = views.camera_poses(R_WB, p_WB)
    R_CW, last = np.swapaxes(R_WC[views.last], -1, -2), p_WC[views.last]
    ray = (R_CW @ (points.p_WF - last)[..., None])[..., 0]
    true = (R_CW @ (p_WF - last)[..., None])[..., 0]
    np.testing.assert_allclose(np.linalg.norm(ray, axis=1), 1000.0, rtol=0.1)
    cosine = np.sum(ray * true, axis=1) / np.linalg.norm(ray, axis=1) / np.linalg.norm(true, axis=1)
    assert np.degrees(np.arccos(np.minimum(cosine, 1.0))).max() < 0.5


def test_what_cannot_be_a_feature_is_not_valid():
    views, R_WB, p_WB, _ = scenes.views(F=6)
    backwards = Views(views.rig, views.uv[:, ::-1], views.seen)  # rays meet behind the cameras
    points = triangulate(backwards, R_WB, p_WB, CONFIG)
    assert points.certainty.max() < CONFIG.min_parallax
    assert points.rms.min() > 10.0
    once = np.zeros_like(views.seen)
    once[:, 3] = True
    single = triangulate(Views(views.rig, views.uv, once), R_WB, p_WB, CONFIG)
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
    frames = across_and_along(rays)
    np.testing.assert_allclose(frames[..., 2], rays, atol=1e-15)
    np.testing.assert_allclose(frames @ np.swapaxes(frames, 1, 2), np.broadcast_to(np.eye(3), (206, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-12)

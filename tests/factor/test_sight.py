"""Any lens as a cube of pinholes, and the factor of a feature."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X

from factor.config import WindowConfig
from factor.sight import Sides
from navcore.frontend import Observations
from tests.msckf.scenes import EQUIDISTANT, RADTAN, mount, poses

TWO = (mount(RADTAN), mount(EQUIDISTANT, right=0.12))


def observations(directions, camera):
    """What camera sees of points along directions (N, 3) in C."""
    bearings = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    n = len(bearings)
    return Observations(np.arange(n), np.full(n, camera), np.zeros((n, 2)), bearings)


@pytest.mark.parametrize("camera", [0, 1])
def test_every_direction_is_seen_through_the_side_that_it_is_nearest_to(camera):
    rng = np.random.default_rng(3)
    directions = rng.standard_normal((500, 3))
    directions = directions[directions[:, 2] > -0.5 * np.abs(directions).max(axis=1)]  # not behind
    sides = Sides(TWO, WindowConfig())
    seen = sides.see(observations(directions, camera))
    focal = TWO[camera].camera.focal
    assert np.abs(seen.points).max() <= focal + 1e-9
    for side, point, direction in zip(seen.sides, seen.points, seen.directions, strict=True):
        ray = sides._rig.at(int(side)).pose().rotation().matrix() @ [*(point / focal), 1.0]
        np.testing.assert_allclose(ray / np.linalg.norm(ray), direction, atol=1e-9)
    assert (seen.first == (camera == 0)).all()


def test_exact_views_of_both_cameras_fit_one_point():
    R_WB, p_WB = poses(K=4)
    p_WF = p_WB[2] + R_WB[2] @ [4.0, 0.5, -0.3]
    sides, values, views = Sides(TWO, WindowConfig()), gtsam.Values(), []
    for k, (R, p) in enumerate(zip(R_WB, p_WB, strict=True)):
        values.insert(X(k), gtsam.Pose3(gtsam.Rot3(R), p))
        for c, m in enumerate(TWO):
            in_camera = m.R_BC.T @ (R.T @ (p_WF - p) - m.p_BC)
            seen = sides.see(observations(in_camera[None], c))
            views += [view for _, view in seen.views(k)]
    sight = sides.sight(views, 3).factor
    found = sight.point(values)
    assert found.valid()
    np.testing.assert_allclose(found.get(), p_WF, atol=1e-6)
    assert sight.error(values) < 1e-12
    values.update(X(1), values.atPose3(X(1)).retract([0.0, 0.0, 0.0, 0.0, 0.02, 0.0]))
    assert sight.error(values) > 0.5


def test_the_size_of_a_pixel_there_is_that_of_the_lens():
    """Against bearings of neighbouring pixels, at the middle and towards the edge of both lenses."""
    sides = Sides(TWO, WindowConfig())
    for c, m in enumerate(TWO):
        for uv in ([250.0, 250.0], [420.0, 90.0]):
            corners = np.array([uv, [uv[0] + 1e-3, uv[1]], [uv[0], uv[1] + 1e-3]])
            seen = sides.see(observations(m.camera.unproject(corners), c))
            a, b = (seen.points[1:] - seen.points[0]) / 1e-3
            assert seen.stretch[0] == pytest.approx(np.sqrt(abs(a[0] * b[1] - a[1] * b[0])), rel=1e-3)

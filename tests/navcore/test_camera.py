import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jacobians import assert_jacobian

from navcore.camera import PinholeEquidistant, PinholeRadtan
from navcore.errors import DataError

RADTAN = PinholeRadtan(
    752, 480, 458.654, 457.296, 367.215, 248.375, (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05)
)
FISHEYE = PinholeEquidistant(
    512,
    512,
    190.97847715,
    190.97330705,
    254.93170605,
    256.89744289,
    (0.0034823894, 0.0007150348, -0.0020532361, 0.00020293673),
)
IDEAL = PinholeEquidistant(512, 512, 120.0, 120.0, 255.5, 255.5)
CAMERAS = pytest.mark.parametrize("camera", [RADTAN, FISHEYE, IDEAL], ids=["radtan", "fisheye", "ideal"])

UNIT = st.floats(0.0, 1.0)
DEPTHS = st.floats(0.1, 100.0)


def point(camera, right, down, distance):
    """A point (3,) that the camera sees at these shares of its picture."""
    uv = np.array([right * camera.width, down * camera.height]) - 0.5
    return distance * camera.unproject(uv)


@given(UNIT, UNIT, DEPTHS)
def test_radtan_is_opencvs(right, down, distance):
    p_CF = point(RADTAN, right, down, distance)
    K = np.array([[RADTAN.fx, 0.0, RADTAN.cx], [0.0, RADTAN.fy, RADTAN.cy], [0.0, 0.0, 1.0]])
    expected, _ = cv2.projectPoints(p_CF[None], np.zeros(3), np.zeros(3), K, np.array(RADTAN.distortion))
    np.testing.assert_allclose(RADTAN.project(p_CF), expected[0, 0], rtol=0.0, atol=1e-9)


@given(st.sampled_from([0.0, 1e-6, 5e-4, 9e-4]) | st.floats(-1.4, 1.4), st.floats(-np.pi, np.pi), DEPTHS)
def test_equidistant_is_opencvs_fisheye(theta, azimuth, distance):
    bearing = [np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)]
    p_CF = distance * np.array(bearing)
    K = np.array([[FISHEYE.fx, 0.0, FISHEYE.cx], [0.0, FISHEYE.fy, FISHEYE.cy], [0.0, 0.0, 1.0]])
    coefficients = np.array(FISHEYE.distortion)
    expected, _ = cv2.fisheye.projectPoints(p_CF[None, None], np.zeros(3), np.zeros(3), K, coefficients)
    np.testing.assert_allclose(FISHEYE.project(p_CF), expected[0, 0], rtol=0.0, atol=1e-8)


@CAMERAS
@given(right=UNIT, down=UNIT, distance=DEPTHS)
def test_project_inverts_unproject(camera, right, down, distance):
    uv = np.array([right * camera.width, down * camera.height]) - 0.5
    bearing = camera.unproject(uv)
    assert abs(np.linalg.norm(bearing) - 1.0) < 1e-12
    np.testing.assert_allclose(camera.project(distance * bearing), uv, rtol=0.0, atol=1e-8)


@CAMERAS
@given(right=UNIT, down=UNIT, distance=st.floats(0.5, 20.0))
def test_jacobian_against_differences(camera, right, down, distance):
    p_CF = point(camera, right, down, distance)
    uv, J = camera.project_jacobian(p_CF)
    np.testing.assert_array_equal(uv, camera.project(p_CF))
    assert_jacobian(camera.project, p_CF, J, rtol=1e-6, atol=1e-6)


@CAMERAS
@pytest.mark.parametrize("off_axis", [0.0, 1e-13, 1e-10, 1e-8, 1e-6, 1e-4])
def test_jacobian_on_and_near_the_axis(camera, off_axis):
    p_CF = 2.0 * np.array([off_axis, -off_axis, 1.0])
    assert_jacobian(camera.project, p_CF, camera.project_jacobian(p_CF)[1], rtol=1e-6, atol=1e-6)


@CAMERAS
@given(right=UNIT, down=UNIT, distance=st.floats(0.5, 20.0))
def test_jacobian_by_the_intrinsics(camera, right, down, distance):
    p_CF = point(camera, right, down, distance)

    def pixel(x):
        return camera.with_intrinsics(x).project(p_CF)

    np.testing.assert_array_equal(pixel(camera.intrinsics), camera.project(p_CF))
    # Pixels are linear in focal lengths, centre and coefficients, but for the product of the first and the last.
    assert_jacobian(pixel, camera.intrinsics, camera.by_intrinsics(p_CF), rtol=1e-6, atol=1e-6)


@CAMERAS
@pytest.mark.parametrize("off_axis", [0.0, 1e-13, 1e-8, 1e-4])
def test_jacobian_by_the_intrinsics_on_and_near_the_axis(camera, off_axis):
    p_CF = 2.0 * np.array([off_axis, -off_axis, 1.0])
    J = camera.by_intrinsics(p_CF)
    assert_jacobian(lambda x: camera.with_intrinsics(x).project(p_CF), camera.intrinsics, J, rtol=1e-6, atol=1e-6)


@CAMERAS
def test_other_intrinsics_change_nothing_else(camera):
    x = np.array([400.0, 401.0, 300.0, 200.0, 0.1, -0.2, 0.01, 0.02])
    other = camera.with_intrinsics(x)
    assert type(other) is type(camera)
    assert (other.width, other.height) == (camera.width, camera.height)
    np.testing.assert_array_equal(other.intrinsics, x)
    assert (other.fx, other.fy, other.cx, other.cy, other.distortion) == (
        400.0,
        401.0,
        300.0,
        200.0,
        (0.1, -0.2, 0.01, 0.02),
    )
    with pytest.raises(DataError):
        camera.with_intrinsics(-x)


@pytest.mark.parametrize("theta", [np.pi / 2 - 1e-9, np.pi / 2, 1.8, 2.2])
@pytest.mark.parametrize("azimuth", [0.0, 0.7, -2.5])
def test_fisheye_sees_beyond_a_right_angle(theta, azimuth):
    around = np.array([np.cos(azimuth), np.sin(azimuth)])
    p_CF = 3.0 * np.array([*np.sin(theta) * around, np.cos(theta)])
    expected = IDEAL.fx * theta * around + [IDEAL.cx, IDEAL.cy]  # r = f theta
    np.testing.assert_allclose(IDEAL.project(p_CF), expected, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(3.0 * IDEAL.unproject(expected), p_CF, rtol=0.0, atol=1e-9)
    assert_jacobian(FISHEYE.project, p_CF, FISHEYE.project_jacobian(p_CF)[1], rtol=1e-6, atol=1e-6)


@CAMERAS
def test_everything_in_the_picture_is_visible_and_nothing_else(camera):
    u, v = np.meshgrid(np.arange(0, camera.width, 37), np.arange(0, camera.height, 29))
    bearings = camera.unproject(np.stack([u, v], axis=-1).astype(float))
    assert camera.visible(bearings).all()
    outside = camera.unproject(np.array([[-2.0, 100.0], [100.0, camera.height + 1.0]]))
    assert not camera.visible(outside).any()


def test_points_behind_a_pinhole_are_not_visible():
    assert not RADTAN.visible(np.array([[0.0, 0.0, -1.0], [0.1, 0.0, 0.0]])).any()


def test_points_past_the_fold_of_the_distortion_are_not_visible():
    # k1 < 0 alone: r + k1 r^3 turns back at r = 1/sqrt(3 |k1|); far beyond, points land in the picture again.
    camera = PinholeRadtan(752, 480, 450.0, 450.0, 375.5, 239.5, (-0.3, 0.0, 0.0, 0.0))
    fold = 1.0 / np.sqrt(0.9)
    folded = np.array([fold * 1.7, 0.0, 1.0])
    assert camera.inside(camera.project(folded))
    assert not camera.visible(folded)


def test_the_border_of_the_picture_is_half_a_pixel_out():
    inside = RADTAN.inside(np.array([[-0.5, -0.5], [751.49, 479.49], [-0.51, 0.0], [0.0, 479.5]]))
    np.testing.assert_array_equal(inside, [True, True, False, False])


@CAMERAS
def test_batches_are_the_single_results(camera):
    points = np.random.default_rng(2).normal(size=(3, 4, 3))
    points[..., 2] += 4.0
    uv, J = camera.project_jacobian(points)
    assert uv.shape == (3, 4, 2)
    assert J.shape == (3, 4, 2, 3)
    for k in np.ndindex(3, 4):
        np.testing.assert_allclose(uv[k], camera.project(points[k]), rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(camera.unproject(uv)[k], camera.unproject(uv[k]), rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(
            camera.by_intrinsics(points)[k], camera.by_intrinsics(points[k]), rtol=0.0, atol=1e-12
        )
    assert camera.unproject(np.zeros((0, 2))).shape == (0, 3)
    assert camera.project(np.zeros((0, 3))).shape == (0, 2)
    assert camera.by_intrinsics(np.zeros((0, 3))).shape == (0, 2, 8)


@pytest.mark.parametrize("change", [{"width": 0}, {"fx": -1.0}, {"distortion": (0.0, 0.0)}])
def test_impossible_cameras_are_refused(change):
    good = {"width": 10, "height": 10, "fx": 5.0, "fy": 5.0, "cx": 4.5, "cy": 4.5}
    with pytest.raises(DataError):
        PinholeRadtan(**{**good, **change})

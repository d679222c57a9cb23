import numpy as np
import pytest

from navcore.calibration import CameraMount, camera_from_euroc, cameras_from_kalibr, imu_from_yaml
from navcore.camera import PinholeEquidistant, PinholeRadtan
from navcore.errors import DataError
from navcore.imu import ImuNoise

EUROC = """%YAML:1.0
# General sensor definitions.
T_BS:
  cols: 4
  rows: 4
  data: [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975,
         0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768,
        -0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
"""
KALIBR = """cam1:
  camera_model: pinhole
  distortion_model: radtan
  intrinsics: [190.0, 191.0, 250.0, 251.0]
  distortion_coeffs: [0.1, 0.2, 0.3, 0.4]
  resolution: [512, 500]
  T_cam_imu: [[0, 1, 0, 0.1], [-1, 0, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]]
cam0:
  camera_model: pinhole
  distortion_model: equidistant
  intrinsics: [180.0, 181.0, 240.0, 241.0]
  distortion_coeffs: [0.01, 0.02, 0.03, 0.04]
  resolution: [512, 500]
  T_cam_imu: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
  timeshift_cam_imu: -0.004
"""
NOISE = "gyroscope_noise_density: 1.0e-4\ngyroscope_random_walk: 2.0e-5\naccelerometer_noise_density: 3.0e-3\n"


def written(folder, text):
    path = folder / "sensor.yaml"
    path.write_text(text)
    return path


def test_a_camera_of_euroc(tmp_path):
    mount = camera_from_euroc(written(tmp_path, EUROC))
    coefficients = (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05)
    assert mount.camera == PinholeRadtan(752, 480, 458.654, 457.296, 367.215, 248.375, coefficients)
    np.testing.assert_array_equal(mount.p_BC, [-0.0216401454975, -0.064676986768, 0.00981073058949])
    np.testing.assert_allclose(mount.R_BC @ [0.0, 0.0, 1.0], [0.00414, 0.025716, 0.999661], atol=1e-6)
    assert mount.dt_cam_imu == 0.0


def test_cameras_of_kalibr_come_in_order_and_turned_round(tmp_path):
    first, second = cameras_from_kalibr(written(tmp_path, KALIBR))
    assert isinstance(first.camera, PinholeEquidistant)
    assert isinstance(second.camera, PinholeRadtan)
    assert (first.dt_cam_imu, second.dt_cam_imu) == (-0.004, 0.0)
    p_CB = np.array([0.1, 0.2, 0.3])
    R_CB = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(second.R_BC, R_CB.T, atol=1e-15)
    np.testing.assert_allclose(second.p_BC, -R_CB.T @ p_CB, atol=1e-15)


@pytest.mark.parametrize("rate", ["rate_hz: 100", "update_rate: 100.0"])
def test_noise_of_euroc_and_of_kalibr(tmp_path, rate):
    flat = NOISE + "accelerometer_random_walk: 4.0e-3\n" + rate + "\n"
    nested = "imu0:\n" + "".join(f"  {line}\n" for line in flat.splitlines())
    for text in (flat, nested):
        assert imu_from_yaml(written(tmp_path, text)) == ImuNoise(1e-4, 2e-5, 3e-3, 4e-3, 100.0, 0.1)


def test_what_vibration_leaves_is_read_where_it_is_said(tmp_path):
    text = NOISE + "accelerometer_random_walk: 4.0e-3\nvibration_share: 0.0\n"
    assert imu_from_yaml(written(tmp_path, text)).vibration_share == 0.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (EUROC.replace("pinhole", "omni"), r"camera \('omni', 'radial-tangential'\) is unknown; known are"),
        (EUROC.replace("resolution", "size"), "key 'resolution' is missing; present are"),
        (EUROC.replace(", 1.76187114e-05", ""), "distortion_coefficients has 3 numbers, expected 4"),
        (EUROC.replace("0.999557249008", "0.7"), "T_BC holds no rotation"),
        (EUROC.replace("[752, 480]", "[752]"), "resolution has 1 numbers, expected 2"),
        (EUROC.replace("[752, 480]", "[752, 0]"), "camera size and focal lengths must be positive"),
        (EUROC.replace("458.654", "wide"), "intrinsics is .*'wide'.*, expected 4 numbers"),
        (EUROC.replace("458.654", ".nan"), "intrinsics has 4 numbers, expected 4, all finite"),
        (EUROC.replace("0.0, 0.0, 0.0, 1.0]", "1.0]"), "data has 13 numbers, expected 16"),
        (EUROC.replace("T_BS:", "T_BS: 3\nother:"), "T_BS is 3, expected a mapping"),
        ("- 1\n- 2\n", "expected a YAML mapping, got list"),
        ("a: [1,\n", "not YAML"),
    ],
)
def test_a_wrong_camera_is_named(tmp_path, text, says):
    path = written(tmp_path, text)
    with pytest.raises(DataError, match=says) as error:
        camera_from_euroc(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (NOISE, "key 'accelerometer_random_walk' is missing"),
        (NOISE + "accelerometer_random_walk: -1.0", "accelerometer_random_walk is -1.0"),
        (
            NOISE + "accelerometer_random_walk: small",
            "accelerometer_random_walk is 'small', expected 1 numbers",
        ),
    ],
)
def test_wrong_noise_is_named(tmp_path, text, says):
    path = written(tmp_path, text)
    with pytest.raises(DataError, match=says) as error:
        imu_from_yaml(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("imu0: {}\n", "no camera"),
        ("cam0: here\n", "cam0 is 'here', expected the keys of a camera"),
        (KALIBR.replace("[0, 1, 0, 0]", "[0, 0, 0, 0]"), "T_cam_imu holds no rotation"),
        (KALIBR.replace("T_cam_imu", "T_imu_cam"), "key 'T_cam_imu' is missing"),
    ],
)
def test_a_wrong_chain_is_named(tmp_path, text, says):
    path = written(tmp_path, text)
    with pytest.raises(DataError, match=says) as error:
        cameras_from_kalibr(path)
    assert str(path) in str(error.value)


def test_poses_are_read_only():
    mount = CameraMount(PinholeRadtan(10, 10, 5.0, 5.0, 4.5, 4.5), np.eye(4))
    with pytest.raises(ValueError, match="read-only"):
        mount.T_BC[0, 3] = 1.0


@pytest.mark.parametrize("T_BC", [np.diag([1.0, 1.0, -1.0, 1.0]), 2.0 * np.eye(4), np.eye(3)])
def test_what_is_no_pose_is_refused(T_BC):
    with pytest.raises(DataError, match="T_BC"):
        CameraMount(PinholeRadtan(10, 10, 5.0, 5.0, 4.5, 4.5), T_BC)

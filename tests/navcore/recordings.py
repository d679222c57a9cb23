"""Small recordings, made for a test: a rig that turns about its vertical, IMU at 200 Hz, frames at 20."""

from pathlib import Path

import cv2
import numpy as np

from navcore import so3
from navcore.calibration import Calibration, CameraMount
from navcore.camera import PinholeRadtan
from navcore.imu import ImuNoise, ImuSamples
from navcore.sequence import Frame, ImageArray, Sequence
from navcore.trajectory import Trajectory

START_NS = 1_403_636_579_758_555_392  # too many digits for a float
IMU_STEP_NS = 5_000_000
FRAME_STEP_NS = 50_000_000
WIDTH, HEIGHT = 64, 48
IMU_HEADER = "#timestamp [ns],w_RS_S_x [rad s^-1],w_y,w_z,a_RS_S_x [m s^-2],a_y,a_z"
TRUTH_HEADER = "#timestamp, p_x [m], p_y, p_z, q_w [], q_x, q_y, q_z, v_x, v_y, v_z, b_w_x, y, z, b_a_x, y, z"

_CAMERA = """%YAML:1.0
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, {x}, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [{width}, {height}]
camera_model: pinhole
intrinsics: [50.0, 51.0, 31.5, 23.5]
distortion_model: radial-tangential
distortion_coefficients: [-0.1, 0.01, 0.001, -0.001]
"""
_IMU = """sensor_type: imu
T_BS:
  data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
rate_hz: 200
gyroscope_noise_density: 1.7e-4
gyroscope_random_walk: 2.0e-5
accelerometer_noise_density: 2.0e-3
accelerometer_random_walk: 3.0e-3
"""


def imu_rows(count: int = 201) -> list[list[str]]:
    """Rows of `imu0/data.csv`, as text."""
    wave = np.sin(0.1 * np.arange(count))
    return [[str(START_NS + k * IMU_STEP_NS), f"{w:.9f}", "0", "0.3", "0", "-0.1", "9.81"] for k, w in enumerate(wave)]


def truth_rows(count: int = 201, columns: int = 16) -> list[list[str]]:
    """Rows of truth, as text: a turn about the vertical, wxyz; biases of one device."""
    rows = []
    for k in range(count):
        half = 0.5 * 0.3 * k * 5e-3
        pose = [0.01 * k, 0.0, 1.0, np.cos(half), 0.0, 0.0, np.sin(half)]
        rest = [2.0, 0.0, 0.0, 0.001, -0.002, 0.003, 0.01, 0.02, -0.03]
        rows.append([str(START_NS + k * IMU_STEP_NS), *(f"{x:.9f}" for x in (*pose, *rest)[:columns])])
    return rows


def write_rows(path: Path, rows: list[list[str]], header: str | None = None) -> None:
    """A CSV, its folder made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [header] if header else []
    path.write_text("\n".join([*lines, *(",".join(row) for row in rows)]) + "\n")


def frame_stamps(count: int = 10) -> list[int]:
    """Stamps of frames, the first a while after the first IMU sample."""
    return [START_NS + 100_000_000 + k * FRAME_STEP_NS for k in range(count)]


def write_image(path: Path, width: int = WIDTH, height: int = HEIGHT, seed: int = 0) -> None:
    """A noisy grey image, its folder made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.random.default_rng(seed).integers(0, 255, (height, width), dtype=np.uint8))


def write_camera(folder: Path, stamps: list[int], x: float = 0.0, images: bool = True) -> None:
    """`sensor.yaml`, `data.csv` and images of one camera."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "sensor.yaml").write_text(_CAMERA.format(x=x, width=WIDTH, height=HEIGHT))
    write_rows(folder / "data.csv", [[str(t), f"{t}.png"] for t in stamps], "#timestamp [ns],filename")
    (folder / "data").mkdir(exist_ok=True)
    for k, t in enumerate(stamps if images else []):
        write_image(folder / "data" / f"{t}.png", seed=k)


def write_euroc(root: Path, cameras: int = 1, images: bool = True) -> Path:
    """A recording in EuRoC's layout of one second; returns `mav0`."""
    mav0 = root / "mav0"
    write_rows(mav0 / "imu0" / "data.csv", imu_rows(), IMU_HEADER)
    (mav0 / "imu0" / "sensor.yaml").write_text(_IMU)
    write_rows(mav0 / "state_groundtruth_estimate0" / "data.csv", truth_rows(), TRUTH_HEADER)
    for k in range(cameras):
        write_camera(mav0 / f"cam{k}", frame_stamps(), x=0.1 * k, images=images)
    return mav0


def sequence(biases: bool = True, frames: int = 10) -> Sequence:
    """A recording in memory: one second, standing still, with truth."""
    t_ns = START_NS + IMU_STEP_NS * np.arange(201)
    imu = ImuSamples(t_ns, np.zeros((201, 3)), np.tile([0.0, 0.0, 9.81], (201, 1)))
    q_WB = so3.to_quaternion(np.tile(np.eye(3), (201, 1, 1)))
    b = np.tile([0.001, 0.002, 0.003], (201, 1))
    known = (b, 10.0 * b) if biases else (None, None)
    truth = Trajectory(t_ns, q_WB, np.zeros((201, 3)), np.zeros((201, 3)), *known)
    image = ImageArray(np.zeros((HEIGHT, WIDTH), dtype=np.uint8))
    mount = CameraMount(PinholeRadtan(WIDTH, HEIGHT, 50.0, 50.0, 31.5, 23.5), np.eye(4), dt_cam_imu=0.005)
    noise = ImuNoise(1.7e-4, 2e-5, 2e-3, 3e-3)
    made = tuple(Frame(t, {0: image}) for t in frame_stamps(frames))
    return Sequence("still", Calibration(noise, (mount,)), imu, made, truth, ("a note",))

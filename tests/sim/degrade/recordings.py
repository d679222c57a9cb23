"""A small recording whose rig turns at a known rate before a textured view."""

import cv2
import numpy as np

from navcore.calibration import Calibration, CameraMount
from navcore.camera import PinholeRadtan
from navcore.imu import ImuNoise, ImuSamples
from navcore.sequence import Frame, ImageArray, Sequence
from sim.degrade import Schedule, degrade_sequence

START_NS = 1_403_636_579_758_555_392
WIDTH, HEIGHT, FOCAL = 192, 128, 150.0
RATE = 1.2  # rad/s about the camera's y: the image moves along x


def texture(seed: int = 1) -> np.ndarray:
    """(HEIGHT, WIDTH) smooth blobs of all sizes, grey 40 to 200, without noise."""
    rng = np.random.default_rng(seed)
    image = np.zeros((HEIGHT, WIDTH))
    for sigma in (2.0, 4.0, 10.0):
        layer = cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH)), (0, 0), sigma)
        image += layer / layer.std()
    return np.clip(120.0 + 25.0 * image, 40.0, 200.0).astype(np.uint8)


def turning(image: np.ndarray | None = None, frames: int = 60, rate: float = RATE, cameras: int = 2) -> Sequence:
    """Frames at 20 Hz that all show the same image; C is B."""
    t_ns = START_NS + 5_000_000 * np.arange(-20, frames * 10 + 20)
    imu = ImuSamples(t_ns, np.tile([0.0, rate, 0.0], (len(t_ns), 1)), np.tile([0.0, 9.81, 0.0], (len(t_ns), 1)))
    camera = PinholeRadtan(WIDTH, HEIGHT, FOCAL, FOCAL, 0.5 * (WIDTH - 1), 0.5 * (HEIGHT - 1))
    mounts = []
    for k in range(cameras):
        T_BC = np.eye(4)
        T_BC[0, 3] = 0.1 * k
        mounts.append(CameraMount(camera, T_BC))
    source = ImageArray(texture() if image is None else image)
    made = tuple(Frame(START_NS + 50_000_000 * k, dict.fromkeys(range(cameras), source)) for k in range(frames))
    return Sequence("turning", Calibration(ImuNoise(1e-4, 1e-5, 1e-3, 1e-4), tuple(mounts)), imu, made)


def degraded(sequence: Sequence, spec: str, index: int, camera: int = 0, seed: int = 1) -> np.ndarray:
    """One image of a recording that is degraded."""
    return degrade_sequence(sequence, Schedule.parse(spec), seed).frames[index].images[camera].load()


def all_degraded(sequence: Sequence, spec: str, indices: range, camera: int = 0, seed: int = 1) -> list[np.ndarray]:
    """Several of them."""
    frames = degrade_sequence(sequence, Schedule.parse(spec), seed).frames
    return [frames[k].images[camera].load() for k in indices]


def flat(grey: int) -> np.ndarray:
    """(HEIGHT, WIDTH) of one grey value."""
    return np.full((HEIGHT, WIDTH), grey, dtype=np.uint8)


def scatter(image: np.ndarray) -> float:
    """Standard deviation of white noise, from the differences of neighbours across the image's diagonal."""
    e = image.astype(float)
    return float(np.std(e[1:, 1:] - e[1:, :-1] - e[:-1, 1:] + e[:-1, :-1]) / 2.0)

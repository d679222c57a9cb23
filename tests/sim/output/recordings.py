"""A small recording whose every number has all its digits: noise, in memory."""

import hashlib
from pathlib import Path

import numpy as np

from navcore.calibration import Calibration, CameraMount
from navcore.camera import PinholeEquidistant, PinholeRadtan
from navcore.imu import ImuNoise, ImuSamples
from navcore.sequence import Frame, ImageArray, Sequence
from navcore.trajectory import Trajectory

START_NS = 1_403_636_579_758_555_392  # too many digits for a float
WIDTH, HEIGHT = 64, 48
NOISE = ImuNoise(1.7e-4, 2e-5, 2e-3, 3e-3, 200.0)


def noise_recording(cameras: int = 2, frames: int = 6, seed: int = 0) -> Sequence:
    """One second, of which the second camera lacks a frame and truth does not know the first velocity."""
    rng = np.random.default_rng(seed)
    t_ns = START_NS + 5_000_000 * np.arange(201) + rng.integers(0, 1000, 201)
    imu = ImuSamples(t_ns, rng.normal(size=(201, 3)), rng.normal(size=(201, 3)) * 1e-300)
    q_WB = rng.normal(size=(50, 4))
    q_WB /= np.linalg.norm(q_WB, axis=1, keepdims=True)
    v_WB, b_g, b_a = rng.normal(size=(3, 50, 3))
    v_WB[0] = np.nan
    truth = Trajectory(t_ns[:50] + 256, q_WB, rng.normal(size=(50, 3)), v_WB, b_g, b_a)
    made = []
    for k in range(frames if cameras else 0):
        seen = range(cameras if k != 3 else min(1, cameras))
        images = {c: ImageArray(rng.integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8)) for c in seen}
        made.append(Frame(START_NS + 100_000_123 + 50_000_000 * k, images))
    return Sequence("noise", Calibration(NOISE, mounts()[:cameras]), imu, tuple(made), truth)


def mounts() -> tuple[CameraMount, ...]:
    """Two different lenses, turned and late."""
    R_BC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    T_BC = np.eye(4)
    T_BC[:3, :3], T_BC[:3, 3] = R_BC, (0.06, 0.055, -0.015)
    radtan = PinholeRadtan(WIDTH, HEIGHT, 50.0, 51.0, 31.5, 23.5, (-0.28, 0.07, 1.9e-4, 1.8e-5))
    fisheye = PinholeEquidistant(WIDTH, HEIGHT, 30.0, 30.5, 31.0, 24.0, (0.003, 0.0007, -0.002, 0.0002))
    return CameraMount(radtan, T_BC, 0.0021, 30.0), CameraMount(fisheye, T_BC @ T_BC, 0.0021, 30.0)


def digest(folder: Path) -> dict[str, str]:
    """A hash of every file."""
    files = sorted(x for x in folder.rglob("*") if x.is_file())
    return {str(x.relative_to(folder)): hashlib.sha256(x.read_bytes()).hexdigest() for x in files}


def assert_same(got: Sequence, wanted: Sequence) -> None:
    """Every measurement and all of truth, to the last bit; the calibration to rounding."""
    np.testing.assert_array_equal(got.imu.t_ns, wanted.imu.t_ns)
    np.testing.assert_array_equal(got.imu.gyro, wanted.imu.gyro)
    np.testing.assert_array_equal(got.imu.accel, wanted.imu.accel)
    assert (got.truth is None) == (wanted.truth is None)
    for name in ("t_ns", "q_WB", "p_WB", "v_WB", "b_g", "b_a") if wanted.truth else ():
        np.testing.assert_array_equal(getattr(got.truth, name), getattr(wanted.truth, name), err_msg=name)
    assert [(f.t_ns, sorted(f.images)) for f in got.frames] == [(f.t_ns, sorted(f.images)) for f in wanted.frames]
    for one, other in zip(got.frames, wanted.frames, strict=True):
        for index in one.images:
            np.testing.assert_array_equal(one.images[index].load(), other.images[index].load())
    assert got.calibration.imu == wanted.calibration.imu
    for mount, expected in zip(got.calibration.cameras, wanted.calibration.cameras, strict=True):
        assert mount.camera == expected.camera
        assert (mount.dt_cam_imu, mount.rate_hz) == (expected.dt_cam_imu, expected.rate_hz)
        np.testing.assert_allclose(mount.T_BC, expected.T_BC, atol=1e-15)

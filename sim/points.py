"""Points mode: the flights and IMU of the simulator, with projected landmarks instead of images."""

import numpy as np

from navcore.arrays import Stamps
from navcore.sequence import Sequence
from sim.errors import ConfigError
from sim.imu import exact_imu, grade, simulate_imu
from sim.layout import furnished_room
from sim.motion import EPOCH_NS, Motion
from sim.platforms import simulate_motion
from sim.rig import euroc_like
from sim.schedule import Schedule
from sim.streams import Streams
from sim.tracks import Seeing, follow
from sim.view import View

LANDMARKS = 3000
FIRST_FRAME_S = 0.1013  # the frames lie between IMU samples, as on rigs without a common trigger
LAST_FRAME_MARGIN_S = 0.02  # the IMU goes on past the last frame
IMU_GRADE = "adis16448"


def simulate_points(
    platform: str = "quadrotor",
    seconds: float = 60.0,
    seed: int = 1,
    *,
    pixel_noise: float = 1.0,
    max_features: int = 150,
    track_life_s: float = 3.0,
    cameras: int = 1,
    noisy_imu: bool = True,
    moving_start: bool = False,
    blackouts: tuple[tuple[float, float], ...] = (),
    degrade: str = "",
    motion: Motion | None = None,
    noise_seed: int | None = None,
) -> Sequence:
    """A recording with tracks, and truth with biases at the IMU's stamps.

    Args:
        platform: which body moves.
        seconds: length of the recording.
        seed: fixes the motion, the world and, without `noise_seed`, all noise.
        pixel_noise: px, sd per axis.
        max_features: per image.
        track_life_s: mean time until a visible feature is lost by chance.
        cameras: 1 or 2; the second one sees the same features.
        noisy_imu: False gives exact samples without biases.
        moving_start: begin in full motion.
        blackouts: (start, end) seconds from the first frame in which nothing is seen.
        degrade: a schedule as `Schedule.parse` reads it.
        motion: one that was simulated before, instead of platform, seconds and moving_start.
        noise_seed: draws IMU and vision anew over the same motion and world.

    Raises:
        ConfigError: an unknown platform or degradation, or a value out of range.
    """
    wanted = Seeing(pixel_noise, max_features, track_life_s)
    schedule = Schedule.parse(degrade).with_blackouts(tuple(blackouts))
    if motion is None:
        motion = simulate_motion(platform, seconds, seed, moving_start)
    streams = Streams.of(seed, noise_seed)
    imu = grade(IMU_GRADE)
    calibration = euroc_like(imu.noise, cameras)
    samples, truth = simulate_imu(motion, imu, streams.imu) if noisy_imu else exact_imu(motion, imu.noise.rate_hz)
    points, normals = furnished_room(streams.world).landmarks(LANDMARKS, streams.world)
    stamps = frame_stamps(motion, calibration.cameras[0].rate_hz)
    view = View(calibration, points, normals, motion.at(stamps))
    frames = follow(view, wanted, schedule, streams.vision)
    return Sequence(f"{platform}-points-seed{seed}", calibration, samples, frames, truth)


def frame_stamps(motion: Motion, rate_hz: float) -> Stamps:
    """(N,) ns: when the cameras look."""
    n = int((motion.duration_s - FIRST_FRAME_S - LAST_FRAME_MARGIN_S) * rate_hz) + 1
    if n < 1:
        raise ConfigError(f"a motion of {motion.duration_s} s is too short for one frame")
    return EPOCH_NS + np.rint((FIRST_FRAME_S + np.arange(n) / rate_hz) * 1e9).astype(np.int64)

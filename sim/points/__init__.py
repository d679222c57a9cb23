"""Points mode: the flights and IMU of the simulator, with projected landmarks instead of images."""

import math
from pathlib import Path

import numpy as np

from navcore.arrays import Stamps
from navcore.sequence import Sequence
from sim.degrade.request import Request
from sim.degrade.stream import restream
from sim.errors import ConfigError
from sim.flights import flight
from sim.imu import exact_imu, grade, simulate_imu
from sim.motion import Motion
from sim.points.seeing import Seeing
from sim.points.tracks import tracks_along
from sim.rig import euroc_like
from sim.streams import Streams
from sim.world import check_scene

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
    outliers: float = 0.0,
    moving: float = 0.0,
    cameras: int = 1,
    noisy_imu: bool = True,
    moving_start: bool = False,
    blackouts: tuple[tuple[float, float], ...] = (),
    degrade: str = "",
    difficulty: str = "medium",
    imu: str = IMU_GRADE,
    scene: str = "room",
    motion: Motion | None = None,
    noise_seed: int | None = None,
    flights: Path | None = None,
) -> Sequence:
    """A recording with tracks, and truth with biases at the IMU's stamps.

    Args:
        platform: which body moves.
        seconds: length of the recording.
        seed: fixes the motion, the world and, without `noise_seed`, all noise.
        pixel_noise: px, sd per axis.
        max_features: per image.
        track_life_s: mean time until a visible feature is lost by chance.
        outliers: share of features that are mismatched: under their id they show another point, and jump.
        moving: share of features that sit on moving objects, several, near the camera.
        cameras: 1 or 2; the second one sees the same features.
        noisy_imu: False gives exact samples without biases.
        moving_start: begin in full motion.
        blackouts: (start, end) seconds from the first frame in which nothing is seen.
        degrade: what happens to vision, as `sim.degrade.Request.parse` reads it.
        difficulty: easy, medium or difficult motion.
        imu: its grade, as `sim.imu.grade` reads it.
        scene: what is around.
        motion: one that was simulated before, instead of platform, seconds and moving_start.
        noise_seed: draws IMU and vision anew over the same motion and world.
        flights: where motions are kept and found again (`sim.flights`); it changes no byte.

    Raises:
        ConfigError: an unknown platform, grade, scene or degradation, a degradation beyond the recording, or a
            value out of range.
    """
    wanted = Seeing(pixel_noise, max_features, track_life_s, outliers, moving)
    streams = Streams.of(seed, noise_seed)
    device = grade(imu)
    calibration = euroc_like(device.noise, cameras)
    check_scene(scene)
    frames_s = frame_seconds(seconds if motion is None else motion.duration_s, calibration.cameras[0].rate_hz)
    request = Request.parse(degrade)
    schedule = request.schedule(frames_s).with_blackouts(tuple(blackouts))
    schedule.check(frames_s)
    if motion is None:
        motion = flight(platform, seconds, seed, moving_start, difficulty, flights)
    rate_hz = device.noise.rate_hz
    samples, truth = simulate_imu(motion, device, streams.imu) if noisy_imu else exact_imu(motion, rate_hz)
    stamps = frame_stamps(motion, calibration.cameras[0].rate_hz)
    frames = restream(
        tracks_along(motion, calibration, stamps, scene, wanted, schedule, streams), schedule, request.seed(seed)
    )
    return Sequence(f"{platform}-points-seed{seed}", calibration, samples, frames, truth)


def frame_stamps(motion: Motion, rate_hz: float) -> Stamps:
    """(N,) ns: when the cameras look."""
    n = round(frame_seconds(motion.duration_s, rate_hz) * rate_hz) + 1
    return motion.start_ns + np.rint((FIRST_FRAME_S + np.arange(n) / rate_hz) * 1e9).astype(np.int64)


def frame_seconds(seconds: float, rate_hz: float) -> float:
    """From the first frame to the last, in a recording of so many seconds.

    Raises:
        ConfigError: there is not one frame.
    """
    if not FIRST_FRAME_S + LAST_FRAME_MARGIN_S <= seconds < math.inf:
        raise ConfigError(f"a motion of {seconds} s is too short for one frame, or endless")
    return int((seconds - FIRST_FRAME_S - LAST_FRAME_MARGIN_S) * rate_hz) / rate_hz

"""Recordings: a platform moves, and what its sensors say is written to a folder."""

from pathlib import Path
from typing import Literal

from sim import asl
from sim.film import Film, Progress
from sim.imu import grade, simulate_imu
from sim.motion import Motion
from sim.platforms import simulate_motion
from sim.points import IMU_GRADE, frame_stamps, simulate_points
from sim.rig import euroc_like
from sim.scene import room
from sim.schedule import Schedule
from sim.streams import Streams


def record(
    platform: str,
    seconds: float,
    seed: int,
    out: Path,
    *,
    degrade: str = "",
    mode: Literal["images", "points"] = "images",
    moving_start: bool = False,
    cameras: int = 1,
    progress: Progress | None = None,
) -> None:
    """Write a recording in EuRoC's layout. The same arguments give the same bytes; a failure leaves nothing
    behind.

    Args:
        platform: which body moves.
        seconds: length of the recording.
        seed: fixes everything that is random.
        out: the folder to make; it must be new or empty.
        degrade: what happens to vision, as `Schedule.parse` reads it.
        mode: rendered images, or tracks of landmarks.
        moving_start: begin in full motion instead of standing still.
        cameras: 1 or 2.
        progress: gets the number of images done and of all.

    Raises:
        ConfigError: an unknown platform or degradation, a value out of range, or `out` is not empty.
        RenderError: images are wanted and there is no OpenGL.
    """
    schedule = Schedule.parse(degrade)
    calibration = euroc_like(grade(IMU_GRADE).noise, cameras)
    with asl.new_folder(out) as partial:
        folder = partial / "mav0"
        motion = simulate_motion(platform, seconds, seed, moving_start)
        for index, mount in enumerate(calibration.cameras):
            asl.write_camera(folder, index, mount)
        if mode == "points":
            _write_points(folder, motion, seed, cameras, degrade)
            return
        streams = Streams.of(seed)
        samples, truth = simulate_imu(motion, grade(IMU_GRADE), streams.imu)
        asl.write_imu(folder, calibration.imu, samples)
        asl.write_truth(folder, truth)
        film = Film(motion, calibration, room(streams.world), schedule)
        stamps = frame_stamps(motion, calibration.cameras[0].rate_hz)
        film.shoot(folder, stamps, streams.vision, progress)


def _write_points(folder: Path, motion: Motion, seed: int, cameras: int, degrade: str) -> None:
    sequence = simulate_points(seed=seed, cameras=cameras, degrade=degrade, motion=motion)
    assert sequence.truth is not None
    asl.write_imu(folder, sequence.calibration.imu, sequence.imu)
    asl.write_truth(folder, sequence.truth)
    for index in range(cameras):
        asl.write_tracks(folder, index, list(sequence.frames))

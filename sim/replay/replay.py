"""A real recording with new eyes: its IMU as it is, its path smoothed, its images or tracks made anew."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from navcore.arrays import Stamps
from navcore.calibration import Calibration
from navcore.errors import DataError
from navcore.sequence import Sequence
from sim.camera import gl
from sim.camera.film import Film
from sim.degrade import Request, degrade_sequence
from sim.degrade.stream import restream
from sim.errors import ConfigError
from sim.points.seeing import Seeing
from sim.points.tracks import tracks_along
from sim.replay.smoothed import SmoothedTruth, smooth_truth
from sim.replay.stamps import open_recording, regular
from sim.streams import Streams
from sim.world import check_scene, make_scene

Vision = Literal["images", "points"]
"""Rendered images, or tracks of landmarks."""

_IMU_BEFORE_NS = 100_000_000  # of the samples before the first frame that a clip keeps


@contextmanager
def replayed(
    source: Path | Sequence,
    scene: str = "room",
    *,
    mode: Vision = "images",
    degrade: str = "",
    seed: int = 1,
    cameras: int = 1,
    start_s: float | None = None,
    end_s: float | None = None,
    movers: int = 0,
    switching: bool = False,
) -> Iterator[Sequence]:
    """A recording seen anew: images are rendered when they are loaded, as long as the context is open.

    IMU samples and calibration are the recording's own; only the offset between camera and IMU is gone, since
    frames are made at, and stamped in, the IMU's time. Truth is the path that they are seen from.

    Args:
        source: a recording with truth, or where it is.
        scene: what is built around the path.
        mode: see `Vision`; tracks need no OpenGL.
        degrade: what happens to vision, as `sim.degrade.Request.parse` reads it; times count from the first frame.
        seed: fixes the scene and all that is random in images.
        cameras: how many of the recording's cameras.
        start_s, end_s: only the part between, in seconds from the first frame whose pose is known.
        movers: how many things move through the scene on paths of their own.
        switching: the scene's lamps go out and on; both with images only.

    Raises:
        ConfigError: an unknown scene, mode or degradation, or more cameras than there are.
        DataError: the recording has a fault, no truth, or no frame in the part.
        RenderError: there is no OpenGL, or a camera that cannot be rendered.
    """
    request = Request.parse(degrade)
    recording, listed = open_recording(source)
    _check(recording, scene, cameras, seed, movers)
    if mode not in get_args(Vision):
        raise ConfigError(f"mode {mode!r} is unknown; known are {', '.join(get_args(Vision))}")
    if mode != "images" and (movers or switching):
        raise ConfigError(f"things that move and lamps that switch need images; mode is {mode!r}")
    if start_s is not None and end_s is not None and not start_s < end_s:
        raise ConfigError(f"the part begins at {start_s} s and ends at {end_s} s; expected start < end")
    if mode == "images":
        gl.make_context(16, 16).free()  # where there is none, that is said before anything is smoothed
    path = smooth_truth(recording)
    stamps, lost = _frames(recording, listed, path, start_s, end_s)
    schedule = request.schedule(float(stamps[-1] - stamps[0]) * 1e-9)
    imu = recording.imu
    if start_s is not None:
        imu = imu.between(int(stamps[0]) - _IMU_BEFORE_NS, int(imu.t_ns[-1]) + 1)
    mounts = tuple(replace(mount, dt_cam_imu=0.0) for mount in recording.calibration.cameras[:cameras])
    calibration = Calibration(recording.calibration.imu, mounts)
    streams = Streams.of(seed)
    notes = (*recording.notes, *path.notes, *lost)
    if mode == "points":
        tracks = tracks_along(path.motion, calibration, stamps, scene, Seeing(), schedule, streams)
        frames = restream(tracks, schedule, request.seed(seed))
        yield Sequence(f"{recording.name}-points-seed{seed}", calibration, imu, frames, path.truth, notes)
        return
    world = make_scene(scene, path.motion, streams.world, movers, switching)
    with Film(path.motion, calibration, world, stamps, schedule.in_camera, streams.vision) as film:
        clean = Sequence(f"{recording.name}-{scene}-seed{seed}", calibration, imu, film.frames, path.truth, notes)
        yield degrade_sequence(clean, schedule.after_camera, request.seed(seed))


def frame_stamps(recording: Sequence, listed: Stamps | None, path: SmoothedTruth) -> tuple[Stamps, tuple[str, ...]]:
    """Stamps (N,) ns, in the IMU's time, of the frames whose pose is known, and a note on the others."""
    mount = recording.calibration.cameras[0]
    if listed is None:
        stamps = regular(path.motion.start_ns, path.motion.end_ns, mount.rate_hz)
    else:
        stamps = listed + round(mount.dt_cam_imu * 1e9)
    known = path.known(stamps)
    lost = int((~known).sum())
    return stamps[known], (f"{lost} frame(s) left out whose pose is not known",) if lost else ()


def _frames(
    recording: Sequence, listed: Stamps | None, path: SmoothedTruth, start_s: float | None, end_s: float | None
) -> tuple[Stamps, tuple[str, ...]]:
    stamps, notes = frame_stamps(recording, listed, path)
    if len(stamps) == 0:
        raise DataError(f"{recording.name}: no frame lies where truth is known")
    seconds = (stamps - stamps[0]) * 1e-9
    part = stamps[(seconds >= (start_s or 0.0)) & (seconds <= (np.inf if end_s is None else end_s))]
    if len(part) == 0:
        raise DataError(
            f"{recording.name}: no frame between {start_s} s and {end_s} s; frames end at {seconds[-1]:.2f} s"
        )
    return part, notes


def _check(recording: Sequence, scene: str, cameras: int, seed: int, movers: int) -> None:
    """Say what is wrong with a request before work begins."""
    available = len(recording.calibration.cameras)
    if not 1 <= cameras <= available:
        raise ConfigError(f"{cameras} cameras were asked for; {recording.name} has {available} with a calibration")
    check_scene(scene)
    if movers < 0:
        raise ConfigError(f"{movers} movers were asked for; expected 0 or more")
    Streams.of(seed)

"""Recordings of simulated platforms: a platform moves, and its sensors say what they see."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, TypedDict, get_args

from navcore.calibration import Calibration
from navcore.sequence import Sequence
from sim.camera import gl
from sim.camera.film import Film
from sim.degrade import Request, degrade_sequence
from sim.errors import ConfigError
from sim.flights import flight
from sim.imu import grade, simulate_imu
from sim.output import Format, Progress, write_recording
from sim.output.recording import check_request
from sim.points import IMU_GRADE, frame_seconds, frame_stamps, simulate_points
from sim.rig import euroc_like
from sim.streams import Streams
from sim.world import check_scene, make_scene

Mode = Literal["images", "points", "imu"]
"""Rendered images, tracks of landmarks, or no vision at all."""


class _Body(TypedDict):
    moving_start: bool
    difficulty: str
    imu: str
    noise_seed: int | None


class _Vision(TypedDict):
    degrade: str
    cameras: int
    scene: str


class _Living(TypedDict):
    movers: int
    switching: bool


@contextmanager
def filmed(
    platform: str = "quadrotor",
    seconds: float = 60.0,
    seed: int = 1,
    *,
    degrade: str = "",
    moving_start: bool = False,
    cameras: int = 1,
    difficulty: str = "medium",
    imu: str = IMU_GRADE,
    scene: str = "room",
    movers: int = 0,
    switching: bool = False,
    noise_seed: int | None = None,
    flights: Path | None = None,
) -> Iterator[Sequence]:
    """A recording whose images are rendered when they are loaded, as long as the context is open.

    Args:
        platform: which body moves.
        seconds: length of the recording.
        seed: fixes everything that is random.
        degrade: what happens to vision, as `sim.degrade.Request.parse` reads it.
        moving_start: begin in full motion instead of standing still.
        cameras: 1 or 2.
        difficulty: easy, medium or difficult motion.
        imu: its grade.
        scene: what is around.
        movers: how many things move through the scene on paths of their own.
        switching: the scene's lamps go out and on.
        noise_seed: draws IMU, biases and image noise anew over the same motion and world.
        flights: where motions are kept and found again (`sim.flights`); it changes no byte.

    Raises:
        ConfigError: an unknown platform, scene or degradation, or a value out of range.
        RenderError: there is no OpenGL.
    """
    device = grade(imu)
    calibration = euroc_like(device.noise, cameras)
    rate_hz = calibration.cameras[0].rate_hz
    request = Request.parse(degrade)
    schedule = request.schedule(frame_seconds(seconds, rate_hz))
    check_scene(scene)
    gl.make_context(16, 16).free()  # where there is none, that is said before anything is simulated
    streams = Streams.of(seed, noise_seed)
    motion = flight(platform, seconds, seed, moving_start, difficulty, flights)
    samples, truth = simulate_imu(motion, device, streams.imu)
    world = make_scene(scene, motion, streams.world, movers, switching)
    stamps = frame_stamps(motion, rate_hz)
    with Film(motion, calibration, world, stamps, schedule.in_camera, streams.vision) as film:
        clean = Sequence(f"{platform}-{scene}-seed{seed}", calibration, samples, film.frames, truth)
        yield degrade_sequence(clean, schedule.after_camera, request.seed(seed))


def felt(
    platform: str = "quadrotor",
    seconds: float = 60.0,
    seed: int = 1,
    *,
    moving_start: bool = False,
    difficulty: str = "medium",
    imu: str = IMU_GRADE,
    noise_seed: int | None = None,
    flights: Path | None = None,
) -> Sequence:
    """A recording without cameras: IMU and truth, the same as `filmed` has; arguments and errors as there."""
    device = grade(imu)
    streams = Streams.of(seed, noise_seed)
    motion = flight(platform, seconds, seed, moving_start, difficulty, flights)
    samples, truth = simulate_imu(motion, device, streams.imu)
    return Sequence(f"{platform}-imu-seed{seed}", Calibration(device.noise), samples, (), truth)


def record(
    platform: str,
    seconds: float,
    seed: int,
    out: Path,
    *,
    degrade: str = "",
    mode: Mode = "images",
    moving_start: bool = False,
    cameras: int = 1,
    difficulty: str = "medium",
    imu: str = IMU_GRADE,
    scene: str = "room",
    movers: int = 0,
    switching: bool = False,
    noise_seed: int | None = None,
    flights: Path | None = None,
    format: Format = "asl",
    progress: Progress | None = None,
) -> None:
    """Write a recording. The same arguments give the same bytes; a failure leaves nothing behind.

    One that is interrupted goes on when it is asked for again (`write_recording`).

    Args:
        out: the folder to make; it must be new or empty.
        mode: see `Mode`; without vision `degrade`, `cameras` and `scene` have no meaning.
        movers, switching: as for `filmed`; with images only.
        format: EuRoC's layout, or a bag; tracks cannot be a bag.
        progress: gets the number of images done and of all.
        platform, seconds, seed, degrade, moving_start, cameras, difficulty, imu, scene, noise_seed, flights: as for
            `filmed`.

    Raises:
        ConfigError: as `filmed` and `write_recording` do.
        RenderError: images are wanted and there is no OpenGL.
    """
    body: _Body = {"moving_start": moving_start, "difficulty": difficulty, "imu": imu, "noise_seed": noise_seed}
    vision: _Vision = {"degrade": degrade, "cameras": cameras, "scene": scene}
    living: _Living = {"movers": movers, "switching": switching}
    asked = {"platform": platform, "seconds": seconds, "seed": seed, "mode": mode, **body, **vision, **living}
    _check(mode, degrade, format)
    if mode != "images" and (movers or switching):
        raise ConfigError(f"things that move and lamps that switch need images; mode is {mode!r}")
    check_request(out, format, asked)
    if mode == "images":
        with filmed(platform, seconds, seed, **body, **vision, **living, flights=flights) as sequence:
            write_recording(sequence, out, format=format, origin=asked, progress=progress)
        return
    if mode == "points":
        sequence = simulate_points(platform, seconds, seed, **body, **vision, flights=flights)
    else:
        sequence = felt(platform, seconds, seed, **body, flights=flights)
    write_recording(sequence, out, format=format, origin=asked, progress=progress)


def _check(mode: Mode, degrade: str, format: Format) -> None:
    if mode not in get_args(Mode):
        raise ConfigError(f"mode {mode!r} is unknown; known are {', '.join(get_args(Mode))}")
    if mode == "points" and format != "asl":
        raise ConfigError(f"tracks cannot be written as {format}, which has no message for them; expected asl")
    if mode == "imu" and degrade:
        raise ConfigError(f"a recording without vision cannot be degraded; got {degrade!r}")

"""A recording, of whatever origin, as a folder or a bag."""

import shutil
from pathlib import Path
from typing import Literal

from navcore.sequence import Sequence
from sim.errors import ConfigError
from sim.output import asl
from sim.output.bag import check_bag, write_bag
from sim.output.folder import Origin, check_new, new_folder, require_space
from sim.output.images import Progress, on_disk, write_images
from sim.output.kalibr import write_kalibr

Format = Literal["asl", "ros1", "ros2"]
"""EuRoC's layout, a ROS 1 bag, or a ROS 2 bag."""
FORMATS: tuple[Format, ...] = ("asl", "ros1", "ros2")

_ROW_BYTES = 350  # of a row of numbers, at most


def write_recording(
    sequence: Sequence,
    out: Path,
    *,
    format: Format = "asl",
    origin: Origin | None = None,
    progress: Progress | None = None,
) -> None:
    """Write a recording; the folder `out` appears whole or not at all.

    What is interrupted stays beside it as `OUT.partial` and goes on when the same is asked for again; a failure
    leaves nothing behind. The bytes depend on the recording alone. A bag has Kalibr's calibration beside it.

    Args:
        sequence: what to write; an image must not depend on which were loaded before it.
        out: the folder to make; it must be new or empty.
        format: see `Format`.
        origin: what the recording is made from, saved as `origin.json`; without it nothing can go on.
        progress: gets the number of images done and of all.

    Raises:
        ConfigError: an unknown format, `out` is not empty, another recording was interrupted there, too little
            space, or a recording that cannot be a bag.
        DataError: an image cannot be read.
    """
    check_request(out, format, origin)
    if format != "asl":
        check_bag(sequence)
    require_space(out, _bytes(sequence, format))
    with new_folder(out, _with(origin, format)) as partial:
        mav0 = partial / "mav0"
        write_images(sequence, mav0, progress)
        if format == "asl":
            asl.write_measurements(mav0, sequence)
            return
        packing = partial / "packing"
        shutil.rmtree(packing, ignore_errors=True)
        packing.mkdir()
        for file in write_bag(on_disk(sequence, mav0), packing, format):
            file.rename(partial / file.name)
        write_kalibr(partial, sequence.calibration)
        shutil.rmtree(packing)
        shutil.rmtree(mav0, ignore_errors=True)


def check_request(out: Path, format: Format, origin: Origin | None) -> None:
    """Raise if `write_recording` would refuse these, before anything is simulated.

    Raises:
        ConfigError: as `write_recording` does.
    """
    if format not in FORMATS:
        raise ConfigError(f"format {format!r} is unknown; known are {', '.join(FORMATS)}")
    check_new(out, _with(origin, format))


def check_apart(source: Path, out: Path) -> None:
    """Raise if `out` is a recording that is read, or inside it: no recording is ever written into.

    Raises:
        ConfigError: it is.
    """
    if out.resolve() == source.resolve() or source.resolve() in out.resolve().parents:
        raise ConfigError(f"{out} is inside the recording {source}; expected a folder beside it")


def _with(origin: Origin | None, format: Format) -> Origin | None:
    return None if origin is None else {"format": format, **origin}


def _bytes(sequence: Sequence, format: Format) -> int:
    """How much room a recording may take while it is written: images as if they could not be compressed."""
    cameras = [mount.camera for mount in sequence.calibration.cameras]
    images = sum(cameras[index].width * cameras[index].height for f in sequence.frames for index in f.images)
    tracks = sum(len(seen) for f in sequence.frames for seen in f.tracks.values())
    rows = len(sequence.imu) + (len(sequence.truth) if sequence.truth is not None else 0) + tracks
    return (images if format == "asl" else 2 * images) + rows * _ROW_BYTES

"""The recordings below a folder: what there is, what of it can be run, and why the rest cannot."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from eval.errors import StudyError
from eval.sources import Recording
from navcore.errors import NavcoreError
from navcore.readers import open_sequence, rosbag
from navcore.sequence import Sequence

_ARCHIVES = (".zip", ".tar", ".tgz", ".gz", ".bz2", ".xz", ".7z")
_BAGS = (".bag", ".db3", ".mcap")
_UNFINISHED = ".partial"
_WHOLE = 0.9  # share of the IMU's time that a whole recording's frames cover

NO_IMAGES = "no images"


@dataclass(frozen=True)
class Listed:
    """A recording below the folder.

    Attributes:
        name: of the recording; with its place below the folder where two have the same.
        path: where it is.
        source: what a study runs; None if it cannot be run.
        objection: why it cannot; empty if it can.
        whole: whether its frames cover what its IMU does, as in the original.
    """

    name: str
    path: Path
    source: Recording | None = None
    objection: str = ""
    whole: bool = True


@dataclass(frozen=True)
class Survey:
    """What lies below a folder.

    Attributes:
        recordings: in the order of their names.
        notes: what was passed over, a line each.
    """

    recordings: tuple[Listed, ...]
    notes: tuple[str, ...]

    @staticmethod
    def of(root: Path, tell: Callable[[str], None] | None = None) -> "Survey":
        """Look through a folder; every recording is opened, which `tell` hears of before.

        Raises:
            StudyError: there is none, or no such folder.
        """
        if not root.is_dir():
            raise StudyError(f"{root}: no such folder; expected one with recordings below it")
        notes: list[str] = []
        places = list(_places(root, notes))
        folders = {_name(path) for path, is_bag in places if not is_bag}
        kept = [path for path, is_bag in places if not (is_bag and _name(path) in folders)]
        notes += [f"{path}: the same recording as the folder, passed over" for path, _ in places if path not in kept]
        if not kept:
            expected = "expected folders with mav0/imu0 in them, or ROS bags"
            raise StudyError(f"{root}: no recording below it; {expected}" + "".join(f"\n{note}" for note in notes))
        names = [_name(path) for path in kept]
        unique = [n if names.count(n) == 1 else _place(p, root) for n, p in zip(names, kept, strict=True)]
        listed = []
        for name, path in sorted(zip(unique, kept, strict=True)):
            if tell is not None:
                tell(name)
            listed.append(_listed(name, path))
        return Survey(tuple(listed), tuple(notes))


def _listed(name: str, path: Path) -> Listed:
    try:
        sequence = open_sequence(path)
    except NavcoreError as error:
        return Listed(name, path, objection=str(error))
    if not any(frame.images or frame.tracks for frame in sequence.frames):
        return Listed(name, path, objection=NO_IMAGES)
    return Listed(name, path, Recording.of(path, sequence), whole=_is_whole(sequence))


def _is_whole(sequence: Sequence) -> bool:
    frames, imu = sequence.frames, sequence.imu
    return bool(frames[-1].t_ns - frames[0].t_ns >= _WHOLE * (imu.t_ns[-1] - imu.t_ns[0]))


def _places(root: Path, notes: list[str]) -> Iterator[tuple[Path, bool]]:
    """Recordings, and whether each is a bag. Nothing is looked for inside of them, where images are many."""
    seen: set[str] = set()
    for place, folders, files in os.walk(root, followlinks=True):
        folder = Path(place)
        if os.path.realpath(place) in seen:
            folders.clear()
            continue
        seen.add(os.path.realpath(place))
        if folder.name.endswith(_UNFINISHED):
            notes.append(f"{folder}: unfinished, passed over")
            folders.clear()
            continue
        folders.sort()
        notes += [f"{folder / x}: an archive, passed over; unpack it" for x in sorted(files) if x.endswith(_ARCHIVES)]
        if (folder / "imu0").is_dir() or (folder / "mav0" / "imu0").is_dir():
            folders.clear()
            yield folder, False
        elif rosbag.recognises(folder) and (folder / "metadata.yaml").is_file():
            folders.clear()
            yield folder, True
            continue
        yield from ((folder / x, True) for x in sorted(files) if x.endswith(_BAGS) and rosbag.recognises(folder / x))


def _name(path: Path) -> str:
    """As a reader names what is there."""
    whole = path.resolve()
    if whole.is_file():
        return whole.stem
    return whole.parent.name if whole.name == "mav0" else whole.name


def _place(path: Path, root: Path) -> str:
    """Its place below the folder, without what all recordings have in common."""
    inner = path.relative_to(root)
    return (inner.parent if inner.name == "mav0" else inner).as_posix()

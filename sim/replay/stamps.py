"""When a replay's frames are taken: as the recording's camera took them."""

from pathlib import Path

import numpy as np

from navcore.arrays import Stamps
from navcore.errors import DataError
from navcore.readers import open_sequence
from navcore.sequence import Sequence

_LISTED = "timestamps_ns.txt"


def open_recording(source: Path | Sequence) -> tuple[Sequence, Stamps | None]:
    """A recording, and the stamps (N,) ns of its camera 0 in the camera's time, if they are known.

    They are those of its frames, or of `cam0/timestamps_ns.txt`, which lists them without images, one a line.
    """
    if isinstance(source, Sequence):
        sequence, listed = source, None
    else:
        sequence = open_sequence(source)
        places = (source / "mav0" / "cam0" / _LISTED, source / "cam0" / _LISTED)
        listed = next((p for p in places if p.is_file()), None)
    if listed is not None:
        return sequence, read_stamps(listed)
    frames = [f.t_ns for f in sequence.frames]
    return sequence, np.array(frames, dtype=np.int64) if frames else None


def read_stamps(path: Path) -> Stamps:
    """Stamps of a list, one a line, increasing.

    Raises:
        DataError: a line is no whole number, or not after the one before; the message has file and line.
    """
    found: list[int] = []
    for number, line in enumerate(path.read_text().splitlines(), 1):
        text = line.partition("#")[0].strip()
        if not text:
            continue
        if not text.isdecimal() or (found and int(text) <= found[-1]):
            raise DataError(f"{path}:{number}: {text!r} is not a stamp [ns] after the one before")
        found.append(int(text))
    return np.array(found, dtype=np.int64)


def regular(start_ns: int, end_ns: int, rate_hz: float) -> Stamps:
    """Stamps (N,) at a constant rate within a span."""
    n = int((end_ns - start_ns) * 1e-9 * rate_hz) + 1
    stamps: Stamps = start_ns + np.rint(np.arange(n) * 1e9 / rate_hz).astype(np.int64)
    return stamps[stamps <= end_ns]

"""One view under every degradation and severity: a picture to look at."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from navcore.arrays import Image
from navcore.readers import open_sequence
from navcore.sequence import Frame, ImageArray, Sequence
from sim.degrade import Schedule, degrade_sequence
from sim.degrade.schedule import GRADED, MAX_SEVERITY, RENDERED, STREAM
from sim.errors import ConfigError
from sim.record import filmed
from sim.streams import Streams

_SECONDS = 30.0
_WIDTH = 160  # px of one view in the picture
_FORMATS = {".png": (cv2.IMWRITE_PNG_COMPRESSION, 9), ".jpg": (cv2.IMWRITE_JPEG_QUALITY, 88)}
_MARGIN = 8  # frames before and after the one that is shown
_KINDS = tuple(kind for kind in GRADED if kind not in STREAM)


def strip(out: Path, seed: int = 1, recording: Path | None = None) -> None:
    """Write a picture: a row for each kind that acts on images, from clean to the worst severity.

    Args:
        out: `.png` or `.jpg`.
        seed: of the flight and of all degradations.
        recording: what is shown; without it, a flight is rendered. It is the frame in which the rig turns fastest.

    Raises:
        ConfigError: the folder of `out` is missing, or it is no picture's name.
        RenderError: a flight is to be rendered, and there is no OpenGL here.
    """
    if not out.parent.is_dir():
        raise ConfigError(f"{out.parent}: no such folder")
    Streams.of(seed)
    if out.suffix not in _FORMATS or out.is_dir():
        raise ConfigError(f"{out}: expected a name that ends in {' or '.join(_FORMATS)}")
    if recording is not None:
        sequence = open_sequence(recording)
        index = _fastest(sequence)
        held = _held(sequence, index)
        rows = [_row(held, index, kind, seed) for kind in _KINDS]
    else:
        rows = _rendered_rows(seed)
    picture = np.vstack([_heading(rows[0].shape[1]), *rows])
    done, data = cv2.imencode(out.suffix, picture, _FORMATS[out.suffix])
    assert done
    out.write_bytes(data.tobytes())


def _rendered_rows(seed: int) -> list[Image]:
    """Rows of a rendered flight; what the camera does itself is done in frames that follow the one that is shown."""
    with filmed("quadrotor", _SECONDS, seed) as clean:
        index = _fastest(clean)
        held = _held(clean, index)
        t_s = [(f.t_ns - clean.frames[0].t_ns) * 1e-9 - 1e-3 for f in clean.frames[index : index + MAX_SEVERITY + 2]]
        rows = {kind: _row(held, index, kind, seed) for kind in _KINDS if kind not in RENDERED}
        first = held.frames[index].images[0].load()
    for kind in RENDERED:
        spans = (f"{kind}:{k}@{t_s[k]:.4f}-{t_s[k + 1]:.4f}" for k in range(1, MAX_SEVERITY + 1))
        with filmed("quadrotor", _SECONDS, seed, degrade=",".join(spans)) as film:
            frames = film.frames[index + 1 : index + 1 + MAX_SEVERITY]
            rows[kind] = _joined([first, *(frame.images[0].load() for frame in frames)], kind)
    return [rows[kind] for kind in _KINDS]


def _held(sequence: Sequence, index: int) -> Sequence:
    """The recording with one image in memory: it is rendered or read once for all rows."""
    frames = list(sequence.frames)
    frames[index] = Frame(frames[index].t_ns, images={0: ImageArray(frames[index].images[0].load())})
    return replace(sequence, frames=frames)


def _row(sequence: Sequence, index: int, kind: str, seed: int) -> Image:
    """One frame, from clean to the worst; the degradation has just begun."""
    t_s = (sequence.frames[index].t_ns - sequence.frames[0].t_ns) * 1e-9
    images = [sequence.frames[index].images[0].load()]
    for severity in range(1, MAX_SEVERITY + 1):
        schedule = Schedule.parse(f"{kind}:{severity}@{max(t_s - 0.12, 0.0):.4f}-{t_s + 0.2:.4f}")
        images.append(degrade_sequence(sequence, schedule, seed).frames[index].images[0].load())
    return _joined(images, kind)


def _fastest(sequence: Sequence) -> int:
    """Which frame, well inside the recording, the body turns fastest at."""
    stamps = np.array([f.t_ns for f in sequence.frames])
    rate = np.linalg.norm(sequence.imu.gyro, axis=1)
    at_frames = np.interp(stamps - stamps[0], sequence.imu.t_ns - stamps[0], rate)
    low, high = _MARGIN, len(stamps) - _MARGIN
    if any(0 not in frame.images for frame in sequence.frames):
        raise ConfigError(f"{sequence.name}: there are frames without an image of camera 0")
    if low >= high:
        raise ConfigError(f"{sequence.name}: {len(stamps)} frames; a picture needs more than {2 * _MARGIN}")
    return low + int(np.argmax(at_frames[low:high]))


def _heading(width: int) -> Image:
    bar = np.full((22, width), 255, dtype=np.uint8)
    for k in range(MAX_SEVERITY + 1):
        text = "clean" if k == 0 else f"{k}"
        cv2.putText(bar, text, (k * _WIDTH + 6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, 0, 1, cv2.LINE_AA)
    return bar


def _joined(images: list[Image], kind: str) -> Image:
    height = round(images[0].shape[0] * _WIDTH / images[0].shape[1])
    row = np.hstack([cv2.resize(image, (_WIDTH, height), interpolation=cv2.INTER_AREA) for image in images])
    for colour, shift in ((0, 1), (255, 0)):
        place = (5 + shift, 14 + shift)
        cv2.putText(row, kind, place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, colour, 1, cv2.LINE_AA)
    return row

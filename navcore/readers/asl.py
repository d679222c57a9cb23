"""What recordings in the ASL folder layout have in common: IMU, frames and truth below `mav0`."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from navcore.arrays import Stamps
from navcore.calibration import Calibration
from navcore.errors import DataError
from navcore.imu import ImuSamples
from navcore.readers.table import count_columns, read_names, read_table
from navcore.sequence import Frame, ImageFile, ImageSource, Tracks
from navcore.trajectory import Trajectory

_IMU_ROW = "t_ns, gyro x y z [rad/s], accelerometer x y z [m/s^2]"
_TRUTH_ROW = "t_ns, p_WB (3), q_WB (wxyz), then v_WB (3) and b_g, b_a (6) where they are known"
_IMAGE_ROW = "t_ns, file name"
_TRACK_ROW = "t_ns, id, u, v"
_STAMP_ROW = "t_ns"
_POSE_COLUMNS = 7
_TRUTH_COLUMNS = (7, 10, 16)
_UNIT = 1e-12  # how far the norm of a unit quaternion may be off for rounding
_GAP_STEPS = 2.5  # IMU intervals that are no longer a late sample


def recording_folder(path: Path) -> tuple[Path, str]:
    """The folder that holds `imu0` (`mav0` or `path` itself), and the recording's name.

    Raises:
        DataError: no such folder, or no `imu0` in it.
    """
    if not path.is_dir():
        raise DataError(f"{path}: no such folder; expected a recording with mav0/imu0 in it")
    path = path.resolve()
    folder = path / "mav0" if (path / "mav0").is_dir() else path
    if not (folder / "imu0").is_dir():
        found = ", ".join(sorted(x.name for x in folder.iterdir())[:8]) or "nothing"
        raise DataError(f"{folder}: no folder imu0; expected mav0/imu0/data.csv, found {found}")
    return folder, folder.parent.name if folder.name == "mav0" else folder.name


def read_imu(folder: Path) -> tuple[ImuSamples, list[str]]:
    """All samples of `imu0/data.csv`, and a note if the stamps have gaps."""
    path = folder / "imu0" / "data.csv"
    t_ns, values = read_table(path, 6, _IMU_ROW)
    return ImuSamples(t_ns, values[:, :3], values[:, 3:]), gaps(t_ns, path)


def gaps(t_ns: Stamps, path: Path) -> list[str]:
    """A note if the IMU's stamps (N,) have gaps."""
    steps = np.diff(t_ns)
    found = np.flatnonzero(steps > _GAP_STEPS * np.median(steps)) if steps.size else steps
    if found.size == 0:
        return []
    worst = found[np.argmax(steps[found])]
    where = f"the longest {steps[worst] * 1e-9:.3f} s after {t_ns[worst]} ns"
    return [f"{path}: {found.size} gap(s) between samples, {where}"]


def read_truth(path: Path) -> Trajectory:
    """Truth as EuRoC writes it: position, quaternion (wxyz), velocity and biases as far as there are columns.

    Velocities and biases may be NaN; where all of them are, the trajectory has None.
    """
    columns = count_columns(path, _TRUTH_ROW)
    if columns not in _TRUTH_COLUMNS:
        raise DataError(f"{path}: {columns} numbers a row, expected one of {_TRUTH_COLUMNS}: {_TRUTH_ROW}")
    t_ns, values = read_table(path, columns, _TRUTH_ROW, nan_columns=range(_POSE_COLUMNS, columns))
    q_WB_wxyz = values[:, 3:7]
    norms = np.linalg.norm(q_WB_wxyz, axis=1, keepdims=True)
    error = np.abs(norms - 1.0)
    rounded = (error > _UNIT) & (error < 1e-2)  # a quaternion that is unit already keeps every digit
    q_WB = np.roll(q_WB_wxyz, -1, axis=1) / np.where(rounded, norms, 1.0)
    optional = [values[:, k : k + 3] for k in range(_POSE_COLUMNS, columns, 3)]
    known = [None if np.isnan(x).all() else x for x in optional] + [None] * (3 - len(optional))
    try:
        return Trajectory(t_ns, q_WB, values[:, :3], *known)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error


def camera_folders(folder: Path) -> list[Path]:
    """`cam0`, `cam1`, ... in order; the place in this list is the camera's index."""
    found = {x.name for x in folder.glob("cam*") if x.is_dir() and x.name[3:].isdecimal()}
    names = [f"cam{k}" for k in range(len(found))]
    if found != set(names):
        raise DataError(f"{folder}: camera folders {sorted(found)}, expected {names}")
    return [folder / name for name in names]


def read_frames(cameras: list[Path], calibration: Calibration, imu: ImuSamples) -> tuple[tuple[Frame, ...], list[str]]:
    """Frames of all cameras, paired by stamp; those outside the IMU's span are left out and noted.

    A camera folder with `data.csv` has images, one with `tracks.csv` has tracks, any other has no frames.
    """
    images: dict[int, dict[int, ImageSource]] = {}
    tracks: dict[int, dict[int, Tracks]] = {}
    for index, folder in enumerate(cameras):
        if (folder / "data.csv").is_file():
            camera = calibration.cameras[index].camera
            for t_ns, source in _images(folder, camera.width, camera.height):
                images.setdefault(t_ns, {})[index] = source
        elif (folder / "tracks.csv").is_file():
            for t_ns, seen in _tracks(folder):
                tracks.setdefault(t_ns, {})[index] = seen
    return pair(images, tracks, calibration, imu)


def pair(
    images: Mapping[int, Mapping[int, ImageSource]],
    tracks: Mapping[int, Mapping[int, Tracks]],
    calibration: Calibration,
    imu: ImuSamples,
) -> tuple[tuple[Frame, ...], list[str]]:
    """Frames of what cameras saw, by stamp and camera; those outside the IMU's span are left out and noted."""
    stamps = np.array(sorted(images.keys() | tracks.keys()), dtype=np.int64)
    offsets = [round(c.dt_cam_imu * 1e9) for c in calibration.cameras] or [0]
    early = stamps[stamps + min(offsets) < imu.t_ns[0]]
    late = stamps[stamps + max(offsets) > imu.t_ns[-1]]
    notes = [_left_out(early, "before the first", int(imu.t_ns[0]))] if early.size else []
    notes += [_left_out(late, "after the last", int(imu.t_ns[-1]))] if late.size else []
    kept = stamps[early.size : len(stamps) - late.size].tolist()
    return tuple(Frame(t, images.get(t, {}), tracks.get(t, {})) for t in kept), notes


def _left_out(stamps: Stamps, where: str, limit_ns: int) -> str:
    which = f"{stamps[0]} ns" if len(stamps) == 1 else f"{stamps[0]} to {stamps[-1]} ns"
    return f"{len(stamps)} frame(s) left out, {where} IMU sample ({limit_ns} ns): {which}"


def _images(folder: Path, width: int, height: int) -> list[tuple[int, ImageFile]]:
    listing = folder / "data.csv"
    names = read_names(listing, _IMAGE_ROW)
    if names and not (folder / "data").is_dir():
        raise DataError(f"{folder / 'data'}: no such folder; {listing} lists {len(names)} images in it")
    return [(t_ns, ImageFile(folder / "data" / name, width, height)) for t_ns, name in names]


def _tracks(folder: Path) -> list[tuple[int, Tracks]]:
    """Tracks by frame; `timestamps_ns.txt`, where present, adds the frames in which nothing was seen."""
    path = folder / "tracks.csv"
    t_ns, values = read_table(path, 3, _TRACK_ROW, repeats=True)
    ids = np.rint(values[:, 0]).astype(np.int64)
    if np.any(ids != values[:, 0]):
        k = int(np.argmax(ids != values[:, 0]))
        raise DataError(f"{path}: id {values[k, 0]} at {t_ns[k]} ns is not a whole number")
    order = np.lexsort((ids, t_ns))
    same = (np.diff(t_ns[order]) == 0) & (np.diff(ids[order]) == 0)
    if same.any():
        k = order[int(np.argmax(same))]
        raise DataError(f"{path}: id {ids[k]} occurs twice at {t_ns[k]} ns")
    stamps = np.unique(t_ns)
    if (folder / "timestamps_ns.txt").is_file():
        listed, _ = read_table(folder / "timestamps_ns.txt", 0, _STAMP_ROW)
        stamps = np.union1d(stamps, listed)
    first = np.searchsorted(t_ns, stamps, side="left")
    last = np.searchsorted(t_ns, stamps, side="right")
    spans = zip(stamps.tolist(), first.tolist(), last.tolist(), strict=True)
    return [(t, Tracks(ids[a:b], values[a:b, 1:])) for t, a, b in spans]

"""`window-mean[:NAME]`: whatever a window of the IMU says on average is its bias.

The mean rate is the gyroscope's bias. Of the specific force either its excess over gravity counts, along its mean
direction, and nothing is known across; or, where the calibration holds the mean force of the platform, the whole
difference to that counts.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ipnet.calibration import ErrorModel, WindowErrors, fit
from ipnet.directions import along_first
from ipnet.errors import ConfigError
from ipnet.recordings import Recording
from ipnet.windows import Grid, ImuWindow, WindowStream
from navcore.arrays import Floats, Vectors, frozen
from navcore.imu import GRAVITY, ImuSamples
from navcore.prior import BiasPrior, BiasPriorSource
from navcore.sequence import Sequence

FOLDER = Path(__file__).parent / "calibrations"
_RATE_HZ = 50.0
_UNKNOWN = 3.0  # m/s^2, sd across the force: more than any bias


@dataclass(frozen=True)
class Calibration:
    """What was found on recordings with known biases.

    Attributes:
        seconds: length of a window; a statement comes every fifth of it.
        force: (3,) m/s^2 mean specific force of the platform in B, or None where the mount may be any.
        errors: of the statements; without a `force` the accelerometer's axes are along the window's mean force, which
            alone is known, and across.
        recordings: what it was fitted to.
    """

    seconds: float
    force: Vectors | None
    errors: ErrorModel
    recordings: tuple[str, ...]

    def __post_init__(self) -> None:
        if self.force is not None:
            object.__setattr__(self, "force", frozen("force", self.force, np.float64, (3,)))

    @property
    def grid(self) -> Grid:
        """Of its windows."""
        return Grid(self.seconds, _RATE_HZ, 0.2 * self.seconds)

    @property
    def constant_covariance(self) -> Floats:
        """(6, 6) of the error that is constant over a run, in B."""
        if self.force is not None:
            return self.errors.constant
        constant = np.zeros((6, 6))
        constant[:3, :3] = self.errors.constant[:3, :3]
        constant[3:, 3:] = self.errors.constant[3, 3] * np.eye(3)  # along the force, wherever that points
        return constant

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        force = None if self.force is None else self.force.tolist()
        return {**vars(self), "force": force, "errors": self.errors.as_dict()}

    @staticmethod
    def from_dict(content: dict[str, Any]) -> "Calibration":
        """From what `as_dict` gave."""
        named = {"errors": ErrorModel.from_dict(content["errors"]), "recordings": tuple(content["recordings"])}
        return Calibration(**{**content, **named})


class WindowMean:
    """The source."""

    def __init__(self, calibration: Calibration) -> None:
        self.window_s = calibration.seconds
        self.constant_covariance = calibration.constant_covariance
        self._calibration = calibration
        self._stream = WindowStream(calibration.grid)
        self._ready: list[BiasPrior] = []

    def device(self) -> BiasPrior | None:
        """Nothing is known of a device."""
        return None

    def add_imu(self, samples: ImuSamples) -> None:
        """Take new samples, in time order."""
        self._ready += [statement(window, self._calibration) for window in self._stream.add(samples)]

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """The windows that the samples added so far have completed, each once."""
        ready, self._ready = self._ready, []
        return ready


def make(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """The source with the calibration of that name or in that file; `generic-5` without one.

    Raises:
        ConfigError: there is none.
    """
    return WindowMean(load(argument))


def load(argument: str) -> Calibration:
    """The calibration that `find` finds.

    Raises:
        ConfigError: there is none of that name, and the message lists the names; or the file is no calibration.
    """
    path = find(argument)
    try:
        return Calibration.from_dict(json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, TypeError, KeyError) as error:
        raise ConfigError(f"{path}: {error!r}; expected what `python -m ipnet window-mean` writes") from error


def find(argument: str) -> Path:
    """The file of a shipped calibration, or the one at that path; `generic-5` without an argument.

    Raises:
        ConfigError: there is none; the message lists the names.
    """
    name = argument or "generic-5"
    shipped = FOLDER / f"{name}.json"
    if shipped.is_file() and "/" not in name:
        return shipped
    if Path(name).is_file():
        return Path(name)
    names = ", ".join(sorted(p.stem for p in FOLDER.glob("*.json")))
    raise ConfigError(f"window-mean {name!r} is unknown; known are {names}, and files that `window-mean` wrote")


def statement(window: ImuWindow, calibration: Calibration) -> BiasPrior:
    """What a window says."""
    b_g, b_a, R_FB = _means(window, calibration.force)
    variance = calibration.errors.variance(np.ones(6))
    if calibration.force is None:
        variance[4:] = _UNKNOWN**2
    covariance = np.diag(variance)
    covariance[3:, 3:] = R_FB.T @ covariance[3:, 3:] @ R_FB
    return BiasPrior(window.middle_ns, b_g, b_a, covariance)


def calibrate(recordings: list[Recording], seconds: float, mounted: bool) -> Calibration:
    """Find a calibration on recordings with known biases; a mean force meets errors only on recordings left out of it.

    Args:
        recordings: of the platforms for which it shall hold.
        seconds: length of a window.
        mounted: the IMU always sits in the platform in the same way, so that its mean force can be known.

    Raises:
        ConfigError: fewer than two recordings are long enough.
    """
    grid = Grid(seconds, _RATE_HZ, 0.2 * seconds)
    heard = [(r, windows) for r in recordings if (windows := list(WindowStream(grid).add(r.imu)))]
    if len(heard) < 2:
        raise ConfigError(f"{len(heard)} recordings have a window of {seconds:g} s; expected two or more")
    forces = [[w.values[:, 3:].mean(axis=0) - r.label.bias[3:] for w in windows] for r, windows in heard]
    errors = []
    for k, (recording, windows) in enumerate(heard):
        others = np.mean(np.vstack(forces[:k] + forces[k + 1 :]), axis=0) if mounted else None
        errors.append(_errors(recording, windows, others))
    force = np.mean(np.vstack(forces), axis=0) if mounted else None
    return Calibration(seconds, force, fit(errors, seconds), tuple(e.recording for e in errors))


def _errors(recording: Recording, windows: list[ImuWindow], force: Vectors | None) -> WindowErrors:
    t_ns = np.array([w.middle_ns for w in windows], dtype=np.int64)
    truth = recording.bias_at(t_ns)
    rows = []
    for window, b in zip(windows, truth, strict=True):
        b_g, b_a, R_FB = _means(window, force)
        rows.append(np.concatenate([b_g - b[:3], R_FB @ (b_a - b[3:])]))
    return WindowErrors(recording.name, t_ns, np.array(rows), np.ones((len(rows), 6)))


def _means(window: ImuWindow, force: Vectors | None) -> tuple[Vectors, Vectors, Floats]:
    """b_g, b_a, and the axes of the accelerometer's error: B, or along the force first where only that is known."""
    mean = window.values.mean(axis=0)
    if force is not None:
        return mean[:3], mean[3:] - force, np.eye(3)
    direction = mean[3:] / np.linalg.norm(mean[3:])
    excess = float(np.linalg.norm(window.values[:, 3:], axis=1).mean()) - GRAVITY
    return mean[:3], excess * direction, along_first(direction)

"""The axes that errors are given in: the IMU's own, or along and across a direction such as the thrust."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ipnet.directions import along_first, for_both
from ipnet.errors import ConfigError
from ipnet.runs import Span
from navcore.arrays import Floats, Vectors, frozen

_EXPECTED = "expected 'imu', 'thrust' (mean direction of the specific force), or three numbers x,y,z"


@dataclass(frozen=True)
class Axes:
    """A frame for errors, and what is pooled in it.

    Attributes:
        R_FB: (3, 3) from the IMU's axes to these.
        names: one for each group.
        groups: the components (0…5: gyro, then accelerometer) that a group pools.
    """

    R_FB: Floats
    names: tuple[str, ...]
    groups: tuple[tuple[int, ...], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "R_FB", frozen("R_FB", self.R_FB, np.float64, (3, 3)))

    @property
    def R6(self) -> Floats:
        """(6, 6) for both sensors."""
        return for_both(self.R_FB)

    @property
    def pooling(self) -> Floats:
        """(G, 6) weights that give the mean of a group."""
        rows = np.zeros((len(self.groups), 6))
        for row, group in zip(rows, self.groups, strict=True):
            row[list(group)] = 1.0 / len(group)
        return rows


def axes_of(frame: str, spans: Iterable[Span]) -> Axes:
    """The axes that a frame's text names; spans give the mean direction of the specific force.

    Raises:
        ConfigError: the text is none of `imu`, `thrust`, `x,y,z`.
    """
    if frame == "imu":
        names = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in "xyz")
        return Axes(np.eye(3), names, tuple((k,) for k in range(6)))
    direction = _mean_force(spans) if frame == "thrust" else _direction(frame)
    names = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in ("along", "across"))
    return Axes(along_first(direction), names, ((0,), (1, 2), (3,), (4, 5)))


def _direction(text: str) -> Vectors:
    try:
        direction = np.array([float(x) for x in text.split(",")])
    except ValueError as error:
        raise ConfigError(f"frame is {text!r}, {_EXPECTED}") from error
    if direction.shape != (3,) or not 0.0 < float(np.linalg.norm(direction)) < np.inf:
        raise ConfigError(f"frame is {text!r}, {_EXPECTED}")
    unit: Vectors = direction / np.linalg.norm(direction)
    return unit


def _mean_force(spans: Iterable[Span]) -> Vectors:
    """(3,) direction of the specific force, its bias taken out, on average over all spans."""
    force = np.sum([s.sequence.imu.accel.mean(axis=0) - s.bias[:, 3:].mean(axis=0) for s in spans], axis=0)
    direction: Vectors = force / np.linalg.norm(force)
    return direction

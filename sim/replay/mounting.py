"""How a recording's truth lies to its IMU: clocks, worlds and bodies that differ by constants."""

from dataclasses import dataclass

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Vectors

SIZE = 10
TURN_OFFSET, SHIFT_OFFSET, TILT, TURN, LEVER = slice(0, 1), slice(1, 2), slice(2, 4), slice(4, 7), slice(7, 10)
"""Places of the unknowns: time offsets of attitude and of position, tilt, turn of the body, lever arm."""

PRIOR_SD = np.array([0.02, 0.02, 0.1, 0.1, 0.05, 0.05, 0.05, 0.02, 0.02, 0.02])
"""What is believed before: 20 ms, 6 degrees of tilt, 3 degrees of turn, 2 cm."""


@dataclass(frozen=True)
class Mounting:
    """The constants between truth (world V, body T) and the path (W, B): `T_VT = R_VW T_WB T_BT`.

    V and W share their origin and their heading. Attitude and position have a time offset each: a laser
    tracker has a clock of its own, and accelerometers lag behind gyros by their filter.

    Attributes:
        turn_offset_s: to add to a stamp of truth to get the gyro's time of its attitude.
        shift_offset_s: the same for its position and the accelerometer.
        R_VW: (3, 3): how V is tilted against gravity.
        R_BT: (3, 3): how truth's body is turned against the IMU.
        p_BT: (3,) m: where truth's body is in the IMU's frame.
    """

    turn_offset_s: float
    shift_offset_s: float
    R_VW: Floats
    R_BT: Floats
    p_BT: Vectors

    @staticmethod
    def none() -> "Mounting":
        """Truth is of the IMU, upright and on time."""
        return Mounting(0.0, 0.0, np.eye(3), np.eye(3), np.zeros(3))

    def moved(self, dx: Floats) -> "Mounting":
        """The constants after an error-state step (10,)."""
        return Mounting(
            self.turn_offset_s + float(dx[TURN_OFFSET].item()),
            self.shift_offset_s + float(dx[SHIFT_OFFSET].item()),
            so3.normalise(self.R_VW @ so3.exp(np.append(dx[TILT], 0.0))),
            so3.normalise(self.R_BT @ so3.exp(dx[TURN])),
            self.p_BT + dx[LEVER],
        )

    def error(self) -> Floats:
        """(10,) how far this is from `none`, in the coordinates of `moved` (to first order in the angles)."""
        offsets = [self.turn_offset_s, self.shift_offset_s]
        return np.concatenate([offsets, so3.log(self.R_VW)[:2], so3.log(self.R_BT), self.p_BT])

    @property
    def tilt_rad(self) -> float:
        """Angle between V's vertical and gravity [rad]."""
        return float(np.arccos(np.clip(self.R_VW[2, 2], -1.0, 1.0)))

    @property
    def turn_rad(self) -> float:
        """Angle between truth's body and the IMU [rad]."""
        return float(np.linalg.norm(so3.log(self.R_BT)))

"""A source whose measurements are known beforehand and handed out when their time has come."""

from collections.abc import Sequence as ListLike

import numpy as np

from navcore.arrays import Floats, frozen
from navcore.imu import ImuSamples
from navcore.prior import BiasPrior


class ListedPrior:
    """Gives each measurement once, half a window after its stamp: when the window it sums up is over.

    Args:
        measurements: in time order, each stamped at the middle of its window.
        device: what is known of the device beforehand.
        window_s: length of the window behind a measurement [s].
        constant_covariance: (6, 6) of the error that is constant over the run.
    """

    def __init__(
        self,
        measurements: ListLike[BiasPrior] = (),
        device: BiasPrior | None = None,
        window_s: float = 0.0,
        constant_covariance: Floats | None = None,
    ) -> None:
        self.window_s = window_s
        c = np.zeros((6, 6)) if constant_covariance is None else constant_covariance
        self.constant_covariance: Floats = frozen("constant_covariance", c, np.float64, (6, 6))
        self._device = device
        self._measurements = list(measurements)
        delay_ns = round(0.5 * window_s * 1e9)
        self._available_ns = np.array([m.t_ns + delay_ns for m in self._measurements], dtype=np.int64)
        self._given = 0

    def device(self) -> BiasPrior | None:
        """What is known of this device before it moves, or None."""
        return self._device

    def add_imu(self, samples: ImuSamples) -> None:
        """Take samples; nothing here depends on them."""

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """The measurements that became available up to IMU time `t_ns`, each given once, in time order."""
        upto = max(self._given, int(np.searchsorted(self._available_ns, t_ns, side="right")))
        new = self._measurements[self._given : upto]
        self._given = upto
        return new

"""`motion:NAME`: biases under which raw IMU data obey a platform's motion model, as measurements of now."""

from dataclasses import dataclass

import numpy as np

from ipnet.motion.smoother import Inferred, Smoother
from ipnet.motion.store import MotionCard, find
from ipnet.preintegration import bounds
from ipnet.windows import MAX_GAP_S, joined, without_gaps
from navcore.arrays import Floats, Stamps
from navcore.imu import ImuNoise, ImuSamples
from navcore.prior import BiasPrior, BiasPriorSource
from navcore.sequence import Sequence

FIRST_S = 9.5
"""A run's first window; the next ones begin where it does, and end"""
EVERY_S = 5.0
"""so much later each, until they are"""
LONGEST_S = 39.5
"""long; from then on both ends move."""
SIGMA = np.repeat([0.3, 1.5], 3)
"""rad/s, m/s^2: biases before anything is seen; far wider than any device's, so that a statement is a likelihood."""
_NEWS = 0.05  # share of what was known: a direction of which less is new is not spoken of
_UNTOLD = 1e-4  # the share that is told of such a direction, since a covariance is finite


@dataclass(frozen=True)
class Known:
    """What a window tells of the biases at its end.

    Attributes:
        t_ns: the end.
        mean: (6,) b_g, b_a.
        covariance: (6, 6).
    """

    t_ns: int
    mean: Floats
    covariance: Floats

    def since(self, before: "Known | None", walk: Floats) -> BiasPrior | None:
        """What is new since an earlier window: the measurement that leads from what that told to what this one does.

        Windows overlap, so their statements are no measurements of their own. With the earlier one carried on by the
        walk of the biases, (m, P), and this one (m+, P+), the Kalman update that lies between has the information
        J = P+^-1 - P^-1 and the value m + J^-1 P+^-1 (m+ - m) (tracklets: Drummond, "Tracklets and a hybrid fusion
        with process noise", SPIE 3163, 1997). Directions with nothing new are not told.

        Args:
            before: None for the first window, which is new as a whole.
            walk: (6,) variances that biases gain in a second.

        Returns:
            None where nothing is new.
        """
        if before is None:
            return BiasPrior(self.t_ns, self.mean[:3], self.mean[3:], self.covariance)
        P = before.covariance + np.diag(walk) * (self.t_ns - before.t_ns) * 1e-9
        now = np.linalg.inv(self.covariance)
        root = np.linalg.cholesky(P)
        share, axes = np.linalg.eigh(root.T @ now @ root - np.eye(6))  # J in axes in which P is one
        new = share > _NEWS
        if not new.any():
            return None
        T = root @ axes
        gain = T.T @ now @ (self.mean - before.mean)
        value = before.mean + T @ np.where(new, gain / np.where(new, share, 1.0), 0.0)
        covariance = (T / np.where(new, share, _UNTOLD)) @ T.T
        return BiasPrior(self.t_ns, value[:3], value[3:], 0.5 * (covariance + covariance.T))


class MotionPrior:
    """The source. After a gap in the samples it begins anew.

    Attributes:
        card: what it was made from.
        known: what the last window tells.
    """

    def __init__(self, card: MotionCard, noise: ImuNoise) -> None:
        self.card = card
        self.window_s = EVERY_S
        R6 = card.R6
        self.constant_covariance: Floats = R6.T @ card.errors.constant @ R6
        self._smoother = Smoother(card.model, noise, SIGMA)
        self._walk = np.repeat([noise.gyroscope_random_walk**2, noise.accelerometer_random_walk**2], 3)
        self._step_ns = round(card.model.interval_s * 1e9)
        self._begin()
        self._ready: list[BiasPrior] = []

    def _begin(self) -> None:
        self._parts: list[ImuSamples] = []
        self._begin_ns: int | None = None  # of the next window
        self._length_ns = round(FIRST_S * 1e9)
        self.known: Known | None = None

    def device(self) -> BiasPrior | None:
        """Nothing is known of a device."""
        return None

    def add_imu(self, samples: ImuSamples) -> None:
        """Take new samples, in time order."""
        for part in without_gaps(samples):
            self._add(part)

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """What the windows that the samples added so far have completed tell anew, each once."""
        ready, self._ready = self._ready, []
        return ready

    def _add(self, samples: ImuSamples) -> None:
        if self._parts and samples.t_ns[0] - self._parts[-1].t_ns[-1] > MAX_GAP_S * 1e9:
            self._begin()
        self._parts.append(samples)  # joined when a window is over: not for every frame
        if self._begin_ns is None:
            first = joined(*self._parts)
            if len(first) < 2:
                return
            self._begin_ns = int(bounds(first.t_ns[:2])[0])
        # The end of the last sample depends on the one that follows; 0.1 s is longer than any interval.
        while self._parts[-1].t_ns[-1] > self._begin_ns + self._length_ns + round(MAX_GAP_S * 1e9):
            held = joined(*self._parts)
            self._infer(held, self._begin_ns)
            end_ns = self._begin_ns + self._length_ns + round(EVERY_S * 1e9)
            self._length_ns = min(self._length_ns + round(EVERY_S * 1e9), round(LONGEST_S * 1e9))
            self._begin_ns = end_ns - self._length_ns
            self._parts = [held.between(self._begin_ns - 1_000_000_000, int(held.t_ns[-1]) + 1)]

    def _infer(self, held: ImuSamples, begin_ns: int) -> None:
        """Say what is new in the window that begins there."""
        end_ns = begin_ns + self._length_ns
        edges: Stamps = np.arange(begin_ns, end_ns + 1, self._step_ns, dtype=np.int64)
        found = self._smoother.infer(held, edges, None if self.known is None else self.known.mean)
        if found is None:
            return
        known = Known(int(edges[-1]), found.mean, self._covariance(found))
        told = known.since(self.known, self._walk)
        if told is not None:
            self._ready.append(told)
        self.known = known

    def _covariance(self, found: Inferred) -> Floats:
        """(6, 6) of the smoother, as calibrated, and more where motion is not as it was learned."""
        R6, errors = self.card.R6, self.card.errors
        sd = errors.scale * max(found.cost, 1.0) ** 0.25
        scaled = sd[:, None] * (R6 @ found.covariance @ R6.T) * sd
        covariance: Floats = R6.T @ (scaled + np.diag(errors.floor**2)) @ R6
        return 0.5 * (covariance + covariance.T)


def make(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """The source with the shipped model of that name, or the file at that path.

    Raises:
        ConfigError: there is none; the message lists the names.
    """
    card = MotionCard.read(find(argument))
    return MotionPrior(card, card.noise if sequence is None else sequence.calibration.imu)

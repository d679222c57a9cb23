"""`motion:NAME`: biases under which raw IMU data obey a platform's motion model, window by window."""

from itertools import chain

import numpy as np

from ipnet.motion.smoother import Inferred, Smoother
from ipnet.motion.store import MotionCard, find
from ipnet.preintegration import bounds
from ipnet.windows import MAX_GAP_S, joined, without_gaps
from navcore.arrays import Floats, Stamps
from navcore.imu import ImuNoise, ImuSamples
from navcore.prior import BiasPrior, BiasPriorSource
from navcore.sequence import Sequence

LENGTHS_S = (9.5, 19.5, 39.5, 59.0)
"""A run's first windows, all from its beginning; then windows of the last length,"""
EVERY_S = 20.0
"""one after so many seconds."""
SIGMA = np.repeat([0.3, 1.5], 3)
"""rad/s, m/s^2: biases before anything is seen; far wider than any device's, so that a statement is a likelihood."""


_HEADING = np.arange(6) == 0
"""The gyroscope along the usual force: what successive windows say of it is related most (0.6 at an overlap of 0.66,
measured on simulated flights, where other axes have 0.15 to 0.29)."""


class MotionPrior:
    """The source. After a gap in the samples it begins anew."""

    def __init__(self, card: MotionCard, noise: ImuNoise) -> None:
        self.card = card
        self.window_s = 0.5 * LENGTHS_S[0]
        R6 = card.R6
        self.constant_covariance: Floats = R6.T @ card.errors.constant @ R6
        self._smoother = Smoother(card.model, noise, SIGMA)
        self._step_ns = round(card.model.interval_s * 1e9)
        self._begin()
        self._ready: list[BiasPrior] = []

    def _begin(self) -> None:
        self._parts: list[ImuSamples] = []
        self._end_ns: int | None = None  # of the next window
        self._lengths = chain(LENGTHS_S, iter(lambda: LENGTHS_S[-1], None))
        self._length_ns = round(next(self._lengths) * 1e9)
        self._told_ns: int | None = None  # end of the last window that was spoken of
        self._bias: Floats | None = None

    def device(self) -> BiasPrior | None:
        """Nothing is known of a device."""
        return None

    def add_imu(self, samples: ImuSamples) -> None:
        """Take new samples, in time order."""
        for part in without_gaps(samples):
            self._add(part)

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """The windows that the samples added so far have completed, each once."""
        ready, self._ready = self._ready, []
        return ready

    def _add(self, samples: ImuSamples) -> None:
        if self._parts and samples.t_ns[0] - self._parts[-1].t_ns[-1] > MAX_GAP_S * 1e9:
            self._begin()
        self._parts.append(samples)  # joined when a window is over: not for every frame
        if self._end_ns is None:
            first = joined(*self._parts)
            if len(first) < 2:
                return
            self._end_ns = int(bounds(first.t_ns[:2])[0]) + self._length_ns
        # The end of the last sample depends on the one that follows; 0.1 s is longer than any interval.
        while self._parts[-1].t_ns[-1] > self._end_ns + round(MAX_GAP_S * 1e9):
            self._parts = [self._infer(joined(*self._parts), self._end_ns)]
            before = self._length_ns
            self._length_ns = round(next(self._lengths) * 1e9)
            self._end_ns += self._length_ns - before or round(EVERY_S * 1e9)

    def _infer(self, held: ImuSamples, end_ns: int) -> ImuSamples:
        """Speak of the window that ends there; returns the samples that later ones need."""
        begin_ns = end_ns - self._length_ns
        edges: Stamps = np.arange(begin_ns, end_ns + 1, self._step_ns, dtype=np.int64)
        found = self._smoother.infer(held, edges, self._bias)
        if found is not None:
            self._bias = found.mean
            covariance = self._covariance(found, begin_ns)
            middle_ns = int(edges[(len(edges) - 1) // 2])
            self._ready.append(BiasPrior(middle_ns, found.mean[:3], found.mean[3:], covariance))
            self._told_ns = end_ns
        keep_ns = end_ns + round((EVERY_S - LENGTHS_S[-1] - 1.0) * 1e9)
        return held.between(keep_ns, int(held.t_ns[-1]) + 1)

    def _covariance(self, found: Inferred, begin_ns: int) -> Floats:
        """(6, 6) of a statement's own error: the smoother's, as calibrated; what it saw before is not told again."""
        seen_ns = 0 if self._told_ns is None else max(self._told_ns - begin_ns, 0)
        overlap = min(seen_ns / self._length_ns, 0.9)
        new = np.where(_HEADING, 1.0 - overlap, 1.0 - overlap**2)
        sd = self.card.errors.scale * max(found.cost, 1.0) ** 0.25 / np.sqrt(new)
        R6, errors = self.card.R6, self.card.errors
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

"""`ipnet:NAME`: what networks say of the biases, window by window. Runs on onnxruntime alone."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ipnet.directions import for_both
from ipnet.exported import open_exported
from ipnet.weights import NETWORKS, Card, NetworkCard, find
from ipnet.windows import ImuWindow, WindowStream
from navcore.arrays import Floats, Rotations
from navcore.imu import ImuSamples
from navcore.prior import BiasPrior, BiasPriorSource
from navcore.sequence import Sequence

ONNX = ".onnx"


@dataclass(frozen=True)
class Statement:
    """What a network says of a window.

    Attributes:
        bias: (6,) b_g [rad/s], b_a [m/s^2] in B.
        variance: (6,) as stated: of Laplace's distribution; in the network's frame.
        R_NB: (3, 3) to that frame, whose z is the mean specific force.
    """

    bias: Floats
    variance: Floats
    R_NB: Rotations


class Network:
    """An exported network."""

    def __init__(self, path: Path) -> None:
        self._session = open_exported(path)

    def __call__(self, values: Floats) -> Statement:
        """Of a window's values (n, 6)."""
        found = self._session.run(["bias", "scale", "frame"], {"window": values[None].astype(np.float32)})
        bias, scale, R_NB = (part[0].astype(np.float64) for part in found)
        return Statement(bias, 2.0 * scale**2, R_NB)


class _Voice:
    """One network and the windows that it sees."""

    def __init__(self, path: Path, card: NetworkCard, until_s: float) -> None:
        self.card = card
        self.network = Network(path)
        self._until_s = until_s  # of middles of windows, from the beginning of the data or the end of a gap
        self._stream = WindowStream(card.grid)
        self._previous: ImuWindow | None = None
        self._since_ns = 0

    @property
    def times(self) -> float:
        """How often it speaks."""
        return 1.0 + (self._until_s - 0.5 * self.card.grid.seconds) // self.card.every_s

    def add(self, samples: ImuSamples, more: Floats) -> Iterator[BiasPrior]:
        """Statements about the windows that are complete now.

        Windows that overlap share their errors: one that brings only a part of new data counts for that part.

        Args:
            samples: IMU samples.
            more: (6,) variances that each statement bears beside its own.
        """
        every_ns = round(self.card.every_s * 1e9)
        for window in self._stream.add(samples):
            goes_on = self._previous is not None and window.begin_ns == self._previous.begin_ns + every_ns
            if not goes_on:
                self._since_ns = window.begin_ns
            self._previous = window
            if window.middle_ns - self._since_ns > self._until_s * 1e9 + 1e6:
                continue
            said = self.network(window.values)
            overlap = max(self.card.grid.seconds / self.card.every_s, 1.0) if goes_on else 1.0
            variance = self.card.errors.variance(said.variance) * overlap + more
            covariance = in_body(np.diag(variance), said.R_NB)
            yield BiasPrior(window.middle_ns, said.bias[:3], said.bias[3:], covariance)


class NetworkPrior:
    """The source: each network until the middle of the next longer one's first window.

    Stamps increase so. A run has one `constant_covariance`, the longest network's: what others have more of constant
    error counts as short-lived.
    """

    def __init__(self, folder: Path, card: Card) -> None:
        cards = [(name, card.networks[name]) for name in NETWORKS if name in card.networks]
        middles = [0.5 * c.grid.seconds for _, c in cards]
        self.window_s = min(middles[0], cards[0][1].every_s)  # all count: overlaps are in the covariances
        untils = [*(middle - middles[0] for middle in middles[1:]), np.inf]
        self._voices = [
            _Voice(folder / f"{name}{ONNX}", c, until) for (name, c), until in zip(cards, untils, strict=True)
        ]
        last = self._voices[-1]
        self._constant = last.card.errors.constant
        self.constant_covariance = _constant_in_body(last)
        self._ready: list[BiasPrior] = []

    def device(self) -> BiasPrior | None:
        """Nothing is known of a device."""
        return None

    def add_imu(self, samples: ImuSamples) -> None:
        """Take new samples, in time order."""
        ready = [z for voice in self._voices for z in voice.add(samples, self._more_constant(voice))]
        self._ready += sorted(ready, key=lambda z: z.t_ns)

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """The windows that the samples added so far have completed, each once."""
        ready, self._ready = self._ready, []
        return ready

    def _more_constant(self, voice: _Voice) -> Floats:
        """(6,) what a network's constant error has beyond the longest one's.

        It is one error that is told so many times: each statement bears it that many times, or it would average out.
        """
        if voice is self._voices[-1]:
            return np.zeros(6)
        more = np.diagonal(voice.card.errors.constant) - np.diagonal(self._constant)
        return np.maximum(voice.times * more, 0.0)


def in_body(covariance: Floats, R_NB: Rotations) -> Floats:
    """(6, 6) of the network's frame in B."""
    R = for_both(R_NB)
    turned: Floats = R.T @ covariance @ R
    return 0.5 * (turned + turned.T)


def _constant_in_body(voice: _Voice) -> Floats:
    """(6, 6) covariance of the constant error in B, before there is any data.

    Where the mount may be any, the frame is not known then: each sensor's axes are as wrong as they are on average.
    """
    constant = voice.card.errors.constant
    if voice.card.config.mount == "fixed":
        return in_body(constant, voice.network(np.ones((voice.card.config.samples, 6))).R_NB)
    return np.diag(np.repeat(np.diagonal(constant).reshape(2, 3).mean(axis=1), 3))


def make(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """The source with the weights of that name or in that folder.

    Raises:
        ConfigError: there are none; the message lists the names.
    """
    folder = find(argument)
    return NetworkPrior(folder, Card.read(folder))

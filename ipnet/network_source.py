"""`ipnet:NAME`: what a network says of the biases, window by window. Runs on onnxruntime alone."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnxruntime

from ipnet.weights import NETWORKS, Card, NetworkCard, find
from ipnet.windows import ImuWindow, WindowStream
from navcore.arrays import Floats
from navcore.imu import ImuSamples
from navcore.prior import BiasPrior, BiasPriorSource
from navcore.sequence import Sequence

ONNX = ".onnx"


class Network:
    """An exported network; one thread, so that the same input gives the same bits."""

    def __init__(self, path: Path) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        self._session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])

    def __call__(self, window: ImuWindow) -> tuple[Floats, Floats]:
        """(6,) b_g [rad/s], b_a [m/s^2], and (6,) their variances as stated: of Laplace's distribution."""
        bias, scale = self._session.run(["bias", "scale"], {"window": window.values[None].astype(np.float32)})
        return bias[0].astype(np.float64), 2.0 * scale[0].astype(np.float64) ** 2


class _Voice:
    """One network and the windows that it sees."""

    def __init__(self, path: Path, card: NetworkCard) -> None:
        self.card = card
        self._network = Network(path)
        self._stream = WindowStream(card.grid)
        self._previous: ImuWindow | None = None
        self.since_ns = 0  # begin of the first window since the last gap

    def add(self, samples: ImuSamples) -> Iterator[BiasPrior]:
        """Statements about the windows that are complete now.

        Windows that overlap share their errors: one that brings only a part of new data counts for that part.
        """
        every_ns = round(self.card.every_s * 1e9)
        for window in self._stream.add(samples):
            goes_on = self._previous is not None and window.begin_ns == self._previous.begin_ns + every_ns
            if not goes_on:
                self.since_ns = window.begin_ns
            self._previous = window
            bias, stated = self._network(window)
            overlap = max(self.card.grid.seconds / self.card.every_s, 1.0) if goes_on else 1.0
            variance = self.card.errors.variance(stated) * overlap
            yield BiasPrior(window.middle_ns, bias[:3], bias[3:], np.diag(variance))


class NetworkPrior:
    """The source: the short network until the middle of the long one's first window, from then on the long one.

    Stamps increase so. A run has one `constant_covariance`, the long network's: what the short one has more of constant
    error counts as short-lived. Statements are apart by the shorter window at least.
    """

    def __init__(self, folder: Path, card: Card) -> None:
        voices = {name: _Voice(folder / f"{name}{ONNX}", c) for name, c in card.networks.items()}
        self._last = voices.get("long", voices["short"]) if "short" in voices else voices["long"]
        self._first = voices["short"] if len(voices) == len(NETWORKS) else None
        apart = [min(v.card.grid.seconds, v.card.every_s) for v in (self._first, self._last) if v is not None]
        self.window_s = min(apart)
        self.constant_covariance: Floats = self._last.card.errors.constant
        self._ready: list[BiasPrior] = []

    def device(self) -> BiasPrior | None:
        """Nothing is known of a device."""
        return None

    def add_imu(self, samples: ImuSamples) -> None:
        """Take new samples, in time order."""
        ready = list(self._last.add(samples))
        if self._first is not None:
            card = self._first.card
            reach_s = 0.5 * self._last.card.grid.seconds - self.window_s  # of the short windows' middles
            times = 1 + int((reach_s - 0.5 * card.grid.seconds) / card.every_s)
            for z in self._first.add(samples):
                if z.t_ns <= self._first.since_ns + round(reach_s * 1e9):
                    ready.append(self._with_more_constant(z, card, times))
        self._ready += sorted(ready, key=lambda z: z.t_ns)

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """The windows that the samples added so far have completed, each once."""
        ready, self._ready = self._ready, []
        return ready

    def _with_more_constant(self, z: BiasPrior, card: NetworkCard, times: int) -> BiasPrior:
        """What the short network's constant error has beyond the long one's, added to its own.

        It is one error that is told so many times: each of them bears it that many times, or it would average out.
        """
        more = np.diagonal(card.errors.constant) - np.diagonal(self.constant_covariance)
        return BiasPrior(z.t_ns, z.b_g, z.b_a, z.covariance + times * np.diag(np.maximum(more, 0.0)))


def make(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """The source with the weights of that name or in that folder.

    Raises:
        ConfigError: there are none; the message lists the names.
    """
    folder = find(argument)
    return NetworkPrior(folder, Card.read(folder))

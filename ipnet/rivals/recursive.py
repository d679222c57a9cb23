"""`recursive:NAME`: a network that takes its own past bias as input. Runs on onnxruntime alone."""

from pathlib import Path

import numpy as np
import onnxruntime

from ipnet.rivals.shipped import find
from ipnet.weights import Card
from ipnet.windows import Grid, WindowStream
from navcore.arrays import Floats
from navcore.imu import ImuSamples
from navcore.prior import BiasPrior, BiasPriorSource
from navcore.sequence import Sequence

STEP_S = 1.0
STEP_FILE = "step.onnx"


class RecursivePrior:
    """The source: a statement a second, from that second's samples and the statement before."""

    def __init__(self, folder: Path, card: Card) -> None:
        network = card.networks["long"]
        self.window_s = network.grid.seconds
        self.constant_covariance: Floats = network.errors.constant
        self._errors = network.errors
        self._past: Floats = np.array(card.made["start"])
        self._stream = WindowStream(Grid(STEP_S, network.config.rate_hz, STEP_S))
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        self._session = onnxruntime.InferenceSession(folder / STEP_FILE, options, providers=["CPUExecutionProvider"])
        self._ready: list[BiasPrior] = []

    def device(self) -> BiasPrior | None:
        """Nothing is known of a device beyond what the network remembers, which is in its statements."""
        return None

    def add_imu(self, samples: ImuSamples) -> None:
        """Take new samples, in time order."""
        for window in self._stream.add(samples):
            inputs = {"samples": window.values[None], "past": self._past[None]}
            bias, scale = self._session.run(None, {name: x.astype(np.float32) for name, x in inputs.items()})
            self._past = bias[0].astype(np.float64)
            covariance = np.diag(self._errors.variance(2.0 * scale[0].astype(np.float64) ** 2))
            self._ready.append(BiasPrior(window.middle_ns, self._past[:3], self._past[3:], covariance))

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """The seconds that are over, each once; `t_ns` is never before the samples that were added."""
        ready, self._ready = self._ready, []
        return ready


def make(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """The source with the weights of that name or in that folder.

    Raises:
        ConfigError: there are none; the message lists the names.
    """
    folder = find("recursive", argument)
    return RecursivePrior(folder, Card.read(folder))

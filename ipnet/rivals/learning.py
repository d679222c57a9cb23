"""Trains the networks of `ipnet.rivals.networks` with the loop that trains ours, and ships them in the same way."""

import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ipnet.calibration import ErrorModel, fit
from ipnet.dataset import Track, open_tracks
from ipnet.export import ONNX, OPSET, export
from ipnet.model import BiasNetwork
from ipnet.network_source import NetworkPrior
from ipnet.presets import TrainingConfig
from ipnet.recordings import open_recordings
from ipnet.rivals.networks import CONFIG, RATE_HZ, STEP, Corrector, Recursive, increment_loss
from ipnet.rivals.recursive import STEP_FILE, RecursivePrior
from ipnet.runs import Span, cut, listen
from ipnet.training import BiasModule, loss, train
from ipnet.weights import Card, NetworkCard, uncalibrated
from navcore.arrays import Floats
from navcore.prior import BiasPriorSource

RUN_S = 30.0
"""Length of the runs that calibration hears."""


@dataclass(frozen=True)
class Lessons:
    """What a rival is made from.

    Attributes:
        training, validation: recordings.
        spans: runs of the validation recordings, for calibration.
        config: of training: without offsets or other mounts, as published.
        seed: of weights and windows.
    """

    training: list[Track]
    validation: list[Track]
    spans: list[Span]
    config: TrainingConfig
    seed: int

    @staticmethod
    def read(
        training: Iterable[Path], validation: Iterable[Path], labels: Path | None, kept: Path, epochs: int, seed: int
    ) -> "Lessons":
        """From folders of recordings; what was read once is kept in a folder."""
        tracks, chosen_by = open_tracks(training, labels, kept), open_tracks(validation, labels, kept)
        spans = cut(open_recordings(validation, labels), RUN_S)
        config = TrainingConfig(windows=16, epochs=epochs, patience=30, mount_deg=0.0)
        return Lessons(tracks, chosen_by, spans, config, seed)

    @property
    def mean(self) -> Floats:
        """(6,) of the training recordings' biases."""
        mean: Floats = np.mean([track.bias.mean(axis=0) for track in self.training], axis=0)
        return mean

    @property
    def spread(self) -> Floats:
        """(6,) their sd, at least a ten thousandth."""
        spread: Floats = np.std([track.bias.mean(axis=0) for track in self.training], axis=0) + 1e-4
        return spread


class RecursionModule(BiasModule):
    """Learns from everything that is said on the way."""

    def training_step(self, batch: tuple[Tensor, Tensor], index: int) -> Tensor:
        """Mean loss of all estimates."""
        window, label = batch
        losses = [loss(self.config.loss, *found, label).mean() for found in self.network.estimates(window)]
        return torch.stack(losses).mean()


class IncrementModule(BiasModule):
    """Learns what corrected samples integrate to, and how wrong their mean correction is."""

    def training_step(self, batch: tuple[Tensor, Tensor], index: int) -> Tensor:
        """Distance of increments, and the likelihood of the mean for the scale alone."""
        window, label = batch
        assert isinstance(self.network, Corrector)
        correction = self.network.correction(window)
        own = increment_loss(window - correction, window - label[:, None], 1.0 / RATE_HZ).mean()
        _, scale = self.network(window)
        off = (correction.mean(1).detach() - label).abs()
        total: Tensor = own + (torch.log(2.0 * scale) + off / scale).mean()
        return total


def learn_recursive(lessons: Lessons, out: Path) -> None:
    """Train `recursive`, calibrate it, and write it into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(lessons.seed)
    network = Recursive(_tensor(lessons.mean), _tensor(lessons.spread))
    _train(network, lessons, out, RecursionModule)
    _export_step(network, out / STEP_FILE)
    _ship(lessons, out, 1.0, RecursivePrior)


def learn_corrector(lessons: Lessons, out: Path) -> None:
    """Train `corrector`, calibrate it, and write it into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(lessons.seed)
    network = Corrector(_tensor(lessons.mean))
    _train(network, lessons, out, IncrementModule)
    export(network, out / f"long{ONNX}")
    _ship(lessons, out, 2.0, NetworkPrior)


def _train(network: BiasNetwork, lessons: Lessons, out: Path, module: type[BiasModule]) -> None:
    training, validation = lessons.training, lessons.validation
    train(network, lessons.config, training, validation, out / "log", seed=lessons.seed, module=module)


def _ship(lessons: Lessons, out: Path, every_s: float, source: Callable[[Path, Card], BiasPriorSource]) -> None:
    """Hear what it says on runs of the validation recordings, and write the card."""
    made = {"start": lessons.mean.tolist(), "seed": lessons.seed, "config": vars(lessons.config)}
    training, validation = (tuple(t.name for t in part) for part in (lessons.training, lessons.validation))

    def card(errors: ErrorModel) -> Card:
        return Card({"long": NetworkCard(CONFIG, every_s, errors)}, training, validation, made)

    runs = [listen(source(out, card(uncalibrated())), span) for span in lessons.spans]
    errors = [replace(run.errors, recording=f"{run.span.recording} {k}") for k, run in enumerate(runs)]
    card(fit(errors, runs[0].window_s)).write(out)


def _tensor(values: Floats) -> Tensor:
    return torch.from_numpy(values.astype(np.float32))


def _export_step(network: Recursive, path: Path) -> None:
    """ONNX: `samples` (1, 50, 6), `past` (1, 6) to `bias`, `scale` (1, 6), float32."""
    network.eval()
    partial = path.with_suffix(".partial")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of traced shapes: they are constant
        torch.onnx.export(
            network.step,
            (torch.zeros(1, STEP, 6), torch.zeros(1, 6)),
            partial,
            input_names=["samples", "past"],
            output_names=["bias", "scale"],
            opset_version=OPSET,
            dynamo=False,
        )
    partial.replace(path)

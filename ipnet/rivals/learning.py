"""Trains the networks of `ipnet.rivals.networks` with the loop that trains ours, and ships them in the same way."""

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from ipnet.assessment import fitted, remembered
from ipnet.calibration import ErrorModel
from ipnet.dataset import Track, open_tracks
from ipnet.export import OPSET
from ipnet.model import BiasNetwork
from ipnet.presets import TrainingConfig
from ipnet.recordings import kept_apart, open_recordings
from ipnet.rivals.learned import ONNX, LearnedPrior, RivalCard
from ipnet.rivals.networks import CONFIG, STEP, Corrector, Recursive, increment_loss
from ipnet.runs import Span, cut, listen
from ipnet.training import BiasModule, loss, train
from ipnet.weights import uncalibrated
from ipnet.windows import Grid
from navcore.arrays import Floats

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
        """From folders of recordings; what was read once is kept in a folder.

        Raises:
            LabelError: see `open_tracks`, or a recording is of both kinds.
        """
        tracks, chosen_by = open_tracks(training, labels, kept), open_tracks(validation, labels, kept)
        kept_apart((t.name for t in tracks), (t.name for t in chosen_by))
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
        own = increment_loss(window - correction, window - label[:, None], 1.0 / CONFIG.rate_hz).mean()
        _, scale = self.network(window)
        off = (correction.mean(1).detach() - label).abs()
        total: Tensor = own + (torch.log(2.0 * scale) + off / scale).mean()
        return total


def learn_recursive(lessons: Lessons, out: Path) -> None:
    """Train `recursive`, calibrate it, and write it into a folder."""
    torch.manual_seed(lessons.seed)
    network = Recursive(_tensor(lessons.mean), _tensor(lessons.spread))
    _train(network, lessons, out, RecursionModule)
    step_s = STEP / CONFIG.rate_hz
    inputs = {"window": torch.zeros(1, STEP, 6), "past": torch.zeros(1, 6)}
    _ship(lessons, out, network.step, inputs, Grid(step_s, CONFIG.rate_hz, step_s), lessons.mean)


def learn_corrector(lessons: Lessons, out: Path) -> None:
    """Train `corrector`, calibrate it, and write it into a folder."""
    torch.manual_seed(lessons.seed)
    network = Corrector(_tensor(lessons.mean))
    _train(network, lessons, out, IncrementModule)
    _ship(lessons, out, network, {"window": torch.zeros(1, CONFIG.samples, 6)}, CONFIG.grid(2.0), None)


def _train(network: BiasNetwork, lessons: Lessons, out: Path, module: type[BiasModule]) -> None:
    training, validation = lessons.training, lessons.validation
    train(network, lessons.config, training, validation, out / "log", seed=lessons.seed, module=module)


def _ship(
    lessons: Lessons, out: Path, network: nn.Module, inputs: dict[str, Tensor], grid: Grid, start: Floats | None
) -> None:
    """Export it, hear what it says on runs of the validation recordings, and write the card."""
    _export(network, inputs, out / ONNX)
    training, validation = (tuple(t.name for t in part) for part in (lessons.training, lessons.validation))
    made = {"seed": lessons.seed, "config": vars(lessons.config)}
    card = RivalCard(grid, start, uncalibrated(), training, validation, made)
    replace(card, errors=calibrate(lessons, out, card)).write(out)


def calibrate(lessons: Lessons, folder: Path, card: RivalCard) -> ErrorModel:
    """What is wrong with the statements of the weights in a folder, on runs of the validation recordings.

    Such networks can remember their device: a memory's error is one and the same in all runs of a recording.
    """
    runs = [listen(LearnedPrior(folder, replace(card, errors=uncalibrated())), span) for span in lessons.spans]
    errors = [run.errors for run in runs]
    model = fitted(errors, runs[0].window_s)
    return remembered(model, len({e.recording for e in errors}), lessons.training, np.eye(3))


def _export(network: nn.Module, inputs: dict[str, Tensor], path: Path) -> None:
    """ONNX: the inputs, float32, to `bias` (1, 6) and `scale` (1, 6)."""
    network.eval()
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of traced shapes: they are constant
        torch.onnx.export(
            network,
            tuple(inputs.values()),
            partial,
            input_names=list(inputs),
            output_names=["bias", "scale"],
            opset_version=OPSET,
            dynamo=False,
        )
    partial.replace(path)


def _tensor(values: Floats) -> Tensor:
    return torch.from_numpy(values.astype(np.float32))

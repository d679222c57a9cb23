"""`recursive:NAME` and `corrector:NAME`: networks that others have proposed. Run on onnxruntime alone."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ipnet.calibration import ErrorModel
from ipnet.errors import ConfigError
from ipnet.exported import open_exported
from ipnet.files import write_text
from ipnet.windows import Grid, ImuWindow, WindowStream
from navcore.arrays import Floats, frozen
from navcore.imu import ImuSamples
from navcore.prior import BiasPrior, BiasPriorSource
from navcore.sequence import Sequence

FOLDER = Path(__file__).parent / "weights"
CARD, ONNX = "card.json", "network.onnx"
WINDOW_S = 10.0
"""Statements closer than this share their error."""


@dataclass(frozen=True)
class RivalCard:
    """What is known of a rival's weights.

    Attributes:
        grid: windows that the network sees.
        start: (6,) bias that its first statement goes on from; None if it does not look at the last one.
        errors: of its statements.
        training, validation: names of recordings that it was made from.
        made: with what it was trained.
    """

    grid: Grid
    start: Floats | None
    errors: ErrorModel
    training: tuple[str, ...]
    validation: tuple[str, ...]
    made: dict[str, Any]

    def __post_init__(self) -> None:
        if self.start is not None:
            object.__setattr__(self, "start", frozen("start", self.start, np.float64, (6,)))

    def write(self, folder: Path) -> None:
        """Write `card.json`."""
        start = None if self.start is None else self.start.tolist()
        content = {**vars(self), "grid": vars(self.grid), "start": start, "errors": self.errors.as_dict()}
        write_text(folder / CARD, json.dumps(content, indent=1) + "\n")

    @staticmethod
    def read(folder: Path) -> "RivalCard":
        """The card in a folder.

        Raises:
            ConfigError: the content is not a card.
        """
        try:
            content = json.loads((folder / CARD).read_text(encoding="utf-8"))
            return RivalCard(
                **{
                    **content,
                    "grid": Grid(**content["grid"]),
                    "errors": ErrorModel.from_dict(content["errors"]),
                    "training": tuple(content["training"]),
                    "validation": tuple(content["validation"]),
                }
            )
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError(f"{folder / CARD}: {error!r}; expected what `recursive` and `corrector` write") from error


class LearnedPrior:
    """The source: a statement for each window, from its samples and, if it has a start, from the statement before."""

    def __init__(self, folder: Path, card: RivalCard) -> None:
        self.window_s = WINDOW_S
        self.constant_covariance: Floats = card.errors.constant
        self._errors, self._past = card.errors, card.start
        self._stream = WindowStream(card.grid)
        self._session = open_exported(folder / ONNX)
        self._ready: list[BiasPrior] = []

    def device(self) -> BiasPrior | None:
        """Nothing is known of a device beyond what the network remembers, which is in its statements."""
        return None

    def add_imu(self, samples: ImuSamples) -> None:
        """Take new samples, in time order."""
        self._ready += [self._statement(window) for window in self._stream.add(samples)]

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """The windows that the samples added so far have completed, each once."""
        ready, self._ready = self._ready, []
        return ready

    def _statement(self, window: ImuWindow) -> BiasPrior:
        inputs = {"window": window.values}
        if self._past is not None:
            inputs["past"] = self._past
        bias, scale = self._session.run(None, {name: x[None].astype(np.float32) for name, x in inputs.items()})
        said: Floats = bias[0].astype(np.float64)
        if self._past is not None:
            self._past = said
        variance = self._errors.variance(2.0 * scale[0].astype(np.float64) ** 2)  # of Laplace's distribution
        return BiasPrior(window.middle_ns, said[:3], said[3:], np.diag(variance))


def make_recursive(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """A network that takes its own past bias as input; `argument`: a name of weights or a folder.

    Raises:
        ConfigError: there are none; the message lists the names.
    """
    return _make("recursive", argument)


def make_corrector(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """A network that corrects samples; `argument`: a name of weights or a folder.

    Raises:
        ConfigError: there are none; the message lists the names.
    """
    return _make("corrector", argument)


def find(rival: str, argument: str) -> Path:
    """The folder of a rival's weights: a shipped name, or a folder's path.

    Raises:
        ConfigError: there are none; the message lists the names.
    """
    for folder in (FOLDER / rival / argument, Path(argument)):
        if argument and (folder / CARD).is_file():
            return folder
    known = ", ".join(sorted(p.parent.name for p in FOLDER.glob(f"{rival}/*/{CARD}"))) or "none"
    raise ConfigError(f"{rival} {argument!r} is unknown; known are {known}, or a folder with {CARD}")


def _make(rival: str, argument: str) -> BiasPriorSource:
    folder = find(rival, argument)
    return LearnedPrior(folder, RivalCard.read(folder))

"""Recordings whose biases are known: what is learned from and scored on.

Biases that a recording's truth holds are the reference; a label counts where it holds none. Only a score can be asked
for the labels' word first.
"""

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ipnet.errors import LabelError
from navcore.arrays import Floats, Stamps, frozen
from navcore.imu import ImuNoise, ImuSamples
from navcore.readers import open_sequence
from navcore.sequence import Sequence
from navcore.trajectory import Trajectory

PUBLIC_LABELS = Path(__file__).with_name("labels") / "public.json"
"""Labels of the public recordings, by the names that they have as downloaded."""
FILTER_LABELS = PUBLIC_LABELS.with_name("filter.json")
"""The same from the filter's own paths on replays, without motion capture."""


@dataclass(frozen=True)
class Label:
    """One bias for a whole sequence.

    Attributes:
        sequence: the recording's name.
        bias: (6,) b_g [rad/s], b_a [m/s^2].
        covariance: (6, 6).
    """

    sequence: str
    bias: Floats
    covariance: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "bias", frozen("bias", self.bias, np.float64, (6,)))
        object.__setattr__(self, "covariance", frozen("covariance", self.covariance, np.float64, (6, 6)))
        if not (np.isfinite(self.bias).all() and np.isfinite(self.covariance).all()):
            raise LabelError(f"{self.sequence}: bias {self.bias} or its covariance is not finite")


@dataclass(frozen=True)
class Recording:
    """IMU samples and what is known of their biases.

    Attributes:
        name: for people; nothing is chosen by it.
        imu: all samples.
        noise: of the IMU.
        truth: the path of the body, or None.
        label: mean bias of the sequence: of the truth where that has finite biases, else as it was given.
    """

    name: str
    imu: ImuSamples
    noise: ImuNoise
    truth: Trajectory | None
    label: Label

    def bias_at(self, t_ns: Stamps) -> Floats:
        """(N, 6) b_g, b_a: the truth's at that time where it has any, else the label's."""
        known = _with_biases(self.truth)
        if known is None:
            return np.tile(self.label.bias, (len(t_ns), 1))
        there = known.at(t_ns)
        assert there.b_g is not None and there.b_a is not None
        return np.hstack([there.b_g, there.b_a])


def read_labels(path: Path) -> dict[str, Label]:
    """Labels by sequence from a file that `python -m ipnet label` wrote.

    Raises:
        LabelError: the file is missing or its content is not a list of labels.
    """
    expected = "a list of {sequence, b_g (3 rad/s), b_a (3 m/s^2), covariance (6x6)}"
    if not path.is_file():
        raise LabelError(f"{path}: no such file; expected {expected}")
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))
        labels = [Label(str(r["sequence"]), np.array([*r["b_g"], *r["b_a"]]), r["covariance"]) for r in rows]
    except (ValueError, TypeError, KeyError) as error:
        raise LabelError(f"{path}: {error!r}; expected {expected}") from error
    return {label.sequence: label for label in labels}


def open_recordings(
    paths: Iterable[Path], labels: Path | None = None, labels_first: bool = False, names: Iterable[str] | None = None
) -> list[Recording]:
    """The recordings in folders: each path is one, or holds some at any depth.

    Args:
        paths: folders.
        labels: for those whose truth has no biases.
        labels_first: a recording that has a label goes by it, also if its truth has biases.
        names: of those to take; None for all.

    Raises:
        LabelError: a path holds no recording, two recordings have one name, one of `names` is not there, a recording
            has neither true biases nor a label, or labels come first and there are none.
        DataError: a recording cannot be read.
    """
    if labels_first and labels is None:
        raise LabelError("labels come first, but none are given; expected a file that `python -m ipnet label` wrote")
    known = read_labels(labels) if labels is not None else {}
    return [labelled(open_sequence(folder), known.get(folder.name), labels_first) for folder in find_all(paths, names)]


def labelled(sequence: Sequence, label: Label | None = None, labels_first: bool = False) -> Recording:
    """A recording with the mean of its true biases, or with its label where it has none.

    Args:
        sequence: with truth or without.
        label: of it.
        labels_first: the label counts even if truth has biases, which are then left out.

    Raises:
        LabelError: it has neither.
    """
    truth = sequence.truth
    if labels_first and label is not None and truth is not None:
        truth = replace(truth, b_g=None, b_a=None)
    known = _with_biases(truth)
    if known is not None and known.b_g is not None and known.b_a is not None:
        drawn = np.hstack([known.b_g, known.b_a])
        label = Label(sequence.name, drawn.mean(axis=0), np.cov(drawn.T) + 1e-12 * np.eye(6))
    if label is None:
        raise LabelError(f"{sequence.name}: its truth has no biases; expected a label: python -m ipnet label")
    return Recording(sequence.name, sequence.imu, sequence.calibration.imu, truth, label)


def true_bias(truth: Trajectory | None) -> Floats | None:
    """(6,) mean of b_g, b_a over a truth, where it has any."""
    known = _with_biases(truth)
    if known is None or known.b_g is None or known.b_a is None:
        return None
    return np.concatenate([known.b_g.mean(axis=0), known.b_a.mean(axis=0)])


def find(path: Path) -> list[Path]:
    """Folders of recordings at or below a path, by name; `mav0` is left out of a folder's path.

    Raises:
        LabelError: there are none.
    """
    inside = sorted(p.parent.parent for p in path.rglob("imu0/data.csv"))
    found = [p.parent if p.name == "mav0" else p for p in inside]
    if not found:
        raise LabelError(f"{path}: holds no recording; expected folders with imu0/data.csv")
    return found


def find_all(paths: Iterable[Path], names: Iterable[str] | None = None) -> list[Path]:
    """Folders of recordings at or below paths, each once, however often it is given.

    Args:
        paths: folders.
        names: of the recordings to take; None for all.

    Raises:
        LabelError: there are none at a path, two folders have one name (they would count as one recording or as two),
            or one of `names` is not there.
    """
    found: dict[str, Path] = {}
    for folder in (folder for path in paths for folder in find(path)):
        first = found.setdefault(folder.name, folder)
        if first.resolve() != folder.resolve():
            raise LabelError(f"{first} and {folder}: two recordings of one name; expected one")
    wanted = set(found if names is None else names)
    missing = sorted(wanted - set(found))
    if missing:
        raise LabelError(f"{', '.join(missing)}: not among the recordings given, {', '.join(found)}")
    return [folder for name, folder in found.items() if name in wanted]


def kept_apart(training: Iterable[str], validation: Iterable[str]) -> None:
    """Check that no recording both is learned from and judges what was learned.

    Raises:
        LabelError: some do; the message names them.
    """
    shared = sorted({*training} & {*validation})
    if shared:
        raise LabelError(f"{', '.join(shared)}: learned from and validated on; expected recordings of only one kind")


def _with_biases(truth: Trajectory | None) -> Trajectory | None:
    """Truth where its biases are finite; None if that is nowhere."""
    if truth is None or truth.b_g is None or truth.b_a is None:
        return None
    finite = np.isfinite(np.hstack([truth.b_g, truth.b_a])).all(axis=1)
    return truth[np.asarray(finite)] if finite.any() else None

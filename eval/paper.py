"""The tables of the paper that this grows from, made again as far as the data goes, each figure beside the paper's."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import thread_time
from typing import Any

import numpy as np
import pandas as pd

from eval.arms import BASE, ESTIMATORS, PLAIN, Arm
from eval.cells import Cell, Source, Study
from eval.errors import StudyError
from eval.flights import Flight, RenderedFlight
from eval.outcome import Outcome
from eval.paired import frame
from eval.published import sequence_in
from eval.sources import Degraded, Recording, rendered
from eval.survey import Survey
from eval.tables import Table, number, percent
from ipnet.network_source import ONNX, Network
from ipnet.recordings import FILTER_LABELS, PUBLIC_LABELS, read_labels
from ipnet.weights import Card, find
from navcore.calibration import load_yaml
from navcore.readers import open_sequence
from sim.benchmark import duration_s

_FILE = Path(__file__).with_name("paper.yaml")
_FULL_RATE, _HALF_RATE = "20 Hz", "10 Hz"
_TABLE_1, _TABLE_2, _TABLE_3 = "table I", "table II", "table III"
INDOORS = "sim-handheld-n100"
"""Weights for table III: a hand-held rig in a room, with the IMU that the paper's own recordings have."""
_IMU, _SECONDS, _NIGHT = "n100", 60.0, "low_light:3@0-60"
_WINDOWS = 200


@dataclass(frozen=True)
class PaperTables:
    """The tables, from the recordings that are at hand; the others stay open.

    Attributes:
        survey: what there is below a folder; sequences are known by their names.
    """

    survey: Survey

    def study(self) -> Study:
        """All runs behind the tables, of whole recordings.

        Raises:
            StudyError: two recordings are the same sequence.
        """
        figures = load_yaml(_FILE)
        cells: list[Cell] = []
        places: dict[str, Path] = {}
        for listed in self.survey.recordings:
            for table, key in ((_TABLE_1, "table_1"), (_TABLE_2, "table_2")):
                name = sequence_in(listed.name, figures[key])
                if name is None or listed.source is None or not listed.whole:
                    continue
                if places.setdefault(name, listed.path) != listed.path:
                    raise StudyError(f"{places[name]} and {listed.path}: both are {name}; expected one")
                for rate, source in _rates(listed.source) if table == _TABLE_1 else [(_FULL_RATE, listed.source)]:
                    cells += _cells(source, table, f"{name}, {rate}", 1, _arms(table, name))
        for source, condition, seed in _unlike():
            cells += _cells(source, _TABLE_3, condition, seed, _elsewhere())
        return Study("The paper's tables", tuple(cells), BASE)

    def tables(self, outcome: Outcome) -> dict[str, Table]:
        """The paper's tables I to III and what its text says of the start, of speed and of labels, by name."""
        figures, runs = load_yaml(_FILE), frame(outcome.records)
        return {
            "table-1": _table_1(runs, figures["table_1"]),
            "initial-phase": _initial_phase(runs),
            "table-2": _table_2(runs, figures["table_2"]),
            "table-3": _table_3(runs, figures["table_3"]),
            "speed": _speed(runs, figures["speed"]),
            "labels": _labels(),
        }


def _rates(source: Recording) -> Iterator[tuple[str, Source]]:
    """As recorded, and with every second image, as the paper's baseline got them."""
    yield _FULL_RATE, source
    yield _HALF_RATE, Degraded(source, f"low_rate:1@0-{duration_s(open_sequence(Path(source.path))):.3f}", 1)


def _arms(table: str, sequence: str) -> tuple[Arm, ...]:
    """The base, the paper's arm or the rival's, and this project's two sources; none has seen the recording."""
    weights = "euroc-table2" if table == _TABLE_2 else "tumvi" if sequence.startswith("room") else "euroc"
    paper = Arm("paper", f"ipnet:paper-{weights}", overrides=PLAIN)
    special = Arm("recursive", f"recursive:{weights}") if table == _TABLE_2 else paper
    return Arm(BASE, "none"), special, Arm("ipnet", f"ipnet:{weights}"), Arm("motion", f"motion:{weights}")


def _elsewhere() -> tuple[Arm, ...]:
    """What was learned indoors from a hand-held rig, with the paper's weighting and with this project's."""
    return Arm(BASE, "none"), Arm("paper", f"ipnet:{INDOORS}", overrides=PLAIN), Arm("ipnet", f"ipnet:{INDOORS}")


def _unlike() -> Iterator[tuple[Source, str, int]]:
    """Table III: unseen flights of the platform that was learned from, and another platform elsewhere."""
    for seed in range(1, 5):
        yield rendered(Flight("handheld", _SECONDS, seed, imu=_IMU), ""), "indoor", seed
    for seed in range(1, 5):
        outdoors = RenderedFlight.of(Flight("rover", _SECONDS, seed, imu=_IMU, scene="yard"))
        yield outdoors, "outdoor", seed
        yield Degraded(outdoors, _NIGHT, seed), "outdoor, evening", seed


def _cells(source: Source, table: str, condition: str, seed: int, arms: Iterable[Arm]) -> Iterator[Cell]:
    for estimator in ESTIMATORS:
        for arm in arms:
            names = ("recordings", table, condition, seed, arm.name, arm.prior)
            yield Cell(source, *names, estimator=estimator, overrides=arm.overrides)


def _table_1(runs: pd.DataFrame, figures: dict[str, Any]) -> Table:
    """Every sequence of the paper's, at both rates, with both estimators; its own figures beside."""
    rows = []
    for name, theirs in figures.items():
        for rate in (_FULL_RATE, _HALF_RATE):
            for estimator in ESTIMATORS:
                mine = _runs(runs, _TABLE_1, f"{name}, {rate}", estimator)
                ours = [_scores(mine, arm) for arm in (BASE, "paper", "ipnet", "motion")]
                row = [name, rate, estimator, *(text for scores in ours for text in _pair(scores, ours[0]))]
                rows.append((*row, *_pair(theirs["baseline"]), *_pair(theirs["factor"], theirs["baseline"])))
    heads = [f"{arm} {what}" for arm in (BASE, "paper's net", "ipnet", "motion") for what in ("ATE", "RPE")]
    columns = ("sequence", "images", "estimator", *heads, *_THEIRS)
    return Table("Table I: ATE [m] and RPE [rad a frame] without a prior and with one", columns, tuple(rows), labels=3)


def _initial_phase(runs: pd.DataFrame) -> Table:
    """ATE of the first ten seconds, in the order of table I; the paper shows a picture of V2_01."""
    arms, rows = (BASE, "paper", "ipnet", "motion"), []
    for name in dict.fromkeys(runs[runs.regime == _TABLE_1].condition):
        for estimator in ESTIMATORS:
            mine = _runs(runs, _TABLE_1, name, estimator)
            values = [_median(mine[mine.arm == arm], "initial_ate_m") for arm in arms]
            rows.append((name, estimator, *(number(value, ".4f") for value in values)))
    columns = ("sequence", "estimator", BASE, "paper's net", "ipnet", "motion")
    return Table("The initial phase (figure 7): ATE [m] of the first 10 s", columns, tuple(rows), labels=2)


def _table_2(runs: pd.DataFrame, figures: dict[str, Any]) -> Table:
    """Against the recursive rival, on its split."""
    rows = []
    for name, theirs in figures.items():
        for estimator in ESTIMATORS:
            mine = _runs(runs, _TABLE_2, f"{name}, {_FULL_RATE}", estimator)
            ours = [_scores(mine, arm) for arm in (BASE, "recursive", "ipnet", "motion")]
            row = [name, estimator, *(text for scores in ours for text in _pair(scores, ours[0]))]
            rows.append((*row, number(theirs["recursive"][0], ".3f"), *_pair(theirs["factor"])))
    heads = [f"{arm} {what}" for arm in (BASE, "recursive", "ipnet", "motion") for what in ("ATE", "RPE")]
    columns = ("sequence", "estimator", *heads, "Buchanan et al. ATE", "Yi et al. ATE", "Yi et al. RPE")
    return Table("Table II: against the recursive rival, on its split", columns, tuple(rows), labels=2)


def _table_3(runs: pd.DataFrame, figures: dict[str, Any]) -> Table:
    """Learned from a hand-held rig indoors, applied there and to a rover outdoors: medians of simulated flights beside
    means of the paper's own recordings that did not diverge."""
    rows = []
    for group in dict.fromkeys(sequence["group"] for sequence in figures.values()):
        known = [s for s in figures.values() if s["group"] == group and np.isfinite(s["baseline"][0])]
        theirs = [[float(np.mean([s[k][i] for s in known])) for i in range(2)] for k in ("baseline", "factor")]
        for estimator in ESTIMATORS:
            mine = _runs(runs, _TABLE_3, group, estimator)
            ours = [_scores(mine, arm) for arm in (BASE, "paper", "ipnet")]
            row = [group, estimator, *(text for scores in ours for text in _pair(scores, ours[0]))]
            rows.append((*row, *_pair(theirs[0]), *_pair(theirs[1], theirs[0])))
    heads = [f"{arm} {what}" for arm in (BASE, "ipnet, plain", "ipnet") for what in ("ATE", "RPE")]
    title = "Table III's idea: learned from a hand-held rig indoors, applied to a rover outdoors. Medians of simulated"
    title += " flights beside means of the paper's recordings that did not diverge"
    return Table(title, ("recordings", "estimator", *heads, *_THEIRS), tuple(rows), labels=2)


def _speed(runs: pd.DataFrame, figures: dict[str, Any]) -> Table:
    """How often a second, on one thread of this machine; the paper's on an RTX 4090."""
    folder, rows = find("sim-quadrotor"), []
    for name, network in Card.read(folder).networks.items():
        run = Network(folder / f"{name}{ONNX}")
        window = np.full((network.config.samples, 6), [0.0, 0.0, 0.0, 0.0, 0.0, 9.8])
        took = []
        for _ in range(_WINDOWS):
            begun = thread_time()
            run(window)
            took.append(thread_time() - begun)
        seconds = network.config.samples / network.config.rate_hz
        rows.append((f"windows of {seconds:.0f} s", f"{1.0 / np.median(took):.0f}", f"{figures['windows_hz']}"))
    for estimator in ESTIMATORS:
        mine = runs[(runs.estimator == estimator) & (runs.arm == "ipnet") & runs.condition.str.endswith(_FULL_RATE)]
        cost = _median(mine, "estimator_ms_per_frame")
        rows.append((f"frames, {estimator} with ipnet", number(1e3 / cost, ".0f"), f"{figures['system_hz']}"))
    columns = ("", "here, one thread", "Yi et al., RTX 4090")
    return Table("Speed: how often a second, in CPU time, without decoding images", columns, tuple(rows))


def _labels() -> Table:
    """Labels from the filter's own path less those from motion capture, largest axis; the paper shows pictures."""
    captured, own = read_labels(PUBLIC_LABELS), read_labels(FILTER_LABELS)
    rows = []
    for name, label in ((n, label) for n, label in own.items() if n in captured):
        wrong = label.bias - captured[name].bias
        sigma = np.sqrt(np.diagonal(label.covariance + captured[name].covariance))
        gyro, accel, both = np.abs(wrong[:3]).max(), np.abs(wrong[3:]).max(), np.sqrt(np.mean((wrong / sigma) ** 2))
        rows.append((name, f"{1e3 * gyro:.2f}", f"{accel:.3f}", f"{both:.1f}"))
    columns = ("recording", "gyroscope [1e-3 rad/s]", "accelerometer [m/s²]", "rms in their sigma")
    return Table("Labels without motion capture: largest difference on an axis", columns, tuple(rows))


_THEIRS = ("Yi et al. baseline ATE", "RPE", "Yi et al. with factor ATE", "RPE")


def _runs(runs: pd.DataFrame, table: str, condition: str, estimator: str) -> pd.DataFrame:
    return runs[(runs.regime == table) & (runs.condition == condition) & (runs.estimator == estimator)]


def _scores(runs: pd.DataFrame, arm: str) -> list[float]:
    """Median ATE and RPE of an arm's runs that did not diverge; infinite if all did, unknown where none was run."""
    mine = runs[runs.arm == arm]
    good = mine[mine.diverged == 0.0]
    if len(mine) and not len(good):
        return [np.inf, np.inf]
    return [_median(good, "ate_m"), _median(good, "rpe_rad")]


def _median(runs: pd.DataFrame, name: str) -> float:
    return float(runs[name].median()) if name in runs and len(runs) else np.nan


def _pair(scores: list[float], base: list[float] | None = None) -> tuple[str, str]:
    """ATE and RPE as text, each with its change against a base."""
    found = []
    for k, form in enumerate((".3f", ".5f")):
        value = scores[k] if k < len(scores) else np.nan
        change = ""
        if base is not None and base is not scores and np.isfinite([value, base[k]]).all():
            change = f" ({percent(value / base[k])})"
        found.append("diverged" if np.isinf(value) else f"{number(value, form)}{change}")
    return found[0], found[1]

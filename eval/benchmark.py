"""A study of recordings, real or not: every cell of a benchmark, done to their images when they are loaded."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from eval.arms import BASE, ESTIMATORS, Arm, told_all
from eval.cells import Cell, Kind, Study
from eval.errors import StudyError
from eval.kept import kept
from eval.regimes import kind_of
from eval.sources import Degraded, Recording
from eval.unseen import unseen_sources
from eval.work import resolved
from navcore.prior import load_prior
from navcore.readers import open_sequence
from navcore.sequence import Sequence
from sim.benchmark import duration_s
from sim.degrade.spec import Spec
from sim.errors import ConfigError

_CLEAN = "clean"
_COMBINED = "several at once"
_ENDLESS_S = 1e6


@dataclass(frozen=True)
class Benchmark:
    """Some cells of a benchmark on some recordings, which stand in for seeds.

    Attributes:
        spec: the benchmark.
        recordings: where they are; with six or more, differences between arms get an interval.
        patterns: of the cells (`low_light-*`); all without any. The clean recording is always among them.
        priors: arms beside `none` and, where truth knows the biases, `truth`; as `load_prior` takes them.
        ablation: all arms of the ablation instead, for each recording from what was made without it, and both
            estimators; recordings that all weights have seen are left out.
    """

    spec: Spec
    recordings: tuple[Path, ...]
    patterns: tuple[str, ...] = ()
    priors: tuple[str, ...] = ()
    ablation: bool = False

    def study(self, workspace: Path) -> tuple[Study, tuple[str, ...]]:
        """The study, and a line for each cell that does not fit its recording and is left out.

        Files that priors name are copied into `workspace`.

        Raises:
            NavcoreError: a prior is unknown or cannot be read.
            ConfigError: a pattern that matches no cell, or a cell that was asked for by its name does not fit.
            DataError: no recording.
            StudyError: no recordings, one without images, or two of the same name.
        """
        extra = [Arm(prior, kept(prior, workspace)) for prior in self.priors]
        steps = [self._step(cell) for cell in self.spec.select(self.patterns)]
        cells: list[Cell] = []
        left_out: list[str] = []
        names: set[str] = set()
        for number, path in enumerate(self.recordings, 1):
            sequence = open_sequence(path)
            clean = Recording.of(path, sequence)
            if clean.name in names:
                raise StudyError(f"{path}: another recording is called {clean.name} too")
            if not any(frame.images for frame in sequence.frames):
                raise StudyError(f"{path}: the recording has no images to degrade")
            names.add(clean.name)
            for arm in extra:
                load_prior(resolved(arm.prior, workspace), sequence)  # a wrong one is said before anything runs
            arms = (Arm(BASE, "none"), *([Arm("truth", "truth")] if _knows_biases(sequence) else []), *extra)
            if self.ablation:
                unseen = unseen_sources(clean.name, workspace, _knows_biases(sequence))
                if unseen is None:
                    left_out.append(f"{clean.name} is left out: no split tests on a recording of this name")
                    continue
                sources, missing = unseen
                left_out += [
                    f"{clean.name} is not told {spec}: there is no such source, or it saw it" for spec in missing
                ]
                arms = (*told_all(sources), *extra)
            for step, degrade in self._fitting(steps, sequence, clean.name, left_out):
                source = Degraded(clean, degrade, self.spec.seed) if degrade else clean
                for estimator in ESTIMATORS if self.ablation else ESTIMATORS[:1]:
                    cells += [step.cell(source, number, arm, estimator) for arm in arms if arm.is_for(estimator)]
        if not cells:
            raise StudyError(f"nothing to run on {len(names)} recordings: {'; '.join(left_out)}")
        return Study(f"Benchmark {self.spec.name}", tuple(cells), BASE), tuple(left_out)

    def _fitting(
        self, steps: list["_Step"], sequence: Sequence, name: str, left_out: list[str]
    ) -> Iterator[tuple["_Step", str]]:
        """What fits a recording, each with its schedule; every regime begins with the clean recording."""
        begun = set()
        for step in steps:
            try:
                schedule = self.spec.schedule(step.condition, duration_s(sequence))
            except ConfigError as error:
                if step.condition in self.patterns:
                    raise
                left_out.append(f"{name}, {step.condition} is left out: {error}")
                continue
            if schedule.degradations and step.regime not in begun:
                yield replace(step, condition=_CLEAN, level=None if step.level is None else 0.0, kind="clean"), ""
            begun.add(step.regime)
            yield replace(step, kind=kind_of(schedule.degradations)), str(schedule)

    def _step(self, cell: str) -> "_Step":
        """Where a cell stands in the report: a regime is a kind in a place."""
        degradations = self.spec.schedule(cell, _ENDLESS_S).degradations
        if not degradations:
            return _Step(_CLEAN, cell)
        if len(degradations) > 1:
            return _Step(_COMBINED, cell)
        (only,) = degradations
        kind, span = only.kind.replace("_", " "), self.spec.cells[cell].partition("@")[2].strip()
        if only.kind == "blackout":
            begin = re.split(r"[-+]", span)[0]
            return _Step(f"{kind} from {begin}", cell, only.end_s - only.start_s, "length of the outage [s]")
        return _Step(f"{kind}, {span}", cell, float(only.severity), "severity")


@dataclass(frozen=True)
class _Step:
    """A condition of a regime, and its place on the regime's axis."""

    regime: str
    condition: str
    level: float | None = None
    axis: str = ""
    kind: Kind = "other"

    def cell(self, source: Recording | Degraded, number: int, arm: Arm, estimator: str) -> Cell:
        """The cell of a study for one recording and arm."""
        names = ("recordings", self.regime, self.condition, number, arm.name, arm.prior)
        return Cell(source, *names, self.level, self.axis, estimator, arm.overrides, self.kind)


def _knows_biases(sequence: Sequence) -> bool:
    truth = sequence.truth
    if truth is None or truth.b_g is None or truth.b_a is None:
        return False
    return bool(np.isfinite(np.hstack([truth.b_g, truth.b_a])).all(axis=1).any())

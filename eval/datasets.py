"""All of a public data set: a study with a run for every recording, and its table beside published figures."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from eval.cells import Cell, Study
from eval.errors import StudyError
from eval.kept import kept
from eval.outcome import Outcome
from eval.paired import frame
from eval.published import Published
from eval.survey import NO_IMAGES, Survey
from eval.tables import NOTHING, Table, number
from msckf.config import FilterConfig

DONE, DIVERGED, FAILED, MISSING = "done", "diverged", "failed", "not run"
FINISHED = (DONE, DIVERGED, NO_IMAGES)
"""How a recording may end without anything being wrong."""
_SCORES = ("frames", "path_m", "ate_m", "ate_deg", "completeness", "start_s", "estimator_ms_per_frame")
_PREFIX = "published "


@dataclass(frozen=True)
class Dataset:
    """The recordings of a data set that are at hand.

    Attributes:
        published: what others reached on it.
        survey: what there is.
        prior: where bias priors come from, as `load_prior` takes it.
        config: of the filter; of another estimator its number of cameras.
        estimator: as in `Cell.estimator`.
    """

    published: Published
    survey: Survey
    prior: str = "none"
    config: FilterConfig = field(default_factory=FilterConfig)
    estimator: str = "msckf"

    def study(self, workspace: Path) -> Study:
        """A run for each recording that can be run; files that the prior names are copied into `workspace`.

        Raises:
            StudyError: settings of the filter are asked for, and another estimator.
        """
        overrides = tuple(differences(asdict(FilterConfig()), asdict(self.config)).items())
        foreign = [name for name, _ in overrides if name != "cameras"]
        if self.estimator != "msckf" and foreign:
            raise StudyError(f"{', '.join(foreign)}: settings of the filter, which {self.estimator} does not have")
        prior = kept(self.prior, workspace)
        names = (self.published.title, "recordings")
        cells = [
            Cell(x.source, *names, x.name, 1, self.prior, prior, estimator=self.estimator, overrides=overrides)
            for x in self.survey.recordings
            if x.source is not None
        ]
        return Study(self.published.title, tuple(cells), self.prior)

    def results(self, outcome: Outcome) -> pd.DataFrame:
        """A row for each recording: what became of it, its figures, and what others reached on its sequence."""
        runs = {str(run["condition"]): run for run in frame(outcome.records).to_dict("records")}
        rows: list[dict[str, Any]] = []
        for listed in self.survey.recordings:
            run = runs.get(listed.name, {})
            if run:
                message = run["failure"] if isinstance(run["failure"], str) else ""
                state = FAILED if message else DIVERGED if run["diverged"] == 1.0 else DONE
            elif listed.source is not None:
                state, message = MISSING, "; ".join(outcome.errors)
            else:
                state, message = NO_IMAGES if listed.objection == NO_IMAGES else FAILED, listed.objection
            scores = {name: run.get(name, np.nan) for name in _SCORES}
            sequence = self.published.sequence_in(listed.name)
            theirs = {_PREFIX + s.name: s.ate_m.get(sequence or "", np.nan) for s in self.published.systems}
            scores["drift_percent"] = 100.0 * scores["ate_m"] / scores["path_m"]
            names = {"recording": listed.name, "sequence": sequence, "state": state, "whole": listed.whole}
            rows.append({**names, **scores, **theirs, "message": message, "path": str(listed.path)})
        return pd.DataFrame(rows)

    def tables(self, results: pd.DataFrame) -> tuple[Table, ...]:
        """How every recording went, ATE beside that of others, and what was wrong with a recording."""
        count = self.config.cameras
        title = (
            f"{self.published.title}: {self.estimator}, {count} camera{'s' if count > 1 else ''}, prior {self.prior}"
        )
        tables = [_runs(results, title), _beside_published(results, self.published)]
        amiss = results[results.state.isin((FAILED, MISSING))][["recording", "message"]]
        if len(amiss):
            rows = tuple((str(name), str(message)) for name, message in amiss.itertuples(index=False))
            tables.append(Table("Recordings that were not run to their end", ("recording", "message"), rows))
        return tuple(tables)


def write_table(results: pd.DataFrame, folder: Path) -> Path:
    """Keep the results as CSV; returns its path."""
    path = folder / "table.csv"
    partial = path.with_name(f".{path.name}.partial")
    results.to_csv(partial, index=False)
    partial.replace(path)
    return path


def differences(base: Mapping[str, Any], other: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """The settings that differ, by dotted name."""
    found: dict[str, Any] = {}
    for name, value in other.items():
        if isinstance(value, Mapping):
            found |= differences(base[name], value, f"{prefix}{name}.")
        elif value != base[name]:
            found[prefix + name] = value
    return found


def _runs(results: pd.DataFrame, title: str) -> Table:
    """How every recording went."""
    forms = {
        "path_m": ("path [m]", ".1f"),
        "ate_m": ("ATE [m]", ".3f"),
        "ate_deg": ("ATE [°]", ".2f"),
        "drift_percent": ("drift [%]", ".2f"),
        "completeness": ("complete", ".1%"),
        "start_s": ("start [s]", ".2f"),
        "estimator_ms_per_frame": ("CPU [ms a frame]", ".1f"),
    }
    rows = [
        (_label(run), str(run.state), *(number(run[name], form) for name, (_, form) in forms.items()))
        for _, run in results.iterrows()
    ]
    return Table(title, ("recording", "", *(head for head, _ in forms.values())), tuple(rows), labels=2)


def _beside_published(results: pd.DataFrame, published: Published) -> Table:
    """ATE beside that of others, and two means over the whole sequences that both have: of theirs and of ours.

    A system of which only the mean is published is shown once all sequences of the data set are there.
    """
    known = results[results.sequence.notna() & results.state.isin((DONE, DIVERGED))]
    rows = [[_label(run), number(run.ate_m, ".3f")] for _, run in known.iterrows()]
    whole = known[known.whole]
    theirs, ours = ["mean of the same, theirs", NOTHING], ["… here", number(_mean(whole.ate_m), ".3f")]
    columns = ["recording", "here"]
    for system in published.systems:
        both = whole[np.isfinite(whole[_PREFIX + system.name]) & np.isfinite(whole.ate_m)]
        if system.mean_m is None:
            columns.append(system.name)
            for row, value in zip(rows, known[_PREFIX + system.name], strict=True):
                row.append("diverged" if np.isinf(value) else number(value, ".3f"))
            theirs.append(number(_mean(both[_PREFIX + system.name]), ".3f"))
            ours.append(number(_mean(both.ate_m), ".3f"))
        elif set(published.sequences) <= set(whole.sequence):
            columns.append(system.name)
            for row in rows:
                row.append(NOTHING)
            theirs.append(number(system.mean_m, ".3f"))
            ours.append(number(_mean(whole.ate_m), ".3f"))
    title = f"Position ATE [m] beside published figures, {published.title}"
    return Table(title, tuple(columns), tuple(tuple(row) for row in [*rows, theirs, ours]))


def _label(run: pd.Series) -> str:
    """Its name; figures of a part of a recording are not those of the whole."""
    return str(run.recording if run.whole else f"{run.recording} (a part)")


def _mean(values: pd.Series) -> float:
    return float(values.mean()) if len(values) else np.nan

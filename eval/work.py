"""What a worker does with a cell: run it, score it, write its record."""

from collections.abc import Callable, Mapping
from collections.abc import Sequence as ListLike
from functools import lru_cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import cv2
import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from eval import records
from eval.cells import Cell, Source
from eval.consistency import Nees, nees
from eval.errors import ScoreError, StudyError
from eval.metrics import score
from eval.statements import Overheard, tabulate
from navcore.calibration import Calibration
from navcore.odometry import Health, Odometry, Run, run
from navcore.prior import BiasPriorSource, load_prior, split_prior
from navcore.results.summary import DECODING
from navcore.sequence import Sequence

GROUP = "navcore.odometry"
EstimatorFactory = Callable[[Calibration, BiasPriorSource, Mapping[str, Any]], Odometry]


def load_estimator(name: str) -> EstimatorFactory:
    """The factory that a name stands for: an entry point, or `module:function` of one's own.

    Raises:
        StudyError: the name is unknown; the message lists the known ones.
    """
    module, _, function = name.partition(":")
    if function:
        try:
            factory: EstimatorFactory = getattr(import_module(module), function)
        except (ImportError, AttributeError) as error:
            raise StudyError(f"estimator {name!r} cannot be loaded: {error}") from error
        return factory
    known = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name not in known:
        raise StudyError(f"estimator {name!r} is unknown; known are {', '.join(sorted(known))}")
    loaded: EstimatorFactory = known[name].load()
    return loaded


def run_cell(cell: Cell, versions: dict[str, str], workspace: Path) -> str:
    """Run one cell and write its record, on one thread; what it raises becomes the record's failure.

    Returns:
        The key of the record.

    Raises:
        StudyError: the cell cannot be run as the study says; it has no record, and is tried again next time.
    """
    key = cell.key(versions)
    if records.path_of(workspace, key).is_file():
        return key
    begun = perf_counter()
    scores: dict[str, float] = {}
    series, statements, failure = pd.DataFrame(), pd.DataFrame(), None
    cv2.setNumThreads(1)
    with threadpool_limits(1):
        try:
            scores, series, statements = _measured(cell, workspace)
        except StudyError:
            raise
        except Exception as error:
            failure = f"{type(error).__name__}: {error}"
    scores = scores | {"wall_s": perf_counter() - begun}
    record = records.Record(key, cell.title, cell.config, versions, scores, failure, series, statements)
    records.write(record, workspace)
    return key


def run_cells(cells: ListLike[Cell], versions: dict[str, str], workspace: Path) -> list[str]:
    """Run cells one after the other; those of one recording in a row load it once."""
    return [run_cell(cell, versions, workspace) for cell in cells]


def _measured(cell: Cell, workspace: Path) -> tuple[dict[str, float], pd.DataFrame, pd.DataFrame]:
    """Scores, series and the prior's statements."""
    sequence = _loaded(cell.source, workspace)
    prior = Overheard(load_prior(resolved(cell.prior, workspace), sequence))
    odometry = load_estimator(cell.estimator)(sequence.calibration, prior, dict(cell.overrides))
    begun = process_time()
    result = run(odometry, sequence)
    cpu_s = process_time() - begun
    scores = summary(result, sequence) | {"cpu_ms_per_frame": 1e3 * cpu_s / max(len(result.estimates), 1)}
    errors = _nees_if_any(result, sequence)
    first_ns = sequence.frames[0].t_ns if sequence.frames else 0
    said = tabulate(prior.statements, prior.constant_covariance, first_ns)
    return scores, records.tabulate(result, first_ns, sequence.truth, errors), said


@lru_cache(maxsize=1)
def _loaded(source: Source, workspace: Path) -> Sequence:
    return source.load(workspace)


def summary(result: Run, sequence: Sequence) -> dict[str, float]:
    """Flat numbers of a run: completeness, start, health, its own CPU time, and its score where there is truth.

    `estimator_ms_per_frame` is what the stages of a frame add up to; reading images is none of the estimator's.
    """
    frames = max(len(result.estimates), 1)
    scores = {"frames": float(len(result.estimates)), "completeness": result.completeness}
    for health in Health:
        scores[f"share_{health.value.lower()}"] = sum(e.health is health for e in result.estimates) / frames
    counted = sum(seconds for e in result.estimates for name, seconds in e.stages.items() if name != DECODING)
    scores["estimator_ms_per_frame"] = 1e3 * counted / frames
    path = result.trajectory
    if len(path):
        scores["start_s"] = float(path.t_ns[0] - sequence.frames[0].t_ns) * 1e-9
    if sequence.truth is not None:
        scores |= score(path, sequence.truth)
    return scores


def _nees_if_any(result: Run, sequence: Sequence) -> Nees | None:
    """NEES where truth knows everything that it takes, on a run that truth covers from end to end."""
    truth = sequence.truth
    if truth is None or not len(result.trajectory):
        return None
    try:
        errors = nees(result, truth)
    except ScoreError:
        return None
    return errors if np.isfinite(errors.values).all() else None


def check_priors(cells: ListLike[Cell], workspace: Path) -> None:
    """Raise if a prior of a study cannot be had, before anything runs; `truth` is a matter of each recording.

    Raises:
        NavcoreError: as `load_prior` does.
    """
    for prior in dict.fromkeys(cell.prior for cell in cells if "truth" not in cell.priors):
        load_prior(resolved(prior, workspace))


def resolved(prior: str, workspace: Path) -> str:
    """The prior's specification with files and folders in the study's folder by their whole paths."""
    return ",".join(_resolved(part, workspace) for part in split_prior(prior))


def _resolved(part: str, workspace: Path) -> str:
    name, _, argument = part.partition(":")
    file = argument.partition("?")[0]
    return f"{name}:{workspace / argument}" if file and (workspace / file).exists() else part

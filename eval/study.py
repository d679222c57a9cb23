"""A study: a frozen list of cells, run on Dask, each written once; killed and started again, it goes on."""

import logging
import os
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from time import time
from typing import Any

from distributed import Client, LocalCluster, as_completed
from distributed.client import Future

from eval import records
from eval.cells import Cell, Study, versions
from eval.errors import StudyError
from eval.outcome import Index, Outcome, load
from eval.sources import RenderedFlight
from eval.work import run_cells

_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def run_study(
    study: Study,
    workspace: Path,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Outcome:
    """Run what has no record yet.

    Args:
        study: what to run.
        workspace: its folder; with a scheduler elsewhere it must be the same folder for all workers.
        scheduler: address of a Dask scheduler; without one, a cluster of local processes is started.
        workers: how many of those; as many as there are cores by default.
        progress: gets the number of cells that are done, and of all.

    Raises:
        StudyError: two cells of the study are the same, or there is no scheduler at that address.
    """
    begun = time()
    workspace = workspace.resolve()
    index = _plan(study, workspace)
    index.write(workspace)
    named = zip(study.cells, index.keys, strict=True)
    todo = [cell for cell, key in named if not records.path_of(workspace, key).is_file()]
    done = len(study.cells) - len(todo)
    report = progress or (lambda done, count: None)
    report(done, len(study.cells))
    errors = []
    if todo:
        with _client(scheduler, workers) as client:
            for count, error in _finished(client, todo, index.versions, workspace):
                done += count
                errors += [error] if error else []
                report(done, len(study.cells))
    replace(index, seconds=index.seconds + time() - begun).write(workspace)
    return load(workspace, tuple(errors))


def _plan(study: Study, workspace: Path) -> Index:
    """The list of the study's cells; the time is that of an earlier run of the same cells."""
    made_with = versions(tuple(sorted({c.estimator for c in study.cells})))
    keys = [c.key(made_with) for c in study.cells]
    if len(set(keys)) != len(keys):
        twice = next(c for c, key in zip(study.cells, keys, strict=True) if keys.count(key) > 1)
        raise StudyError(f"cell '{twice.title}' is in the study twice")
    earlier = Index.read(workspace)
    seconds = earlier.seconds if earlier is not None and earlier.keys == keys else 0.0
    return Index(study.name, study.base, made_with, seconds, keys, [c.title for c in study.cells])


def _finished(
    client: Client, cells: list[Cell], made_with: dict[str, str], workspace: Path
) -> Iterator[tuple[int, str | None]]:
    """Number of cells done, or the error, as batches end; the cells of a batch share their recording."""
    batches: dict[Any, list[Cell]] = {}
    for cell in cells:
        batches.setdefault(cell.source, []).append(cell)
    rendered = {
        source: client.submit(source.make, workspace, pure=False)
        for source in batches
        if isinstance(source, RenderedFlight)
    }
    futures: dict[Future, list[Cell]] = {}
    for source, batch in batches.items():
        made = rendered.get(source)
        futures[client.submit(_batch, batch, made_with, workspace, made, pure=False)] = batch
    for future in as_completed(futures):
        batch = futures[future]
        try:
            future.result()
            yield len(batch), None
        except (Exception, CancelledError) as error:
            yield 0, f"{len(batch)} cells, the first '{batch[0].title}': {type(error).__name__}: {error}"


def _batch(cells: list[Cell], made_with: dict[str, str], workspace: Path, made: None) -> list[str]:
    """Run on a worker; `made` only says that the recording is there."""
    return run_cells(cells, made_with, workspace)


@contextmanager
def _client(scheduler: str | None, workers: int | None) -> Iterator[Client]:
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout="10s")
        except (OSError, ValueError) as error:
            raise StudyError(f"no Dask scheduler at {scheduler!r}: {error}") from error
        with client:
            yield client
        return
    count = workers or len(os.sched_getaffinity(0))
    options = {"n_workers": count, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with (
        LocalCluster(**options, env=_ONE_THREAD, silence_logs=logging.ERROR) as cluster,
        Client(cluster) as client,
    ):
        yield client

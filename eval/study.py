"""A study: a frozen list of cells, run on Dask, each written once; killed and started again, it goes on."""

import json
import logging
import os
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import time
from typing import Any

from distributed import Client, LocalCluster, as_completed
from distributed.client import Future

from eval import records
from eval.cells import Cell, versions
from eval.errors import StudyError
from eval.records import Record
from eval.sources import RenderedFlight
from eval.work import run_cells

_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_INDEX = "study.json"


@dataclass(frozen=True)
class Study:
    """What is to be run; chosen beforehand, never by result.

    Attributes:
        name: for people.
        cells: all of them.
        base: the arm that the others are compared with.
    """

    name: str
    cells: tuple[Cell, ...]
    base: str = "none"


@dataclass(frozen=True)
class Outcome:
    """A study that was run, or what there is of it.

    Attributes:
        name, base: of the study.
        versions: what it was made with.
        records: of the cells that have one, in the order of the study.
        missing: titles of the cells that have none.
        seconds: wall clock, of all the times it was run.
        errors: what went wrong outside a cell, a line each.
    """

    name: str
    base: str
    versions: dict[str, str]
    records: tuple[Record, ...]
    missing: tuple[str, ...] = ()
    seconds: float = 0.0
    errors: tuple[str, ...] = field(default=())

    @property
    def failures(self) -> tuple[Record, ...]:
        """The records of cells that raised."""
        return tuple(r for r in self.records if r.failure is not None)


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
    made_with = versions(tuple(sorted({c.estimator for c in study.cells})))
    keys = [c.key(made_with) for c in study.cells]
    if len(set(keys)) != len(keys):
        twice = next(c for c, key in zip(study.cells, keys, strict=True) if keys.count(key) > 1)
        raise StudyError(f"cell '{twice.title}' is in the study twice")
    earlier_s = _index(workspace).get("seconds", 0.0) if _index(workspace).get("keys") == keys else 0.0
    _write_index(workspace, study, made_with, keys, earlier_s)
    todo = [
        c for c, key in zip(study.cells, keys, strict=True) if not records.path_of(workspace, key).is_file()
    ]
    done = len(keys) - len(todo)
    if progress is not None:
        progress(done, len(keys))
    errors = []
    if todo:
        with _client(scheduler, workers) as client:
            for count, error in _finished(client, todo, made_with, workspace):
                done += count
                errors += [error] if error else []
                if progress is not None:
                    progress(done, len(keys))
    _write_index(workspace, study, made_with, keys, earlier_s + time() - begun)
    return load(workspace, tuple(errors))


def load(workspace: Path, errors: tuple[str, ...] = ()) -> Outcome:
    """What there is of the study in a folder.

    Raises:
        StudyError: there is no study in that folder.
    """
    index = _index(workspace)
    if not index:
        raise StudyError(f"{workspace / _INDEX}: no such file; expected a folder that a study was run in")
    paths = [records.path_of(workspace, key) for key in index["keys"]]
    missing = tuple(t for t, p in zip(index["titles"], paths, strict=True) if not p.is_file())
    found = tuple(records.read(p) for p in paths if p.is_file())
    return Outcome(index["name"], index["base"], index["versions"], found, missing, index["seconds"], errors)


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


def _index(workspace: Path) -> dict[str, Any]:
    path = workspace / _INDEX
    if not path.is_file():
        return {}
    content: dict[str, Any] = json.loads(path.read_text())
    return content


def _write_index(
    workspace: Path, study: Study, made_with: dict[str, str], keys: list[str], seconds: float
) -> None:
    workspace.mkdir(parents=True, exist_ok=True)
    titles = [c.title for c in study.cells]
    head = {"name": study.name, "base": study.base, "versions": made_with, "seconds": seconds}
    partial = workspace / f".{_INDEX}.partial"
    partial.write_text(json.dumps(head | {"keys": keys, "titles": titles}, indent=1))
    partial.replace(workspace / _INDEX)

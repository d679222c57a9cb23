"""A study: a frozen list of cells, run on Dask, each written once; killed and started again, it goes on."""

import logging
import os
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from time import time
from typing import Any
from uuid import uuid4

from distributed import Client, LocalCluster, as_completed, get_worker
from distributed.client import Future

from eval.cells import Cell, Source, Study
from eval.errors import StudyError
from eval.flights import IMAGE_BYTES, RenderedFlight
from eval.outcome import Index, Outcome, load
from eval.progress import Ledger, Progress
from eval.sources import to_render
from eval.versions import versions
from eval.work import run_cells
from eval.workplace import Workplace

_LOCAL = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "LP_NUM_THREADS"), "1")
"""One thread for each worker, in linear algebra and in the software renderer."""
_READY, _RENDER, _POINTS = 2, 1, 0  # what goes first: images that are there, images that take long, the rest
_EVERY = 20  # images between two messages of a rendering
_PATIENCE_S = 30.0  # for the first worker of a scheduler elsewhere


def run_study(
    study: Study,
    workspace: Path,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Outcome:
    """Run what has no record yet.

    Args:
        study: what to run.
        workspace: its folder; with a scheduler elsewhere it must be the same folder for all workers.
        scheduler: address of a Dask scheduler; without one, a cluster of local processes is started.
        workers: how many of those; as many as there are cores by default.
        progress: is told how far it is, before the first cell too.

    Raises:
        StudyError: no workers were asked for, two cells of the study are the same, there is no scheduler at that
            address, its workers are none or cannot work on this study, or too little room for the images.
    """
    begun = time()
    workspace = workspace.resolve()
    if workers is not None and workers < 1:
        raise StudyError(f"{workers} workers were asked for; expected 1 or more")
    index = _plan(study, workspace)
    index.write(workspace)
    ledger = Ledger(study.cells, index.keys, workspace, progress)
    _check_room(ledger.films, workspace)
    errors = []
    if ledger.batches:
        with _client(scheduler, workers) as client:
            place = Workplace(index.versions, _estimators(study), _priors(study), workspace)
            ledger.start(_able_workers(client, place))
            errors = list(_run(client, ledger, place))
    else:
        ledger.start(0)
    replace(index, seconds=index.seconds + time() - begun).write(workspace)
    return load(workspace, tuple(errors))


def _plan(study: Study, workspace: Path) -> Index:
    """The list of the study's cells; the time is that of an earlier run of the same cells."""
    made_with = versions(_estimators(study), _priors(study))
    names: set[tuple[Any, ...]] = set()
    for cell in study.cells:
        name = (cell.platform, cell.regime, cell.condition, cell.seed, cell.estimator, cell.arm)
        if name in names:
            raise StudyError(f"cell '{cell.title}' is in the study twice")
        names.add(name)
    keys = [c.key(made_with) for c in study.cells]
    earlier = Index.read(workspace)
    seconds = earlier.seconds if earlier is not None and earlier.keys == keys else 0.0
    titles, configs = [c.title for c in study.cells], [c.config for c in study.cells]
    return Index(study.name, study.base, made_with, seconds, keys, titles, configs)


def _estimators(study: Study) -> tuple[str, ...]:
    return tuple(sorted({c.estimator for c in study.cells}))


def _priors(study: Study) -> tuple[str, ...]:
    specs = {c.prior: c for c in study.cells}
    return tuple(sorted({name for cell in specs.values() for name in cell.priors}))


def _able_workers(client: Client, place: Workplace) -> int:
    """How many workers there are, all of which can work on the study.

    Raises:
        StudyError: one of them cannot; the message says which and why. (Left alone, it would fail its cells so fast
            that it got most of them.)
    """
    known = client.scheduler_info(n_workers=-1)["workers"]
    for address, worker in known.items():
        if worker["nthreads"] != 1:
            what = f"{worker['nthreads']} threads; expected 1 (--nthreads 1 --nworkers N)"
            raise StudyError(f"the worker {address} has {what}")
    for address, objection in client.run(place.objection).items():
        if objection:
            raise StudyError(f"the worker {address} {objection}")
    return len(known)


def _run(client: Client, ledger: Ledger, place: Workplace) -> Iterator[str]:
    """Run all that is to do; gives what goes wrong outside a cell."""
    topic = f"study-{uuid4()}"
    client.subscribe_topic(topic, lambda event: ledger.rendered(*event[1]))
    made = {
        film: client.submit(_render, film, place, topic, number, pure=False, priority=_RENDER)
        for number, film in enumerate(ledger.films)
    }
    futures: dict[Future, Source] = {}
    for source, batch in ledger.batches.items():
        film, cells = to_render(source), [cell for _, cell in batch]
        first = _POINTS if film is None else _READY
        after = made.get(film) if film is not None else None
        futures[client.submit(_batch, cells, place, after, pure=False, priority=first)] = source
    for future in as_completed(futures):
        source = futures[future]
        try:
            future.result()
        except (Exception, CancelledError) as error:
            batch = ledger.batches[source]
            yield f"{len(batch)} cells, the first '{batch[0][1].title}': {type(error).__name__}: {error}"
        ledger.finished(source)


def _render(film: RenderedFlight, place: Workplace, topic: str, name: int) -> None:
    """Run on a worker: render a flight, and tell how far it is."""
    place.check()
    worker = get_worker()

    def tell(done: int, total: int) -> None:
        if done % _EVERY == 0 or done == total:
            worker.log_event(topic, (name, done, total))

    film.make(place.folder, tell)


def _batch(cells: list[Cell], place: Workplace, made: None) -> None:
    """Run on a worker: cells that share a recording; `made` only says that it is there."""
    place.check()
    run_cells(cells, place.versions, place.folder)


def _check_room(films: list[RenderedFlight], workspace: Path) -> None:
    needed = sum(IMAGE_BYTES * film.flight.frames for film in films)
    free = shutil.disk_usage(workspace).free
    if needed > free:
        what = f"the images of {len(films)} flights take about {needed * 1e-9:.1f} GB"
        raise StudyError(f"{workspace}: {what}, and {free * 1e-9:.1f} GB are free")


@contextmanager
def _client(scheduler: str | None, workers: int | None) -> Iterator[Client]:
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout="10s")
        except (OSError, ValueError) as error:
            raise StudyError(f"no Dask scheduler at {scheduler!r}: {error}") from error
        with client:
            try:
                client.wait_for_workers(1, timeout=_PATIENCE_S)
            except TimeoutError as error:
                raise StudyError(f"the Dask scheduler at {scheduler!r} has no workers") from error
            yield client
        return
    count = workers or len(os.sched_getaffinity(0))
    options = {"n_workers": count, "threads_per_worker": 1, "processes": True, "dashboard_address": ":0"}
    with (
        LocalCluster(**options, env=_LOCAL, silence_logs=logging.ERROR) as cluster,
        Client(cluster) as client,
    ):
        yield client

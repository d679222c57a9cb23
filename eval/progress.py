"""How far a study is: cells and images, and what is left in time."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

from eval import records
from eval.cells import Cell, Source
from eval.sources import to_render


@dataclass(frozen=True)
class Progress:
    """How far a study is.

    Attributes:
        cells, all_cells: that have a record, and of the study.
        images, all_images: that were rendered, and that are to be rendered in this run.
        cost_s, all_cost_s: CPU seconds of this run that are behind, and all of it, as `Source.cost` has them.
        workers: threads that work on it; 0 if there is nothing to do.
    """

    cells: int
    all_cells: int
    images: int
    all_images: int
    cost_s: float
    all_cost_s: float
    workers: int

    @property
    def expected_s(self) -> float:
        """Wall clock that is left, if all workers are busy."""
        return (self.all_cost_s - self.cost_s) / max(self.workers, 1)


class Ledger:
    """What a run of a study has to do, and how much of it is done.

    Attributes:
        batches: the cells that have no record, one for each record, with their keys, by recording.
        films: what is to be rendered for them.
    """

    def __init__(
        self, cells: Iterable[Cell], keys: Iterable[str], workspace: Path, report: Callable[[Progress], None] | None
    ) -> None:
        """For all cells of a study and their keys; `report` is told whenever something is done."""
        self._report, self._workspace, self._lock = report or (lambda progress: None), workspace, Lock()
        self._sharing: dict[str, int] = {}
        self.batches: dict[Source, list[tuple[str, Cell]]] = {}
        for key, cell in zip(keys, cells, strict=True):
            self._sharing[key] = self._sharing.get(key, 0) + 1
            if self._sharing[key] == 1 and not self._has(key):
                self.batches.setdefault(cell.source, []).append((key, cell))
        films = dict.fromkeys(film for source in self.batches if (film := to_render(source)) is not None)
        self.films = [film for film in films if not film.folder(workspace).is_dir()]
        self._images = [(0, round(film.flight.frames)) for film in self.films]
        self._left = {key for batch in self.batches.values() for key, _ in batch}
        self._workers, self._cost_s = 0, 0.0
        self._all_cost_s = sum(film.cost.make_s for film in self.films)
        self._all_cost_s += sum(self._cost_of(source) for source in self.batches)

    def start(self, workers: int) -> None:
        """Workers were found; tell how it stands."""
        self._workers = workers
        self._tell()

    def rendered(self, film: int, done: int, total: int) -> None:
        """So many images of a film are there."""
        with self._lock:
            self._images[film] = (max(done, self._images[film][0]), total)
        self._tell()

    def finished(self, source: Source) -> None:
        """The cells of a recording were run, or could not be."""
        batch = self.batches[source]
        with self._lock:
            self._left -= {key for key, _ in batch if self._has(key)}
            self._cost_s += self._cost_of(source)
        self._tell()

    def _cost_of(self, source: Source) -> float:
        return source.cost.load_s + sum(cell.cost_s for _, cell in self.batches[source])

    def _has(self, key: str) -> bool:
        return records.path_of(self._workspace, key).is_file()

    def _tell(self) -> None:
        with self._lock:
            images, all_images = (sum(x) for x in zip((0, 0), *self._images, strict=True))
            shares = (done / total for done, total in self._images)
            films_s = sum(film.cost.make_s * share for film, share in zip(self.films, shares, strict=True))
            cells = sum(self._sharing.values())
            done = cells - sum(self._sharing[key] for key in self._left)
            cost_s = films_s + self._cost_s
            now = Progress(done, cells, images, all_images, cost_s, self._all_cost_s, self._workers)
        self._report(now)

"""What there is of a study: the list of its cells in its folder, and their records."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from eval import records
from eval.errors import StudyError
from eval.records import Record

_NAME = "study.json"


@dataclass(frozen=True)
class Index:
    """The list of a study's cells, as it is kept in its folder.

    Attributes:
        name, base: of the study.
        versions: what it is made with.
        seconds: wall clock of all the times that it was run to its end.
        keys, titles, configs: of all its cells; cells that share a result have the same key.
    """

    name: str
    base: str
    versions: dict[str, str]
    seconds: float
    keys: list[str]
    titles: list[str]
    configs: list[dict[str, Any]]

    def write(self, workspace: Path) -> None:
        """Keep it in the study's folder, in place of an older one."""
        workspace.mkdir(parents=True, exist_ok=True)
        partial = workspace / f".{_NAME}.partial"
        partial.write_text(json.dumps(vars(self)))
        partial.replace(workspace / _NAME)

    @staticmethod
    def read(workspace: Path) -> "Index | None":
        """The list that a folder holds, None if it holds none.

        Raises:
            StudyError: the file is something else.
        """
        path = workspace / _NAME
        if not path.is_file():
            return None
        try:
            return Index(**json.loads(path.read_text()))
        except (ValueError, TypeError) as error:
            raise StudyError(f"{path}: not the list of a study: {error}") from error


@dataclass(frozen=True)
class Outcome:
    """A study that was run, or as much as there is of it.

    Attributes:
        index: its cells.
        records: of the cells that have one, in the order of the study.
        missing: titles of the cells that have none.
        errors: what went wrong outside a cell, a line each.
    """

    index: Index
    records: tuple[Record, ...]
    missing: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()

    @property
    def failures(self) -> tuple[Record, ...]:
        """The records of cells that raised."""
        return tuple(r for r in self.records if r.failure is not None)


def load(workspace: Path, errors: tuple[str, ...] = ()) -> Outcome:
    """What there is of the study in a folder.

    Raises:
        StudyError: there is no study in that folder, or one of its files is broken.
    """
    index = Index.read(workspace)
    if index is None:
        raise StudyError(f"{workspace / _NAME}: no such file; expected a folder that a study was run in")
    found = {key: records.read(path) for key in index.keys if (path := records.path_of(workspace, key)).is_file()}
    cells = list(zip(index.keys, index.titles, index.configs, strict=True))
    missing = tuple(title for key, title, _ in cells if key not in found)
    known = tuple(replace(found[key], title=title, config=config) for key, title, config in cells if key in found)
    return Outcome(index, known, missing, errors)

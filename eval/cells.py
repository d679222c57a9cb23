"""A cell of a study: one estimator with one prior on one recording, and the name that its result gets."""

import hashlib
import json
from collections.abc import Collection
from collections.abc import Sequence as ListLike
from dataclasses import asdict, dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from platform import python_version
from typing import Any, Protocol

from eval.errors import StudyError
from navcore.sequence import Sequence

_DISTRIBUTIONS = ("msckf-ipnet", "numpy", "scipy", "opencv-python-headless", "mujoco")
_SCORING = ("alignment.py", "metrics.py", "consistency.py", "records.py", "sources.py", "work.py")
"""The files of this package that decide what a result says; the others only show it."""


class Source(Protocol):
    """Where a cell's recording comes from; a frozen dataclass of plain values, so that it has a hash."""

    def load(self, workspace: Path) -> Sequence:
        """The recording; `workspace` is the folder of the study."""
        ...

    def __hash__(self) -> int: ...


@dataclass(frozen=True)
class Cell:
    """One run of a study.

    Attributes:
        source: the recording.
        scene: `points` or `rendered` or the like; with `condition` it names a group of cells.
        condition: what was done to vision, for people: `clean`, `blackout 5 s`.
        seed: cells of one group, seed and estimator differ only by arm, and are compared with each other.
        arm: name of the arm.
        prior: what `navcore.prior.load_prior` takes; a file is looked for in the study's folder.
        estimator: an entry point of the group `navcore.odometry`, or `module:function`.
        overrides: settings of the estimator by dotted name.
    """

    source: Source
    scene: str
    condition: str
    seed: int
    arm: str
    prior: str = "none"
    estimator: str = "msckf"
    overrides: tuple[tuple[str, Any], ...] = ()

    @property
    def config(self) -> dict[str, Any]:
        """Everything that decides the result, as JSON can hold it."""
        return asdict(self) | {"source": {"kind": type(self.source).__name__, **vars(self.source)}}

    @property
    def title(self) -> str:
        """The cell in a line."""
        return f"{self.scene}, {self.condition}, seed {self.seed}, {self.estimator}, {self.arm}"

    def key(self, versions: dict[str, str]) -> str:
        """Name of the cell's result: a hash of its config and of the versions that it is made with.

        Raises:
            StudyError: the config holds something that JSON cannot.
        """
        try:
            text = json.dumps({"config": self.config, "versions": versions}, sort_keys=True, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise StudyError(f"cell '{self.title}' cannot be named: {error}") from error
        return hashlib.sha256(text.encode()).hexdigest()[:20]


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


def versions(estimators: tuple[str, ...] = ("msckf",)) -> dict[str, str]:
    """What results depend on apart from their config: interpreter, libraries, and the code of this project.

    Args:
        estimators: as in `Cell.estimator`; the package of each one counts.
    """
    found = {name: _version(name) for name in _DISTRIBUTIONS}
    packages = {"navcore", "sim", *(_package(name) for name in estimators)}
    scoring = [Path(__file__).with_name(name) for name in _SCORING]
    return {"python": python_version(), **found, "code": code_digest(packages, scoring)}


def code_digest(packages: Collection[str], files: ListLike[Path] = ()) -> str:
    """A hash of all sources of some packages and of further files: changed code gives other results."""
    digest = hashlib.sha256()
    for package in sorted(packages):
        for file in sorted(_sources(package)):
            digest.update(file.read_bytes())
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"


def _package(estimator: str) -> str:
    """The top-level package behind an estimator's name."""
    if ":" in estimator:
        return estimator.split(":")[0].split(".")[0]
    for entry in metadata.entry_points(group="navcore.odometry", name=estimator):
        return entry.module.split(".")[0]
    return estimator


def _sources(package: str) -> list[Path]:
    spec = find_spec(package)
    folders = list(spec.submodule_search_locations or []) if spec else []
    return [f for folder in folders for f in Path(folder).rglob("*") if f.suffix in (".py", ".xml")]

"""A cell of a study: one estimator with one prior on one recording, and the name that its result gets."""

import hashlib
import json
from collections.abc import Collection
from collections.abc import Sequence as ListLike
from dataclasses import dataclass, fields, is_dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from platform import python_version
from typing import Any, Protocol

from eval.errors import StudyError
from navcore.sequence import Sequence

_DISTRIBUTIONS = ("msckf-ipnet", "numpy", "scipy", "opencv-python-headless", "mujoco")
_SCORING = ("alignment.py", "metrics.py", "consistency.py", "records.py", "flights.py", "sources.py", "work.py")
"""The files of this package that decide what a result says; the others only show it."""


@dataclass(frozen=True)
class Cost:
    """CPU seconds that a recording takes on the machine that `docs/study.md` names.

    Attributes:
        make_s: once, to render it.
        load_s: each time that cells of it are run.
        run_s: each of these cells.
    """

    make_s: float
    load_s: float
    run_s: float


class Source(Protocol):
    """Where a cell's recording comes from; a frozen dataclass of plain values, so that it has a hash."""

    @property
    def name(self) -> str:
        """Which recording of its group it is, for people: `seed 3`, `V1_01_easy`."""
        ...

    @property
    def cost(self) -> Cost:
        """What it takes."""
        ...

    def load(self, workspace: Path) -> Sequence:
        """The recording; `workspace` is the folder of the study."""
        ...

    def __hash__(self) -> int: ...


@dataclass(frozen=True)
class Cell:
    """One run of a study.

    Attributes:
        source: the recording.
        platform: what moved, and whether its vision is points or images: `quadrotor, points`.
        regime: what is asked: `outage, early`; its conditions are shown side by side.
        condition: one step of it: `clean`, `5 s`.
        seed: cells of one condition, seed and estimator differ only by arm, and are compared with each other.
        arm: name of the arm.
        prior: what `navcore.prior.load_prior` takes; a file is looked for in the study's folder.
        level: place of the condition on the regime's axis; None if its conditions have no order.
        axis: name of that axis.
        estimator: an entry point of the group `navcore.odometry`, or `module:function`.
        overrides: settings of the estimator by dotted name.
    """

    source: Source
    platform: str
    regime: str
    condition: str
    seed: int
    arm: str
    prior: str = "none"
    level: float | None = None
    axis: str = ""
    estimator: str = "msckf"
    overrides: tuple[tuple[str, Any], ...] = ()

    @property
    def work(self) -> dict[str, Any]:
        """What decides the result, as JSON can hold it."""
        source = described(self.source)
        return {"source": source, "prior": self.prior, "estimator": self.estimator, "overrides": self.overrides}

    @property
    def config(self) -> dict[str, Any]:
        """What decides the result, and where it is shown."""
        return {**vars(self), **self.work, "recording": self.source.name}

    @property
    def title(self) -> str:
        """The cell in a line."""
        where = f"{self.platform}, {self.regime}, {self.condition}, {self.source.name}"
        return f"{where}, {self.estimator}, {self.arm}"

    def key(self, versions: dict[str, str]) -> str:
        """Name of the cell's result: a hash of what decides it and of the versions that it is made with.

        Cells that ask the same of the same recording in different regimes share their result.

        Raises:
            StudyError: the cell holds something that JSON cannot.
        """
        try:
            text = json.dumps({"work": self.work, "versions": versions}, sort_keys=True, allow_nan=False)
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


def described(source: Any) -> dict[str, Any]:
    """A source, or a part of one, as JSON can hold it: its kind and its fields."""
    parts = {f.name: getattr(source, f.name) for f in fields(source)}
    plain = {name: described(value) if is_dataclass(value) else value for name, value in parts.items()}
    return {"kind": type(source).__name__, **plain}


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


def _sources(package: str) -> set[Path]:
    spec = find_spec(package)
    folders = {Path(place).resolve() for place in spec.submodule_search_locations or []} if spec else set()
    return {f for folder in folders for f in folder.rglob("*") if f.suffix in (".py", ".xml")}

"""A cell of a study: one estimator with one prior on one recording, and the name that its result gets."""

import hashlib
import json
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, Protocol

from eval.errors import StudyError
from eval.versions import of_cell
from navcore.prior import split_prior
from navcore.sequence import Sequence

Kind = Literal["clean", "degraded", "other"]
_PACE = {"factor": 4.0}  # CPU time of an estimator over the filter's, which sources know


@dataclass(frozen=True)
class Cost:
    """CPU seconds that a recording takes on the machine that `docs/study.md` names.

    Attributes:
        make_s: once, to render it.
        load_s: each time that cells of it are run.
        run_s: each of these cells, of the filter.
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
        kind: what the study's headline counts it as: clean vision, or one of those in which a prior should matter.
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
    kind: Kind = "other"

    @property
    def cost_s(self) -> float:
        """CPU seconds that it takes once its recording is loaded."""
        return self.source.cost.run_s * _PACE.get(self.estimator, 1.0)

    @property
    def priors(self) -> tuple[str, ...]:
        """Names of the sources that its prior comes from."""
        return _names(self.prior)

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

        Cells that ask the same of the same recording in different regimes share their result. Of the versions of
        estimators and priors only its own count: what is trained anew changes no result of another arm.

        Raises:
            StudyError: the cell holds something that JSON cannot.
        """
        try:
            own = of_cell(versions, self.estimator, self.priors)
            text = json.dumps({"work": self.work, "versions": own}, sort_keys=True, allow_nan=False)
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


@lru_cache
def _names(prior: str) -> tuple[str, ...]:
    return tuple(part.partition(":")[0] for part in split_prior(prior))

"""What a worker must have before it may do anything for a study: its code and libraries, and its folder."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from eval.errors import StudyError
from eval.versions import versions


@dataclass(frozen=True)
class Workplace:
    """Where and with what a study is made.

    Attributes:
        versions: as `eval.versions.versions` gives them.
        estimators, priors: for which it gave them.
        folder: of the study; the same for all workers.
    """

    versions: dict[str, str]
    estimators: tuple[str, ...]
    priors: tuple[str, ...]
    folder: Path

    def objection(self) -> str:
        """Why this process must not work on the study; empty if it may."""
        if not self.folder.is_dir():
            return f"does not see the study's folder {self.folder}"
        here = _versions_here(self.estimators, self.priors)
        other = [f"{k} {here.get(k)} instead of {v}" for k, v in self.versions.items() if here.get(k) != v]
        return f"runs other versions than the study: {', '.join(other)}" if other else ""

    def check(self) -> None:
        """Refuse to work where something is amiss.

        Raises:
            StudyError: `objection` has one.
        """
        objection = self.objection()
        if objection:
            raise StudyError(f"a worker {objection}")


@lru_cache
def _versions_here(estimators: tuple[str, ...], priors: tuple[str, ...]) -> dict[str, str]:
    """What this process runs, as it was when it was first asked: code that is loaded stays what it was."""
    return versions(estimators, priors)

"""Many recordings of one platform without cameras, to learn from: grades, difficulties and starts take turns."""

import json
import multiprocessing
import signal
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from sim.errors import ConfigError
from sim.imu import grade
from sim.output import Progress
from sim.output.folder import ORIGIN
from sim.platforms import DIFFICULTIES, PLATFORMS
from sim.record import record

Start = Literal["still", "moving"]
"""Two seconds of standing still first, or in full motion from the first sample on."""


@dataclass(frozen=True)
class Fleet:
    """Recordings that differ by seed, and in turn by everything that is listed: the k-th takes entry k of each
    list, which begins again at its end. Lists whose lengths share no factor meet in all combinations.

    Attributes:
        platform: which body moves.
        count: how many recordings.
        first_seed: of the first; each next one has the next.
        seconds: length of each.
        imu: grades in turn.
        difficulty: of the motion, in turn.
        start: how each begins, in turn.

    Raises:
        ConfigError: an unknown name, an empty list, or fewer than one recording.
    """

    platform: str
    count: int
    first_seed: int
    seconds: float
    imu: tuple[str, ...]
    difficulty: tuple[str, ...]
    start: tuple[Start, ...]

    def __post_init__(self) -> None:
        if self.count < 1:
            raise ConfigError(f"count is {self.count}, expected 1 or more")
        _check("platform", (self.platform,), tuple(PLATFORMS))
        _check("difficulty", self.difficulty, tuple(DIFFICULTIES))
        _check("start", self.start, get_args(Start))
        if not self.imu:
            raise ConfigError("imu is empty, expected one or more grades")
        for name in self.imu:
            grade(name)

    def members(self) -> list["Member"]:
        """All recordings, in the order of their seeds."""
        return [
            Member(
                self.platform,
                self.seconds,
                self.first_seed + k,
                imu=self.imu[k % len(self.imu)],
                difficulty=self.difficulty[k % len(self.difficulty)],
                moving_start=self.start[k % len(self.start)] == "moving",
            )
            for k in range(self.count)
        ]

    def write(
        self, out: Path, *, workers: int = 1, flights: Path | None = None, progress: Progress | None = None
    ) -> None:
        """Write what is not there yet, each recording as a folder `PLATFORM-SEED` of `out`.

        A recording appears whole or not at all. Interrupted, those that are being written are finished, and the
        same call goes on with the next.

        Args:
            out: the folder of the fleet; recordings in it that are whole are kept.
            workers: processes that write at the same time; the bytes do not depend on it.
            flights: where motions are kept and found again (`sim.flights`).
            progress: gets the number of recordings that are there and of all.

        Raises:
            ConfigError: a folder of that name holds something else, fewer than one worker, or as `sim.record.record`.
        """
        if workers < 1:
            raise ConfigError(f"workers is {workers}, expected 1 or more")
        members = self.members()
        wanted = [member for member in members if not member.is_in(out)]
        done = len(members) - len(wanted)
        tell = progress or (lambda done, total: None)
        tell(done, len(members))
        if not wanted:
            return
        context = multiprocessing.get_context("spawn")  # a forked child shares locks that it cannot see released
        with ProcessPoolExecutor(min(workers, len(wanted)), context, _leave_interrupts_to_the_parent) as pool:
            try:
                for future in as_completed([pool.submit(member.write, out, flights) for member in wanted]):
                    future.result()
                    done += 1
                    tell(done, len(members))
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise


@dataclass(frozen=True)
class Member:
    """One recording of a fleet; its fields are the arguments of `sim.record.record`."""

    platform: str
    seconds: float
    seed: int
    imu: str
    difficulty: str
    moving_start: bool

    def folder(self, out: Path) -> Path:
        """Where it is in the folder of its fleet."""
        return out / f"{self.platform}-{self.seed}"

    def is_in(self, out: Path) -> bool:
        """Whether it is there already.

        Raises:
            ConfigError: something else is there.
        """
        folder = self.folder(out)
        if not folder.exists():
            return False
        try:
            origin = json.loads((folder / ORIGIN).read_text())
        except (OSError, ValueError) as error:
            raise ConfigError(f"{folder} is there already, and no recording of a fleet") from error
        other = {name: origin.get(name) for name, value in self._origin.items() if origin.get(name) != value}
        if other:
            raise ConfigError(f"{folder} is another recording: {other}, expected {self._origin}")
        return True

    def write(self, out: Path, flights: Path | None) -> None:
        """Write it."""
        record(
            self.platform,
            self.seconds,
            self.seed,
            self.folder(out),
            mode="imu",
            imu=self.imu,
            difficulty=self.difficulty,
            moving_start=self.moving_start,
            flights=flights,
        )

    @property
    def _origin(self) -> dict[str, object]:
        """What its `origin.json` must say."""
        return {**vars(self), "mode": "imu", "noise_seed": None}


def _check(name: str, given: tuple[str, ...], known: tuple[str, ...]) -> None:
    wrong = [value for value in given if value not in known]
    if wrong or not given:
        raise ConfigError(f"{name} is {', '.join(wrong) or 'empty'}; known are {', '.join(known)}")


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)

"""What a study asks: regimes, each a few settings side by side; chosen by design, before any result."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

from eval.cells import Kind
from eval.flights import Flight, PointsFlight
from sim.degrade import Schedule
from sim.degrade.schedule import MAX_SEVERITY, Degradation
from sim.imu import GRADES
from sim.platforms import DIFFICULTIES
from sim.points import IMU_GRADE

SEVERITIES = tuple(range(MAX_SEVERITY + 1))
"""Clean, then every severity."""
OUTAGES_S = (0.0, 5.0, 10.0, 20.0, 30.0)
LYING = "moving_objects"
"""The kind of degradation whose vision is wrong rather than poor."""
POOREST = tuple(GRADES)[-1]
"""The IMU grade with the largest biases, which walk fastest."""
_LONG_S = 10.0
"""Without images for so long in all, but for what a schedule rounds, vision counts as gone bad."""


@dataclass(frozen=True)
class Setting:
    """A flight without its body and its seed, and what happens to its vision."""

    seconds: float = 50.0
    degrade: str = ""  # as `Schedule.parse` reads it
    difficulty: str = "medium"
    moving_start: bool = False
    imu: str = IMU_GRADE
    scene: str = "room"
    features: int = 150  # in an image, in points mode

    def flight(self, platform: str, seed: int) -> Flight:
        """The flight of a body."""
        return Flight(platform, self.seconds, seed, self.difficulty, self.moving_start, self.imu, self.scene)

    def points(self, platform: str, seed: int) -> PointsFlight:
        """The same in points mode."""
        return PointsFlight(self.flight(platform, seed), self.degrade, max_features=self.features)


@dataclass(frozen=True)
class Condition:
    """One step of a regime: its name, its setting, and its place on the regime's axis if there is one."""

    name: str
    setting: Setting
    level: float | None = None

    @property
    def kind(self) -> Kind:
        """What a study's headline counts it as: starts in motion and the poorest IMU are degraded too."""
        hard = self.setting.moving_start or self.setting.imu == POOREST
        return "degraded" if hard else kind_of(Schedule.parse(self.setting.degrade).degradations)


@dataclass(frozen=True)
class Regime:
    """Conditions that are shown side by side.

    Attributes:
        name: for people.
        conditions: in the order in which they are shown.
        axis: what their levels measure; empty if they have none.
    """

    name: str
    conditions: tuple[Condition, ...]
    axis: str = ""


def outage(name: str, start_s: float, lengths_s: Iterable[float] = OUTAGES_S, base: Setting | None = None) -> Regime:
    """Vision is away from `start_s` on, for so long."""
    base = base or Setting()
    conditions = []
    for length_s in lengths_s:
        degrade = f"blackout@{start_s:g}-{start_s + length_s:g}" if length_s else ""
        conditions.append(Condition(_seconds(length_s), replace(base, degrade=degrade), length_s))
    return Regime(name, tuple(conditions), "length of the outage [s]")


def graded(name: str, kind: str, severities: Iterable[int] = SEVERITIES, base: Setting | None = None) -> Regime:
    """A kind of degradation in the middle of a flight, by severity."""
    base = base or Setting()
    start_s, end_s = 0.3 * base.seconds, 0.8 * base.seconds
    conditions = []
    for severity in severities:
        degrade = f"{kind}:{severity}@{start_s:g}-{end_s:g}" if severity else ""
        name_of = f"severity {severity}" if severity else "clean"
        conditions.append(Condition(name_of, replace(base, degrade=degrade), float(severity)))
    return Regime(name, tuple(conditions), "severity")


def start_in_motion(features: Iterable[int] = (100, 50, 25, 12), base: Setting | None = None) -> Regime:
    """The recording begins in full motion, with so many features: biases are not known, and hard to see."""
    base = replace(base or Setting(20.0), moving_start=True)
    conditions = (Condition(f"{n} features", replace(base, features=n), float(n)) for n in features)
    return Regime("start in motion", tuple(conditions), "features in an image")


def grades(start_s: float, length_s: float, names: Iterable[str] | None = None) -> Regime:
    """Each IMU through the same outage."""
    degrade = f"blackout@{start_s:g}-{start_s + length_s:g}"
    found = (Condition(n, Setting(degrade=degrade, imu=n)) for n in (names or GRADES))
    return Regime(f"IMU, outage of {length_s:g} s", tuple(found))


def difficulties(start_s: float, length_s: float) -> Regime:
    """Each difficulty of motion through the same outage."""
    degrade = f"blackout@{start_s:g}-{start_s + length_s:g}"
    found = (Condition(n, Setting(degrade=degrade, difficulty=n)) for n in DIFFICULTIES)
    return Regime(f"motion, outage of {length_s:g} s", tuple(found))


def kind_of(degradations: Iterable[Degradation]) -> Kind:
    """What a study's headline counts vision as: wrong, or away for long, is degraded."""
    found = tuple(degradations)
    away_s = sum(d.end_s - d.start_s for d in found if d.kind == "blackout")
    if away_s > _LONG_S - 0.01 or any(d.kind == LYING for d in found):
        return "degraded"
    return "other" if found else "clean"


def _seconds(length_s: float) -> str:
    return f"{length_s:g} s" if length_s else "clean"

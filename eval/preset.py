"""Studies that are chosen beforehand; docs/study.md says why these cells."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from eval.arms import BASE, ESTIMATORS, Arm, Sources, Told, told, told_all, told_joined, weighed, write_device
from eval.cells import Cell, Source, Study
from eval.errors import StudyError
from eval.regimes import (
    LYING,
    OUTAGES_S,
    POOREST,
    Condition,
    Regime,
    Setting,
    difficulties,
    graded,
    grades,
    outage,
    start_in_motion,
)
from eval.sources import rendered
from sim.degrade.schedule import GRADED
from sim.platforms import PLATFORMS

DEVICE_SEEDS = range(1001, 1041)
"""Flights from which the arm `constant` knows the device; a study flies lower ones."""
_OTHER_NOISE = 1


@dataclass(frozen=True)
class Block:
    """A regime on some platforms, with tracks or with images.

    Attributes:
        regime: what is asked.
        platforms: of whom.
        images: rendered flights; otherwise points.
        chance: the base runs a second time with other noise, to show what chance does; with points only.
        told: the arms, instead of the preset's.
    """

    regime: Regime
    platforms: tuple[str, ...] = ("quadrotor",)
    images: bool = False
    chance: bool = False
    told: Told | None = None


@dataclass(frozen=True)
class Preset:
    """A study of flights that are simulated.

    Attributes:
        name: of the study.
        blocks: what is asked of whom.
        seeds: flights of a condition in points mode, seeds 1 to this; six are the fewest that give an interval.
        rendered_seeds: the same for rendered ones; 0 renders none.
        told: the arms.
        estimators: each runs every cell.
    """

    name: str
    blocks: tuple[Block, ...]
    seeds: int
    rendered_seeds: int
    told: Told = told_joined
    estimators: tuple[str, ...] = ("msckf",)

    def study(self, workspace: Path) -> Study:
        """The cells; the files of the arm `constant` are put in `workspace`.

        Raises:
            StudyError: no seeds, or more than are free of the device's own recordings.
        """
        if not 1 <= self.seeds < DEVICE_SEEDS.start or not 0 <= self.rendered_seeds < DEVICE_SEEDS.start:
            wrong = f"seeds {self.seeds}, rendered seeds {self.rendered_seeds}"
            raise StudyError(f"{wrong}; allowed is up to {DEVICE_SEEDS.start - 1}, and 0 rendered ones")
        settings = [c.setting for block in self.blocks for c in block.regime.conditions]
        devices = {imu: write_device(workspace, imu, DEVICE_SEEDS) for imu in dict.fromkeys(s.imu for s in settings)}
        cells = [cell for block in self.blocks for cell in self._cells(block, devices)]
        return Study(self.name, tuple(cells), BASE)

    def _cells(self, block: Block, devices: dict[str, str]) -> Iterator[Cell]:
        for platform in block.platforms:
            for seed in range(1, (self.rendered_seeds if block.images else self.seeds) + 1):
                for condition in block.regime.conditions:
                    arms = (block.told or self.told)(Sources.simulated(platform, devices[condition.setting.imu]))
                    chance = (Arm(f"{BASE}, reseeded", "none", noise_seed=_OTHER_NOISE),) if block.chance else ()
                    for estimator in self.estimators:
                        yield from _run(block, platform, seed, condition, estimator, (*arms, *chance))


def _run(
    block: Block, platform: str, seed: int, condition: Condition, estimator: str, arms: tuple[Arm, ...]
) -> Iterator[Cell]:
    setting, regime = condition.setting, block.regime
    for arm in (a for a in arms if a.is_for(estimator)):
        if block.images:
            source: Source = rendered(setting.flight(platform, seed), setting.degrade)
        else:
            source = arm.reseeded(setting.points(platform, seed))
        yield Cell(
            source=source,
            platform=f"{platform}, {'rendered' if block.images else 'points'}",
            regime=regime.name,
            condition=condition.name,
            seed=seed,
            arm=arm.name,
            prior=arm.prior,
            level=condition.level,
            axis=regime.axis,
            estimator=estimator,
            overrides=arm.overrides,
            kind=condition.kind,
        )


_ALL = tuple(PLATFORMS)
_OTHERS = tuple(name for name in PLATFORMS if name != "quadrotor")
_RENDERED = Setting(35.0)
_BRIEF = Setting(40.0)
_EARLY = outage("outage, early", 10.0, base=Setting(60.0))
_LATE = outage("outage, late", 50.0, base=Setting(90.0))
_EASY = outage("still and straight, then an outage", 25.0, (0.0, 10.0, 20.0), Setting(difficulty="easy"))
_SMALL = Regime(
    "vision gone bad",
    (
        Condition("clean", _RENDERED),
        Condition("low light", replace(_RENDERED, degrade="low_light:4@15-30")),
        Condition("blackout 5 s", replace(_RENDERED, degrade="blackout@20-25")),
    ),
)  # rendered once
_BLURRED = Condition("motion blur", replace(_RENDERED, degrade="motion_blur:4@15-30"))  # a rendering of its own

QUICK = Preset(
    "Degradations in brief",
    (
        Block(_SMALL, images=True),
        Block(outage("outage", 15.0, (0.0, 10.0, 20.0), _BRIEF), chance=True),
        Block(start_in_motion((25,))),
        Block(graded("wrong vision", LYING, (0, 5), _BRIEF)),
        Block(outage("outage", 15.0, (10.0,), _BRIEF), _OTHERS),
    ),
    seeds=6,
    rendered_seeds=1,
    told=told,
)
"""Minutes: statistics of one question for each regime, and a rendered flight to look at."""

STANDARD = Preset(
    "Degradations and priors",
    (
        Block(replace(_SMALL, conditions=(*_SMALL.conditions, _BLURRED)), _ALL, images=True),
        Block(graded("low light", "low_light", (0, 2, 3, 4), _RENDERED), images=True),
        Block(graded("wrong vision", LYING, (0, 3, 5), _RENDERED), images=True),
        Block(_EARLY, _ALL, chance=True),
        Block(_LATE, _ALL, chance=True),
        Block(start_in_motion(), _ALL, chance=True),
        Block(graded("wrong vision", LYING), _ALL),
        Block(_EASY, _ALL),
        Block(grades(25.0, 10.0)),
        Block(difficulties(25.0, 10.0)),
        Block(graded("low light", "low_light")),
        Block(graded("motion blur", "motion_blur")),
    ),
    seeds=8,
    rendered_seeds=6,
)
"""Hours: every regime in which a bias prior can matter, on every platform."""

FULL = Preset(
    "Degradations and priors, in full",
    (
        *(Block(graded(kind.replace("_", " "), kind, base=_RENDERED), _ALL, images=True) for kind in GRADED),
        Block(outage("outage", 10.0, OUTAGES_S[:-1], _RENDERED), _ALL, images=True),
        Block(_EARLY, _ALL, chance=True),
        Block(_LATE, _ALL, chance=True),
        Block(start_in_motion(), _ALL, chance=True),
        Block(_EASY, _ALL),
        Block(grades(25.0, 10.0), _ALL),
        Block(difficulties(25.0, 10.0), _ALL),
        *(Block(graded(kind.replace("_", " "), kind), _ALL) for kind in GRADED),
    ),
    seeds=12,
    rendered_seeds=6,
)
"""Days: every kind in all severities, on every platform, with images and without."""

_MIDDLE = Setting(70.0)  # an outage from 45 s on comes when sources of long windows have spoken
_STUCK = outage("still and straight, then an outage", 25.0, (20.0,), Setting(difficulty="easy"))

ABLATION = Preset(
    "Factor against filter",
    (
        Block(outage("outage", 45.0, (0.0, 10.0, 20.0), _MIDDLE), chance=True),
        Block(outage("outage", 45.0, (10.0,), _MIDDLE), _OTHERS, chance=True),
        Block(start_in_motion((25,)), _ALL, chance=True),
        Block(graded("wrong vision", LYING, (0, 5), _BRIEF), _ALL),
        Block(outage(f"IMU {POOREST}", 20.0, (10.0,), replace(_BRIEF, imu=POOREST)), _ALL),
        Block(_STUCK),
        Block(outage("outage, W swept", 45.0, (10.0,), _MIDDLE), told=weighed),
    ),
    seeds=6,
    rendered_seeds=0,
    told=told_all,
    estimators=ESTIMATORS,
)
"""Filter and smoother, told everything there is, where a prior should matter and where it should do no harm."""

PRESETS = {"quick": QUICK, "standard": STANDARD, "full": FULL, "ablation": ABLATION}
"""Presets by name."""

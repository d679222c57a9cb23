"""Studies that are chosen beforehand: `sim`, the synthetic degradation study."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from eval.arms import BASE, Arm, write_device
from eval.cells import Cell, Study
from eval.errors import StudyError
from eval.sources import PointsFlight, RenderedFlight

_FIRST_DEVICE_SEED = 1001
_DEVICE_RECORDINGS = 40
_OTHER_NOISE = 1


@dataclass(frozen=True)
class Condition:
    """What is done to vision: its name, and the schedule as `sim.schedule` reads it."""

    name: str
    degrade: str


POINTS = (
    Condition("clean", ""),
    Condition("blackout 5 s", "blackout@25-30"),
    Condition("blackout 10 s", "blackout@25-35"),
)
RENDERED = (
    Condition("clean", ""),
    Condition("low light", "low_light:4@15-30"),
    Condition("motion blur", "motion_blur:4@15-30"),
    Condition("blackout 5 s", "blackout@20-25"),
)
_SHORTEST_S = {"seconds": 50.0, "rendered_seconds": 35.0}


@dataclass(frozen=True)
class SimPreset:
    """One rendered flight under every kind of degradation, and statistics over seeds in points mode."""

    platform: str = "quadrotor"  # which body moves
    seconds: float = 50.0  # length of the recordings in points mode
    seeds: int = 6  # flights in points mode, seeds 1 to this; six is the fewest that give an interval
    rendered_seconds: float = 35.0  # length of the rendered flight
    rendered_seed: int = 1  # the flight that is rendered; 0 renders none

    def study(self, workspace: Path) -> Study:
        """The cells; the file of the arm `constant` is put in `workspace`.

        Raises:
            StudyError: no seeds, or more than are free of the device's own recordings; recordings so short
                that the degradations do not fit.
        """
        if not 1 <= self.seeds < _FIRST_DEVICE_SEED or not 0 <= self.rendered_seed < _FIRST_DEVICE_SEED:
            raise StudyError(f"seeds {self.seeds}, {self.rendered_seed}; allowed is up to {_FIRST_DEVICE_SEED - 1}")
        for name, least in _SHORTEST_S.items():
            if getattr(self, name) < least:
                raise StudyError(f"{name} is {getattr(self, name)}; the degradations need at least {least}")
        seeds = range(_FIRST_DEVICE_SEED, _FIRST_DEVICE_SEED + _DEVICE_RECORDINGS)
        device = write_device(workspace, self.platform, seeds)
        arms = (Arm(BASE, "none"), Arm("constant", f"constant:{device}"), Arm("truth", "truth"))
        reseeded = Arm("none, reseeded", "none", noise_seed=_OTHER_NOISE)
        cells = [*self._rendered(arms), *self._points((*arms, reseeded))]
        return Study("Synthetic degradation study", tuple(cells), BASE)

    def _rendered(self, arms: tuple[Arm, ...]) -> Iterator[Cell]:
        if not self.rendered_seed:
            return
        for condition in RENDERED:
            source = RenderedFlight.of(self.platform, self.rendered_seconds, self.rendered_seed, condition.degrade)
            for arm in arms:
                yield Cell(source, "rendered", condition.name, self.rendered_seed, arm.name, arm.prior)

    def _points(self, arms: tuple[Arm, ...]) -> Iterator[Cell]:
        for seed in range(1, self.seeds + 1):
            for condition in POINTS:
                source = PointsFlight(self.platform, self.seconds, seed, condition.degrade)
                for arm in arms:
                    yield Cell(arm.reseeded(source), "points", condition.name, seed, arm.name, arm.prior)


PRESETS = {"sim": SimPreset}
"""Presets by name."""

"""Benchmarks: named cells, each a schedule that fits recordings of any length."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import yaml

from sim.degrade.recipes import fingerprint
from sim.degrade.schedule import Degradation, Schedule
from sim.errors import ConfigError

SPECS = {"v1": Path(__file__).with_name("v1.yaml")}
"""Those that come with the program; they never change."""

_KEYS = {"version", "seed", "recipes", "recovery_s", "cells"}
_NAME = re.compile(r"\w[\w.-]*")
_NUMBER = r"[0-9]+(?:\.[0-9]+)?"
_FORM = re.compile(rf"(?P<what>[^@]+)@(?P<start>{_NUMBER}%?)(?:-(?P<end>{_NUMBER}%?)|\+(?P<length>{_NUMBER}))")


@dataclass(frozen=True)
class Spec:
    """A benchmark.

    Attributes:
        name: of its file.
        seed: of everything random in it.
        recovery_s: how much of a recording must follow a span of fixed length.
        cells: schedules by name: `KIND[:SEVERITY]@START-END,...` or `@START+SECONDS`, with START and END in seconds
            from the first frame, or in percent of the time from the first frame to the last.
    """

    name: str
    seed: int
    recovery_s: float
    cells: Mapping[str, str]

    @staticmethod
    def load(name: str) -> "Spec":
        """A benchmark of `SPECS` by name, or one's own by the path of its file.

        Raises:
            ConfigError: there is none, it is no benchmark, or this program's recipes are not those it was made with.
        """
        path = SPECS.get(name, Path(name))
        if not path.is_file():
            raise ConfigError(f"benchmark {name!r} is unknown; expected {', '.join(SPECS)} or the path of a .yaml file")
        if path.stem in SPECS and path.resolve() != SPECS[path.stem].resolve():
            raise ConfigError(f"{path} has the name of the benchmark {path.stem}; give another benchmark another name")
        try:
            content = yaml.safe_load(path.read_text())
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise ConfigError(f"{path} is not YAML: {error}") from error
        if not isinstance(content, dict) or content.keys() != _KEYS or not isinstance(content["cells"], dict):
            raise ConfigError(f"{path} is no benchmark; expected the keys {', '.join(sorted(_KEYS))}")
        if content["recipes"] != fingerprint():
            made = f"was made with the recipes {content['recipes']}; this program has {fingerprint()}"
            raise ConfigError(f"{path} {made}: the same cells would not be the same images")
        cells = {str(name): str(cell) for name, cell in content["cells"].items()}
        for cell in cells:
            if not _NAME.fullmatch(cell):
                raise ConfigError(f"{path}: cell {cell!r}; a name has letters, digits, '_', '.' and '-' only")
        try:
            seed, recovery_s = int(content["seed"]), float(content["recovery_s"])
        except (TypeError, ValueError) as error:
            raise ConfigError(f"{path}: seed and recovery_s are numbers; {error}") from error
        if seed < 0 or not recovery_s >= 0.0:
            raise ConfigError(f"{path}: seed is {seed} and recovery_s {recovery_s}, expected 0 or more")
        spec = Spec(path.stem, seed, recovery_s, cells)
        for cell in spec.cells:
            spec.schedule(cell, 1e6)
        return spec

    def select(self, patterns: tuple[str, ...]) -> tuple[str, ...]:
        """The cells that match one of the patterns (`low_light-*`), in the benchmark's order; all without any.

        Raises:
            ConfigError: a pattern matches none.
        """
        for pattern in patterns:
            if not any(fnmatchcase(cell, pattern) for cell in self.cells):
                raise ConfigError(f"cell {pattern!r} is not in {self.name}; there are {', '.join(self.cells)}")
        return tuple(c for c in self.cells if not patterns or any(fnmatchcase(c, p) for p in patterns))

    def schedule(self, cell: str, duration_s: float) -> Schedule:
        """The schedule of a cell on a recording whose frames last so long.

        Raises:
            ConfigError: a span does not fit; the message says what it needs.
        """
        if cell not in self.cells:
            raise ConfigError(f"cell {cell!r} is not in {self.name}; there are {', '.join(self.cells)}")
        items = [item.strip() for item in self.cells[cell].split(",") if item.strip()]
        schedule = Schedule(tuple(self._degradation(cell, item, duration_s) for item in items))
        schedule.check(duration_s)
        return schedule

    def _degradation(self, cell: str, item: str, duration_s: float) -> Degradation:
        match = _FORM.fullmatch(item)
        if match is None:
            raise ConfigError(
                f"{self.name}, {cell}: {item!r} is not of the form KIND:SEVERITY@START-END or @START+SECONDS"
            )
        start_s = _seconds(match["start"], duration_s)
        if match["length"] is None:
            end_s = _seconds(match["end"], duration_s)
        else:
            end_s = start_s + float(match["length"])
            if end_s + self.recovery_s > duration_s:
                needs = f"needs {end_s + self.recovery_s:.1f} s, the recording has frames for {duration_s:.1f} s"
                raise ConfigError(f"{self.name}, {cell}: {item} {needs}")
        return Schedule.parse(f"{match['what']}@{start_s:.3f}-{end_s:.3f}").degradations[0]


def _seconds(text: str, duration_s: float) -> float:
    return 0.01 * float(text[:-1]) * duration_s if text.endswith("%") else float(text)

"""When vision is degraded, how, and how badly: `low_light:3@20-35,blackout@40-45`."""

import re
from dataclasses import dataclass

from sim.errors import ConfigError

GRADED = ("low_light", "motion_blur")
"""Kinds with a severity from 1 to 5."""
KINDS = ("blackout", *GRADED)
"""All kinds; a blackout has no severity, only a length."""
MAX_SEVERITY = 5

_FORM = re.compile(r"(?P<kind>[a-z_]+)(?::(?P<severity>[^@]*))?@(?P<start>[0-9.]+)-(?P<end>[0-9.]+)")


@dataclass(frozen=True)
class Degradation:
    """One degradation from `start_s` up to, not including, `end_s`, in seconds from the first frame."""

    kind: str
    start_s: float
    end_s: float
    severity: int = MAX_SEVERITY

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ConfigError(f"degradation {self.kind!r} is unknown; known are {', '.join(KINDS)}")
        if not 1 <= self.severity <= MAX_SEVERITY:
            raise ConfigError(f"severity of {self.kind} is {self.severity}, expected 1 to {MAX_SEVERITY}")
        if not 0.0 <= self.start_s < self.end_s:
            raise ConfigError(f"{self.kind} lasts from {self.start_s} s to {self.end_s} s; expected 0 <= start < end")


@dataclass(frozen=True)
class Schedule:
    """Degradations over time; several may overlap."""

    degradations: tuple[Degradation, ...] = ()

    @staticmethod
    def parse(spec: str) -> "Schedule":
        """Read `KIND[:SEVERITY]@START-END` items, separated by commas; an empty text is a clean schedule.

        Raises:
            ConfigError: an item has another form, an unknown kind or a bad severity; the message lists them.
        """
        return Schedule(tuple(_parse_item(item.strip()) for item in spec.split(",") if item.strip()))

    def with_blackouts(self, spans_s: tuple[tuple[float, float], ...]) -> "Schedule":
        """This schedule with blackouts added at (start, end) seconds."""
        return Schedule(self.degradations + tuple(Degradation("blackout", a, b) for a, b in spans_s))

    def severity(self, kind: str, t_s: float) -> int:
        """The worst severity of a kind at a time, 0 if it is not on."""
        found = (d.severity for d in self.degradations if d.kind == kind and d.start_s <= t_s < d.end_s)
        return max(found, default=0)


def _parse_item(item: str) -> Degradation:
    match = _FORM.fullmatch(item)
    kinds = ", ".join(KINDS)
    example = f"KIND:SEVERITY@START-END with KIND one of {kinds}, such as low_light:3@20-35 or blackout@40-45"
    if match is None:
        raise ConfigError(f"degradation {item!r} is not of the form {example}")
    kind, severity = match["kind"], match["severity"]
    try:
        start_s, end_s = float(match["start"]), float(match["end"])
        level = MAX_SEVERITY if severity is None else int(severity)
    except ValueError as error:
        raise ConfigError(f"degradation {item!r} is not of the form {example}") from error
    if kind in GRADED and severity is None:
        raise ConfigError(f"degradation {item!r} needs a severity from 1 to {MAX_SEVERITY}: {kind}:3@...")
    if kind == "blackout" and severity is not None:
        raise ConfigError(f"degradation {item!r}: a blackout has no severity, only a length: blackout@40-45")
    return Degradation(kind, start_s, end_s, level)

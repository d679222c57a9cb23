"""When vision is degraded, how, and how badly: `low_light:3@20-35,blackout@40-45`."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from sim.errors import ConfigError

RENDERED = ("motion_blur",)
"""Kinds that a rendered camera does itself, while its shutter is open (`Schedule.in_camera`)."""
SCENE = ("texture_loss", "light_switch", "moving_objects", "fog")
"""Kinds that change what there is to see."""
LENS = ("lens_dirt",)
"""Kinds that change what the lens lets through."""
EXPOSURE = ("low_light", "overexposure", "auto_exposure")
"""Kinds that change how much light the sensor gets, and what it makes of it."""
CODEC = ("jpeg",)
"""Kinds that act on the finished image."""
STREAM = ("frame_drops", "low_rate", "time_jitter", "time_offset")
"""Kinds that act on which frames come and on their stamps."""
GRADED = (*RENDERED, *SCENE, *LENS, *EXPOSURE, *CODEC, *STREAM)
"""Kinds with a severity from 1 to 5."""
KINDS = ("blackout", *GRADED)
"""All kinds; a blackout has no severity, only a length."""
MAX_SEVERITY = 5
END_MARGIN_S = 1.0
"""How far a degradation may reach beyond the last frame: recordings of N seconds have frames a little short of it."""

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

    def __str__(self) -> str:
        what = f"{self.kind}:{self.severity}" if self.kind in GRADED else self.kind
        return f"{what}@{self.start_s:.10g}-{self.end_s:.10g}"


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

    def __str__(self) -> str:
        return ",".join(str(d) for d in self.degradations)

    def with_blackouts(self, spans_s: tuple[tuple[float, float], ...]) -> "Schedule":
        """This schedule with blackouts added at (start, end) seconds."""
        return Schedule(self.degradations + tuple(Degradation("blackout", a, b) for a, b in spans_s))

    def only(self, kinds: Iterable[str]) -> "Schedule":
        """The part of some kinds."""
        wanted = frozenset(kinds)
        return Schedule(tuple(d for d in self.degradations if d.kind in wanted))

    @property
    def in_camera(self) -> "Schedule":
        """The part that a rendered camera does itself."""
        return self.only(RENDERED)

    @property
    def after_camera(self) -> "Schedule":
        """The part that is done to images once they are taken; with `in_camera` it makes the whole."""
        return self.only(kind for kind in KINDS if kind not in RENDERED)

    def worst(self, kind: str, t_s: float) -> Degradation | None:
        """The worst degradation of a kind at a time, the earlier of equals; None if there is none."""
        found = [d for d in self.degradations if d.kind == kind and d.start_s <= t_s < d.end_s]
        return max(found, key=lambda d: (d.severity, -d.start_s), default=None)

    def severity(self, kind: str, t_s: float) -> int:
        """The worst severity of a kind at a time, 0 if it is not on."""
        worst = self.worst(kind, t_s)
        return 0 if worst is None else worst.severity

    def check(self, duration_s: float) -> None:
        """Hold the schedule against a recording's length.

        Raises:
            ConfigError: a degradation begins after its end, or lasts more than `END_MARGIN_S` beyond it.
        """
        for d in self.degradations:
            if d.start_s >= duration_s or d.end_s > duration_s + END_MARGIN_S:
                raise ConfigError(f"{d} reaches beyond the recording, which has frames for {duration_s:.2f} s")


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

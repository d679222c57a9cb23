"""What is asked to happen to vision: a schedule in seconds, or a cell of a benchmark, which fits any length."""

from dataclasses import dataclass

from sim.degrade.schedule import Schedule
from sim.degrade.spec import Spec
from sim.errors import ConfigError

_CELL = "/"


@dataclass(frozen=True)
class Request:
    """A schedule, or a benchmark and one of its cells.

    Attributes:
        direct: the schedule; None for a cell.
        spec: the benchmark; None for a schedule.
        cell: of the benchmark.
    """

    direct: Schedule | None
    spec: Spec | None = None
    cell: str = ""

    @staticmethod
    def parse(text: str) -> "Request":
        """Read `KIND[:SEVERITY]@START-END,...` as `Schedule.parse` does, or `SPEC/CELL` such as `v1/night`.

        Raises:
            ConfigError: neither; an unknown kind, severity, benchmark or cell. The message lists what there is.
        """
        if "@" in text or _CELL not in text:
            return Request(Schedule.parse(text))
        name, _, cell = text.strip().rpartition(_CELL)
        spec = Spec.load(name)
        if cell not in spec.cells:
            raise ConfigError(f"cell {cell!r} is not in {spec.name}; there are {', '.join(spec.cells)}")
        return Request(None, spec, cell)

    def schedule(self, duration_s: float) -> Schedule:
        """The schedule on a recording with so many seconds from its first frame to its last.

        Raises:
            ConfigError: it reaches beyond the recording.
        """
        if self.direct is None:
            assert self.spec is not None
            return self.spec.schedule(self.cell, duration_s)
        self.direct.check(duration_s)
        return self.direct

    def seed(self, otherwise: int) -> int:
        """Of all that is random: a benchmark has its own."""
        return otherwise if self.spec is None else self.spec.seed

"""`python -m sim degrade`: a recording, degraded."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from sim.benchmark import carry_out, plan_cells, plan_one
from sim.commands.bar import progress_bar
from sim.degrade.spec import Spec
from sim.errors import ConfigError
from sim.output import Format, Progress


@dataclass(frozen=True)
class Degrade:
    """Degrade the images of any recording, real ones included: by the cells of a benchmark, or by a schedule."""

    recording: tyro.conf.Positional[Path | None] = None  # a folder or bag, with images
    out: Path | None = None  # folder to make; cells go to OUT/CELL
    spec: str = "v1"  # benchmark: v1, or the path of a .yaml file
    cell: tyro.conf.UseAppendAction[tuple[str, ...]] = ()  # by name or pattern, again for more; all without it
    degrade: str | None = None  # KIND[:SEVERITY]@START-END,... in place of a benchmark
    seed: int = 1  # of such a schedule; a benchmark has its own
    format: Format = "asl"  # EuRoC's layout, or a ROS bag
    show: Annotated[bool, tyro.conf.arg(name="list")] = False  # list the cells and end

    def run(self, console: Console) -> None:
        """Plan, say what is left out, write."""
        if self.show:
            for cell, what in Spec.load(self.spec).cells.items():
                console.print(f"{cell:24} {what}", markup=False, highlight=False)
            return
        if self.recording is None or self.out is None:
            raise ConfigError("a recording and --out are needed, or --list")
        if self.degrade is not None and self.cell:
            raise ConfigError("--cell is of a benchmark and --degrade is a schedule: one of them, not both")
        if self.degrade is not None:
            plan = plan_one(self.recording, self.degrade, self.seed, self.out, self.format)
        else:
            plan = plan_cells(self.recording, Spec.load(self.spec), self.cell, self.out, self.format)
        for line in (*plan.left_out, *(f"{folder} is there already" for folder in plan.done)):
            console.print(line, markup=False, highlight=False)
        with ExitStack() as bars:

            def bar(folder: Path) -> Progress:
                bars.close()
                return bars.enter_context(progress_bar(console, folder.name))

            carry_out(plan, self.format, bar)
        console.print(f"wrote {len(plan.jobs)} recording(s) in {self.out}")

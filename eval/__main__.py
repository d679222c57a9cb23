"""`python -m eval`: score a run, run a study, write its report."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from eval import files, metrics
from eval.alignment import Mode
from eval.errors import EvalError
from eval.outcome import Outcome, load
from eval.paired import paired
from eval.preset import PRESETS, SimPreset
from eval.tables import failure_table, group_table, paired_table, score_table
from navcore.errors import NavcoreError
from sim.errors import SimError


def score(
    run: tyro.conf.Positional[Path],
    truth: Path,
    alignment: Mode = "yaw",
    still_s: float | None = None,
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """Score a run against the truth.

    Args:
        run: the folder of a run, or a file in TUM format.
        truth: a recording, or a file in TUM format.
        alignment: what is fitted before errors are taken.
        still_s: the rig stood still for so many seconds at the end: report the drift in them.
        as_json: print JSON instead of a table.
    """
    estimate = files.read_estimate(run)
    scores = metrics.score(estimate, files.read_truth(truth), alignment=alignment)
    if still_s is not None:
        scores["still_drift_m"] = metrics.still_drift(estimate, still_s)
    if as_json:
        print(json.dumps(scores, indent=1, allow_nan=False))
    else:
        _console().print(score_table(scores, f"{run} against {truth}, {alignment} alignment").rich())
    return 0


def study(
    preset: Literal["sim"],
    config: tyro.conf.OmitArgPrefixes[SimPreset],
    out: Path = Path("results/sim"),
    scheduler: str | None = None,
    workers: int | None = None,
) -> int:
    """Run a study, or what is left of it, and write its report.

    Args:
        preset: which study.
        config: its size.
        out: its folder; a study that was stopped goes on there.
        scheduler: address of a Dask scheduler; a local cluster is started without one.
        workers: processes of the local cluster, one for each core by default.
    """
    from eval.report import write_report
    from eval.study import run_study

    console = _console()
    assert isinstance(config, PRESETS[preset])
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
    ) as bar:
        task = bar.add_task("preparing", total=None)
        planned = config.study(out)
        bar.update(
            task, description="cells (rendered flights take minutes before their first)", total=len(planned.cells)
        )
        outcome = run_study(
            planned,
            out,
            scheduler=scheduler,
            workers=workers,
            progress=lambda done, count: bar.update(task, completed=done, total=count),
        )
    page = write_report(outcome, out)
    return _show(outcome, page, console)


def report(folder: tyro.conf.Positional[Path]) -> int:
    """Write the report of a study anew, of as much as there is.

    Args:
        folder: that the study was run in.
    """
    from eval.report import write_report

    outcome = load(folder)
    return _show(outcome, write_report(outcome, folder), _console())


def _console() -> Console:
    """A terminal as wide as it is; what is piped into a file gets room for the tables."""
    return Console() if Console().is_terminal else Console(width=180)


def _show(outcome: Outcome, page: Path, console: Console) -> int:
    tables = [group_table(outcome.records), paired_table(paired(outcome.records, outcome.index.base))]
    wrong = failure_table(outcome)
    for table in [*tables, *([wrong] if wrong.rows else [])]:
        console.print(table.rich())
    console.print(f"{len(outcome.records)} cells in {outcome.index.seconds / 60.0:.1f} min. Report: {page}")
    return 1 if wrong.rows else 0


def main() -> int:
    """Parse the command line and do what it says."""
    commands: dict[str, Callable[..., int]] = {"score": score, "study": study, "report": report}
    try:
        code: int = tyro.extras.subcommand_cli_from_dict(commands, prog="python -m eval")
        return code
    except (EvalError, NavcoreError, SimError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())

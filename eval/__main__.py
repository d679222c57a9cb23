"""`python -m eval`: score a run, run a study, write its report."""

import json
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal, get_args

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

from eval import files, metrics
from eval.alignment import Mode
from eval.cells import Study
from eval.claims import claims_table
from eval.errors import EvalError
from eval.outcome import Outcome, load
from eval.paired import paired
from eval.preset import PRESETS
from eval.published import DatasetName, Published
from eval.tables import failure_table, overview_table, score_table
from eval.verdict import verdict_table, verdicts
from eval.work import check_priors
from msckf.config import FilterConfig
from navcore.command_line import command_line
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


def compare(
    trajectories: tyro.conf.Positional[tuple[Path, ...]],
    truth: Path,
    alignment: Mode = "yaw",
    plot: Path | None = None,
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """Score trajectories of any systems against one truth, over the time that all of them have.

    Args:
        trajectories: files in TUM format, or folders of runs.
        truth: a recording, or a file in TUM format.
        alignment: what is fitted before errors are taken, to each by itself.
        plot: file for a picture of the paths and of their errors over time.
        as_json: print JSON instead of a table.
    """
    from eval.compare import Comparison, named

    compared = Comparison.of(named(trajectories), files.read_truth(truth), alignment)
    if as_json:
        print(json.dumps(compared.scores(), indent=1, allow_nan=False))
    else:
        _console().print(compared.table().rich())
    if plot is not None:
        compared.save_plot(plot)
    return 0


def study(
    preset: Literal["quick", "standard", "full", "ablation"] = "quick",
    out: Path | None = None,
    seeds: int | None = None,
    rendered_seeds: int | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
) -> int:
    """Run a study, or what is left of it, and write its report.

    Args:
        preset: which study; docs/study.md lists their cells.
        out: its folder, results/PRESET by default; a study that was stopped goes on there.
        seeds: flights of a condition in points mode, instead of the preset's.
        rendered_seeds: the same with images; 0 renders none.
        scheduler: address of a Dask scheduler; a local cluster is started without one.
        workers: processes of the local cluster, one for each core by default.
    """
    chosen = PRESETS[preset]
    chosen = replace(chosen, seeds=chosen.seeds if seeds is None else seeds)
    chosen = replace(chosen, rendered_seeds=chosen.rendered_seeds if rendered_seeds is None else rendered_seeds)
    folder = out or Path("results") / preset
    plan = chosen.study(folder)
    check_priors(plan.cells, folder)
    return _run(plan, folder, scheduler, workers)


def benchmark(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    spec: str = "v1",
    cell: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    prior: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    ablation: bool = False,
    out: Path | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
) -> int:
    """Run a benchmark on recordings with images, real or not, or what is left of it, and write its report.

    Args:
        recordings: ASL folders or bags; their images are degraded when they are loaded.
        spec: the benchmark, by name or the path of its file.
        cell: which cells, by name or pattern such as `low_light-*`, again for more; all without it.
        prior: further arms beside `none` and, where truth has biases, `truth`: `constant:FILE.json`; again for more.
        ablation: filter and smoother with all arms of the ablation, for each recording, which must have the name of the
            public one that it is or replays, from weights that were made without it.
        out: its folder, results/SPEC by default; a study that was stopped goes on there.
        scheduler: address of a Dask scheduler; a local cluster is started without one.
        workers: processes of the local cluster, one for each core by default.
    """
    from eval.benchmark import Benchmark
    from sim.degrade.spec import Spec

    chosen = Spec.load(spec)
    folder = out or Path("results") / chosen.name
    plan, left_out = Benchmark(chosen, recordings, cell, prior, ablation).study(folder)
    for line in left_out:
        _console().print(line, markup=False, highlight=False)
    return _run(plan, folder, scheduler, workers)


def dataset(
    name: DatasetName,
    root: tyro.conf.Positional[Path],
    prior: str = "none",
    cameras: int | None = None,
    out: Path | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    estimator: str = "msckf",
    config: FilterConfig = FilterConfig(),  # noqa: B008
) -> int:
    """Run an estimator on every recording of the data set below a folder, or what is left, beside published figures.

    Args:
        name: of the data set.
        root: ASL folders or bags, however deep below it; archives are passed over.
        prior: where bias priors come from, as for `python -m msckf run`.
        cameras: how many of the rig's cameras are used; short for --config.cameras.
        out: folder of the results, results/NAME by default; a run that was stopped goes on there.
        scheduler: address of a Dask scheduler; a local cluster is started without one.
        workers: processes of the local cluster, one for each core by default.
        estimator: the filter, msckf, or another by its name, as factor.
        config: all settings of the filter; other estimators take the number of cameras.
    """
    from eval.datasets import FINISHED, Dataset, write_table
    from eval.survey import Survey

    console, folder = _console(), out or Path("results") / name
    with console.status("looking for recordings") as status:
        survey = Survey.of(root, lambda recording: status.update(f"reading {recording}"))
    for note in survey.notes:
        console.print(note, markup=False, highlight=False)
    config = config if cameras is None else config.with_overrides({"cameras": cameras})
    chosen = Dataset(Published.of(name), survey, prior, config, estimator)
    plan = chosen.study(folder)
    check_priors(plan.cells, folder)
    outcome = _outcome(plan, folder, scheduler, workers, console)
    results = chosen.results(outcome)
    for table in chosen.tables(results):
        console.print(table.rich())
    console.print(f"Table: {write_table(results, folder)}")
    return 0 if results.state.isin(FINISHED).all() and not outcome.errors else 1


def starts(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    times: int = 20,
    prior: str = "none",
    lead: float = 0.1,
    out: Path = Path("results/starts"),
    config: FilterConfig = FilterConfig(),  # noqa: B008
) -> int:
    """Start the filter from many times in recordings, or do what is left, and tabulate how soon and how well.

    Args:
        recordings: ASL folders or bags with truth, replays for instance.
        times: starts of each, evenly over it.
        prior: where bias priors come from, as for `python -m msckf run`.
        lead: seconds of IMU before the first frame, for a prior that watches the motion.
        out: folder of the results, a file for each start; what was stopped goes on there.
        config: all settings of the filter.
    """
    from eval.datasets import differences
    from eval.starts import Asked, measure_starts, starts_table

    console = _console()
    with Progress(
        BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn(), console=console
    ) as bar:
        task = bar.add_task("starts", total=len(recordings) * times)
        asked = Asked(times, prior, differences(asdict(FilterConfig()), asdict(config)), lead)
        scores = measure_starts(recordings, asked, out, lambda done, total: bar.update(task, completed=done))
    console.print(starts_table(scores).rich())
    return 0


def tables(
    root: tyro.conf.Positional[Path],
    out: Path = Path("results/tables"),
    scheduler: str | None = None,
    workers: int | None = None,
) -> int:
    """Make the paper's tables again, each figure beside the paper's: run what is left, and print them.

    Args:
        root: recordings with images, real ones or replays; sequences that the paper has and this has not stay open.
        out: folder of the results, and of the tables for LaTeX; a run that was stopped goes on there.
        scheduler: address of a Dask scheduler; a local cluster is started without one.
        workers: processes of the local cluster, one for each core by default.
    """
    from eval.paper import PaperTables
    from eval.report import save_tables, write_report
    from eval.survey import Survey

    console = _console()
    with console.status("looking for recordings") as status:
        survey = Survey.of(root, lambda recording: status.update(f"reading {recording}"))
    for note in (*survey.notes, *(f"{x.name}: {x.objection}" for x in survey.recordings if x.objection)):
        console.print(note, markup=False, highlight=False)
    asked = PaperTables(survey)
    plan = asked.study()
    check_priors(plan.cells, out)
    outcome = _outcome(plan, out, scheduler, workers, console)
    found = asked.tables(outcome)
    for table in found.values():
        console.print(table.rich())
    page = write_report(outcome, out)
    save_tables(found, out / "tables")
    wrong = failure_table(outcome)
    if wrong.rows:
        console.print(wrong.rich())
    console.print(f"Tables for LaTeX: {out / 'tables'}. Report: {page}")
    return 1 if wrong.rows else 0


def report(folder: tyro.conf.Positional[Path], run: str | None = None) -> int:
    """Write the report of a study anew, of as much as there is.

    Args:
        folder: that the study was run in.
        run: key of a run, or how it begins, as the report lists them: write a report of all arms on its recording
            alone, to FOLDER/runs/KEY.
    """
    from eval.report import of_recording, write_report

    outcome = load(folder)
    if run is not None:
        one = of_recording(outcome, run)
        return _show(one, write_report(one, folder, folder / "runs" / run), _console())
    return _show(outcome, write_report(outcome, folder), _console())


def _run(plan: Study, folder: Path, scheduler: str | None, workers: int | None) -> int:
    from eval.report import write_report

    console = _console()
    outcome = _outcome(plan, folder, scheduler, workers, console)
    return _show(outcome, write_report(outcome, folder), console)


def _outcome(plan: Study, folder: Path, scheduler: str | None, workers: int | None, console: Console) -> Outcome:
    from eval.bar import study_bar
    from eval.study import run_study

    with study_bar(console) as progress:
        return run_study(plan, folder, scheduler=scheduler, workers=workers, progress=progress)


_MOST_COLUMNS = 14
"""Of a table that can be read in a terminal."""


def _console() -> Console:
    """A terminal as wide as it is; what is piped into a file gets room for the tables."""
    return Console() if Console().is_terminal else Console(width=180)


def _show(outcome: Outcome, page: Path, console: Console) -> int:
    base = outcome.index.base
    overview = overview_table(outcome.records, paired(outcome.records, base), base)
    found, wrong = verdicts(outcome.records, base), failure_table(outcome)
    shown = [overview] if len(overview.columns) <= _MOST_COLUMNS else []
    for table in (*shown, verdict_table(found), claims_table(found), wrong):
        if table is not None and table.rows:
            console.print(table.rich())
    console.print(f"{len(outcome.records)} cells in {outcome.index.seconds / 60.0:.1f} min. Report: {page}")
    return 1 if wrong.rows else 0


def main() -> int:
    """Parse the command line and do what it says."""
    commands: dict[str, Callable[..., int]] = {
        "score": score,
        "compare": compare,
        "study": study,
        "benchmark": benchmark,
    }
    commands |= {name: partial(dataset, name) for name in get_args(DatasetName)}
    commands |= {"starts": starts, "tables": tables, "report": report}
    with command_line(EvalError, SimError, resumes=True):
        code: int = tyro.extras.subcommand_cli_from_dict(commands, prog="python -m eval")
        return code


if __name__ == "__main__":
    sys.exit(main())

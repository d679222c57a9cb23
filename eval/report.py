"""The report of a study: one page that needs no network; beside it its tables for LaTeX and its figures for papers."""

import json
import re
from collections.abc import Iterable, Mapping
from collections.abc import Sequence as ListLike
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from plotly.offline import get_plotlyjs

from eval import figures, images, pictures
from eval.claims import claims_table
from eval.errors import StudyError
from eval.outcome import Outcome
from eval.paired import Paired, paired
from eval.records import Record
from eval.tables import (
    Table,
    consistency_table,
    failure_table,
    group_table,
    number,
    overview_table,
    paired_table,
    percent,
)
from eval.verdict import verdict_table, verdicts

_TEMPLATE = Path(__file__).with_name("report.html")
_SHOWN_ROWS = 150


@dataclass(frozen=True)
class Chapter:
    """A regime of a platform and an estimator, as the page shows it: its place there, its figures by kind, its tables,
    all of its runs with the keys of their records, and what its pictures are drawn from."""

    platform: str
    title: str
    place: str
    figures: dict[str, Any]
    tables: list[Table]
    runs: list[tuple[str, tuple[str, ...]]]
    good: list[Record]
    pairs: list[Paired]


_RUN = ("condition", "arm", "recording", "ATE [m]", "ATE [°]", "complete", "start [s]", "")
"""Heads of the list of a chapter's runs, before the key of each."""


def write_report(outcome: Outcome, workspace: Path, folder: Path | None = None) -> Path:
    """Write `report.html`, whole or not at all, its tables for LaTeX and its figures as PNG and PDF.

    Args:
        outcome: what it is about.
        workspace: the study's folder.
        folder: where it is put, the study's folder by default.

    Returns:
        The path of the page.
    """
    folder = folder or workspace
    folder.mkdir(parents=True, exist_ok=True)
    records = [r for r in outcome.records if r.failure is None]
    pairs = paired(outcome.records, outcome.index.base)
    arms = figures.arms_of(outcome.records)
    chapters, examples = _chapters(outcome.records, pairs, arms), _examples(records, outcome.index.base)
    drawn = {f"{kind}-{c.place}": figure for c in chapters for kind, figure in c.figures.items()}
    for k, group in enumerate(examples):
        drawn |= {f"paths-{k}": figures.paths(group, arms), f"biases-{k}": figures.biases(group, arms)}
        drawn[f"health-{k}"] = figures.health(group)
    platforms: dict[str, list[Chapter]] = {}
    for chapter in chapters:
        platforms.setdefault(chapter.platform, []).append(chapter)
    failures = failure_table(outcome)
    found = verdicts(outcome.records, outcome.index.base)  # none if no cell counts as clean or degraded
    verdict, claims = verdict_table(found) if found else None, claims_table(found)
    overview = overview_table(outcome.records, pairs, outcome.index.base)
    consistency = consistency_table(records)
    text = (
        _environment()
        .get_template(_TEMPLATE.name)
        .render(
            name=outcome.index.name,
            made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
            facts=_facts(outcome),
            claims=claims,
            verdict=verdict,
            headlines=headlines(pairs),
            overview=overview,
            consistency=consistency,
            failures=failures if failures.rows else None,
            platforms=platforms,
            examples=[_title(group, records) for group in examples],
            samples=images.samples(records, workspace),
            run_heads=_RUN,
            workspace=workspace,
            plotly=get_plotlyjs(),
            figures=json.dumps(drawn, allow_nan=False).replace("</", "<\\/"),
        )
    )
    path = folder / "report.html"
    partial = path.with_name(".report.html.partial")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)
    _save_figures(chapters, arms, examples, folder / "figures")
    tables = {"overview": overview, "consistency": consistency} | ({"verdict": verdict} if verdict else {})
    tables |= {"claims": claims} if claims else {}
    for chapter in chapters:
        tables |= {f"{kind}-{chapter.place}": t for kind, t in zip(("scores", "paired"), chapter.tables, strict=True)}
    save_tables(tables, folder / "tables")
    return path


def of_recording(outcome: Outcome, key: str) -> Outcome:
    """All that a study has of the recording and condition of one of its runs: every arm of every estimator.

    Raises:
        StudyError: no run that is done has a key that begins so, or several have.
    """
    keys = sorted({r.key for r in outcome.records if r.key.startswith(key)})
    if len(keys) != 1:
        raise StudyError(f"{len(keys)} runs that are done have a key that begins with {key!r}; expected one")
    names = ("platform", "regime", "condition", "seed")
    places = {tuple(r.config[n] for n in names) for r in outcome.records if r.key == keys[0]}  # that share it
    mine = tuple(r for r in outcome.records if tuple(r.config[n] for n in names) in places)
    seconds = sum(r.scores.get("wall_s", 0.0) for r in mine)
    index = replace(outcome.index, name=f"{outcome.index.name}: {mine[0].config['recording']}", seconds=seconds)
    return replace(outcome, index=index, records=mine, missing=(), errors=())


def headlines(pairs: list[Paired]) -> list[str]:
    """What the study found, a sentence for each arm."""
    found = []
    several = len({p.estimator for p in pairs}) > 1
    for estimator, arm in dict.fromkeys((p.estimator, p.arm) for p in pairs):
        mine = [p for p in pairs if (p.estimator, p.arm) == (estimator, arm)]
        once = {(p.platform, p.estimator, p.log_ratios.tobytes()): p for p in mine}  # regimes share their clean runs
        known = [p for p in once.values() if p.median is not None and p.low is not None and p.high is not None]
        if not known:
            continue
        better = sum(p.high < 1.0 for p in known if p.high is not None)
        worse = sum(p.low > 1.0 for p in known if p.low is not None)
        middle = percent(float(np.median([p.median for p in known if p.median is not None])))
        apart = sum(p.diverged for p in once.values()), sum(p.base_diverged for p in once.values())
        line = f"{estimator}, {arm}" if several else arm
        line += f": ATE {middle} against {known[0].base} in the middle of {len(known)} conditions; the whole"
        line += f" interval is better in {better}, worse in {worse}; {apart[0]} runs diverged against {apart[1]}."
        found.append(line)
    return found


def _chapters(records: ListLike[Record], pairs: list[Paired], arms: list[str]) -> list[Chapter]:
    """All regimes, in the order of the study."""
    chapters = []
    for (platform, regime, estimator), group in _regimes(records).items():
        mine = [p for p in pairs if (p.platform, p.regime, p.estimator) == (platform, regime, estimator)]
        good = [r for r in group if r.failure is None]
        drawn: dict[str, Any] = {"ate": figures.ate_by_condition(good, arms)} if good else {}
        ratios = figures.ratios(good, mine, arms)
        drawn |= {"ratios": ratios} if ratios else {}
        title, place = f"{regime}{_whose(estimator, records)}", _slug(platform, regime, _whose(estimator, records))
        tables, runs = [group_table(group), paired_table(mine)], [(r.key, _run_row(r)) for r in group]
        chapters.append(Chapter(platform, title, place, drawn, tables, runs, good, mine))
    return chapters


def _run_row(record: Record) -> tuple[str, ...]:
    """A run in the list of a chapter's runs."""
    scores = record.scores
    forms = {"ate_m": ".4f", "ate_deg": ".3f", "completeness": ".1%", "start_s": ".2f"}
    told = (number(scores.get(name, np.nan), form) for name, form in forms.items())
    amiss = record.failure or ("diverged" if scores.get("diverged") == 1.0 else "")
    return (*(str(record.config[name]) for name in ("condition", "arm", "recording")), *told, amiss)


def _regimes(records: Iterable[Record]) -> dict[tuple[str, str, str], list[Record]]:
    """The records by platform, regime and estimator, in the order in which they come; a regime's estimators follow each
    other."""
    found: dict[tuple[str, str, str], list[Record]] = {}
    for record in records:
        names = (str(record.config[name]) for name in ("platform", "regime", "estimator"))
        found.setdefault(tuple(names), []).append(record)  # type: ignore[arg-type]
    order = list(dict.fromkeys(names[:2] for names in found))
    return dict(sorted(found.items(), key=lambda item: order.index(item[0][:2])))


def _whose(estimator: str, records: Iterable[Record]) -> str:
    """An estimator's name behind what it did; nothing where there is only one."""
    return f", {estimator}" if len({r.config["estimator"] for r in records}) > 1 else ""


def _examples(records: list[Record], base: str) -> list[list[Record]]:
    """Of every regime the last condition, on the lowest seed, in all arms that share the base's recording: not
    chosen by result."""
    drawable = [r for r in records if not r.series.empty and "true_b_g_x" in r.series and "b_g_x" in r.series]
    groups = []
    for regime in _regimes(drawable).values():
        *_, final = dict.fromkeys(r.config["condition"] for r in regime)  # also of a study that is not done
        last = [r for r in regime if r.config["condition"] == final]
        lowest = min(r.config["seed"] for r in last)
        group = [r for r in last if r.config["seed"] == lowest]
        shared = [r.config["source"] for r in group if r.config["arm"] == base] or [group[0].config["source"]]
        groups.append([_thinned(r) for r in group if r.config["source"] == shared[0]])
    return groups


def _thinned(record: Record) -> Record:
    """With as many rows as a figure can show, so that the page stays small; all arms keep the same ones."""
    return replace(record, series=record.series.iloc[:: max(1, round(len(record.series) / _SHOWN_ROWS))])


def _title(group: list[Record], records: Iterable[Record]) -> str:
    config, whose = group[0].config, _whose(group[0].config["estimator"], records)
    return f"{config['platform']}, {config['regime']}, {config['condition']}, {config['recording']}{whose}"


def _slug(*names: str) -> str:
    """A name for files and places in the page."""
    return re.sub(r"[^a-z0-9]+", "-", " ".join(names).lower()).strip("-")


def _facts(outcome: Outcome) -> list[tuple[str, str]]:
    """What was run, as pairs of name and text."""
    cell_s = sum(r.scores.get("wall_s", 0.0) for r in outcome.records)
    cells = f"{len(outcome.records)} done"
    cells += f", {len(outcome.failures)} failed" if outcome.failures else ""
    cells += f", {len(outcome.missing)} not run" if outcome.missing else ""
    versions = ", ".join(f"{name} {version}" for name, version in outcome.index.versions.items())
    time = f"{outcome.index.seconds / 60.0:.1f} min, {cell_s / 60.0:.1f} min of runs"
    return [("Cells", cells), ("Wall clock", time), ("Base arm", outcome.index.base), ("Made with", versions)]


def save_tables(tables: Mapping[str, Table], place: Path) -> None:
    """Write tables for LaTeX into a folder, by their names."""
    place.mkdir(exist_ok=True)
    for name, table in tables.items():
        if table.rows:
            (place / f"{name}.tex").write_text(table.latex(), encoding="utf-8")


def _save_figures(chapters: list[Chapter], arms: list[str], examples: list[list[Record]], place: Path) -> None:
    place.mkdir(exist_ok=True)
    for chapter in chapters:
        if chapter.good:
            pictures.save_ates(chapter.good, arms, place / f"ate-{chapter.place}")
        pictures.save_ratios(chapter.good, chapter.pairs, arms, place / f"ratios-{chapter.place}")
    if examples:
        pictures.save_biases(examples[0], arms, place / "biases")
        pictures.save_paths(examples[0], arms, place / "paths")


def _environment() -> jinja2.Environment:
    loader = jinja2.FileSystemLoader(_TEMPLATE.parent)
    return jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)

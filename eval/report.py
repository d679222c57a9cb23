"""The report of a study: one page that needs no network, and pictures of its main figures beside it."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import jinja2
from plotly.offline import get_plotlyjs

from eval import figures, images, pngs
from eval.outcome import Outcome
from eval.paired import Paired, paired
from eval.records import Record
from eval.tables import consistency_table, failure_table, group_table, paired_table

_TEMPLATE = Path(__file__).with_name("report.html")


def write_report(outcome: Outcome, folder: Path) -> Path:
    """Write `report.html`, whole or not at all, and the PNGs into `folder`; returns the path of the page."""
    records = [r for r in outcome.records if r.failure is None]
    pairs = paired(outcome.records, outcome.index.base)
    arms = figures.arms_of(outcome.records)
    examples = _examples(records)
    failures = failure_table(outcome)
    page = _environment().get_template(_TEMPLATE.name)
    text = page.render(
        name=outcome.index.name,
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        facts=_facts(outcome),
        headlines=headlines(pairs),
        tables=[group_table(outcome.records), paired_table(pairs), consistency_table(records)],
        failures=failures if failures.rows else None,
        scenes=list(dict.fromkeys(str(r.config["scene"]) for r in records)),
        examples=[_title(group) for group in examples],
        samples=images.samples(records, folder),
        plotly=get_plotlyjs(),
        figures=json.dumps(_figures(records, pairs, arms, examples), allow_nan=False).replace("</", "<\\/"),
    )
    path = folder / "report.html"
    partial = path.with_name(".report.html.partial")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)
    _save_pngs(records, pairs, arms, examples, folder)
    return path


def headlines(pairs: list[Paired]) -> list[str]:
    """What the study found, a sentence for each scene and condition with more than one seed."""
    groups: dict[tuple[str, str, str], list[str]] = {}
    for p in pairs:
        if p.median is None or len(p.seeds) < 2:
            continue
        if p.low is None or p.high is None:
            certain = f"{len(p.seeds)} seeds, too few for an interval"
        else:
            certain = f"{_change(p.low)} … {_change(p.high)}, {len(p.seeds)} seeds"
        apart = f"; {p.diverged} diverged against {p.base_diverged}" if p.diverged or p.base_diverged else ""
        found = f"{p.arm} {_change(p.median)} ({certain}{apart})"
        groups.setdefault((p.scene, p.condition, p.base), []).append(found)
    return [
        f"{scene}, {condition}, ATE against {base}: {'; '.join(found)}."
        for (scene, condition, base), found in groups.items()
    ]


def _change(ratio: float) -> str:
    """A ratio as a change in percent."""
    percent = round(100.0 * (ratio - 1.0))
    return f"{percent:+d} %".replace("-", "−") if percent else "±0 %"


def _figures(
    records: list[Record], pairs: list[Paired], arms: list[str], examples: list[list[Record]]
) -> dict[str, Any]:
    """All figures by the id of their place in the page."""
    scenes = dict.fromkeys(str(r.config["scene"]) for r in records)
    made = {f"ate-{k}": figures.ate_by_condition(records, scene, arms) for k, scene in enumerate(scenes)}
    if any(len(p.seeds) > 1 for p in pairs):
        made["ratios"] = figures.ratios(pairs, arms)
    for k, group in enumerate(examples):
        made[f"paths-{k}"] = figures.paths(group, arms)
        made[f"biases-{k}"] = figures.biases(group, arms)
        made[f"health-{k}"] = figures.health(group)
    return made


def _examples(records: list[Record]) -> list[list[Record]]:
    """For every scene and condition the arms on the recording with the lowest seed: not chosen by result."""
    lowest: dict[tuple[str, str], int] = {}
    with_truth = [r for r in records if not r.series.empty and "true_b_g_x" in r.series]
    for r in with_truth:
        group = (r.config["scene"], r.config["condition"])
        lowest[group] = min(r.config["seed"], lowest.get(group, r.config["seed"]))
    groups: dict[tuple[str, str], list[Record]] = {group: [] for group in lowest}
    for r in with_truth:
        group = (r.config["scene"], r.config["condition"])
        same_noise = r.config["source"].get("noise_seed") is None
        if r.config["seed"] == lowest[group] and same_noise and "b_g_x" in r.series:
            groups[group].append(r)
    return [g for g in groups.values() if g]


def _title(group: list[Record]) -> str:
    config = group[0].config
    return f"{config['scene']}, {config['condition']}, seed {config['seed']}"


def _facts(outcome: Outcome) -> list[tuple[str, str]]:
    """What was run, as pairs of name and text."""
    cell_s = sum(r.scores.get("wall_s", 0.0) for r in outcome.records)
    cells = f"{len(outcome.records)} done"
    cells += f", {len(outcome.failures)} failed" if outcome.failures else ""
    cells += f", {len(outcome.missing)} not run" if outcome.missing else ""
    versions = ", ".join(f"{name} {version}" for name, version in outcome.index.versions.items())
    time = f"{outcome.index.seconds / 60.0:.1f} min, {cell_s / 60.0:.1f} min of runs"
    return [("Cells", cells), ("Wall clock", time), ("Base arm", outcome.index.base), ("Made with", versions)]


def _save_pngs(
    records: list[Record], pairs: list[Paired], arms: list[str], examples: list[list[Record]], folder: Path
) -> None:
    for scene in dict.fromkeys(str(r.config["scene"]) for r in records):
        pngs.save_ates(records, scene, arms, folder / f"ate-{scene}.png")
    pngs.save_ratios(pairs, arms, folder / "ratios.png")
    if examples:
        pngs.save_biases(examples[0], arms, folder / "biases.png")
        pngs.save_paths(examples[0], arms, folder / "paths.png")


def _environment() -> jinja2.Environment:
    loader = jinja2.FileSystemLoader(_TEMPLATE.parent)
    return jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)

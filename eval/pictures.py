"""The main figures as pictures for papers, beside the page."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from eval.figures import (
    GROUND_TRUTH,
    TRUTH_COLOUR,
    aligned_positions,
    bias_range,
    colour,
    drawn_first,
    places,
    spacing,
    statements,
    wide,
)
from eval.paired import Paired, frame, median_interval
from eval.records import Record

_DPI = 160


def save_ates(records: list[Record], arms: list[str], path: Path) -> None:
    """ATE of a regime by condition and arm: every run (hollow: diverged), the median and its interval."""
    at, axis = places(records)
    step = spacing(at.values())
    table = frame(records)
    table = table[table.ate_m.notna()]
    present = [arm for arm in arms if (table.arm == arm).any()]
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    for k, arm in enumerate(present):
        offset, own = (k - 0.5 * (len(present) - 1)) * 0.7 * step / len(present), colour(arm, arms)
        medians = []
        for condition, x in at.items():
            runs = table[(table.arm == arm) & (table.condition == condition)]
            ate = runs.ate_m.to_numpy(dtype=np.float64)
            if len(ate) == 0:
                continue
            for diverged, face in ((False, own), (True, "none")):
                single = ate[(runs.diverged == 1.0).to_numpy() == diverged]
                axes.plot(np.full(len(single), x + offset), single, "o", ms=4, mfc=face, alpha=0.5, color=own)
            medians.append((x + offset, float(np.median(ate)), median_interval(ate)))
        _save_medians(axes, medians, arm, own, "-" if axis else "none")
    _ticks(axes, at, axis)
    axes.set(yscale="log", ylabel="ATE [m]")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize="small")
    _save(figure, path)


def save_ratios(records: list[Record], pairs: list[Paired], arms: list[str], path: Path) -> None:
    """ATE over that of the base in a regime, seed by seed, the median and its interval."""
    at, axis = places(records)
    step = spacing(at.values())
    shown = [p for p in pairs if len(p.seeds) > 1]
    present = [arm for arm in arms if any(p.arm == arm for p in shown)]
    if not present:
        return
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    for k, arm in enumerate(present):
        offset, medians = (k - 0.5 * (len(present) - 1)) * 0.7 * step / len(present), []
        for p in (p for p in shown if p.arm == arm):
            x, ratio = at[p.condition] + offset, np.exp(p.log_ratios)
            axes.plot(np.full(len(ratio), x), ratio, "o", ms=4, color=colour(arm, arms), alpha=0.5)
            medians.append((x, float(np.median(ratio)), median_interval(ratio)))
        _save_medians(axes, medians, arm, colour(arm, arms), "none")
    axes.axhline(1.0, color=TRUTH_COLOUR, linestyle=":")
    _ticks(axes, at, axis)
    axes.set(yscale="log", ylabel="ATE / ATE of the base")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize="small")
    _save(figure, path)


def _save_medians(
    axes: Axes, medians: list[tuple[float, float, tuple[float, float] | None]], arm: str, colour_of: str, line: str
) -> None:
    known = [(x, m, i) for x, m, i in medians if np.isfinite(m)]
    spans = [i if i is not None and np.isfinite(i[1]) else (m, m) for _, m, i in known]
    errors = [[m - low for (_, m, _), (low, _) in zip(known, spans, strict=True)]]
    errors += [[high - m for (_, m, _), (_, high) in zip(known, spans, strict=True)]]
    axes.errorbar(
        [x for x, _, _ in known], [m for _, m, _ in known], errors, fmt="o", ls=line, color=colour_of, capsize=3,
        label=arm,
    )  # fmt: skip


def _ticks(axes: Axes, at: dict[str, float], axis: str) -> None:
    axes.set_xticks(list(at.values()), [f"{x:g}" for x in at.values()] if axis else list(at))
    axes.set_xlabel(axis)


def save_biases(records: list[Record], arms: list[str], path: Path) -> None:
    """Bias estimates with their sigma bands, what the sources said, and the truth; the arms drawn first."""
    shown = drawn_first(records)
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    grid = figure.subplots(3, 2, sharex=True)
    for column, (name, unit) in enumerate((("b_g", "rad/s"), ("b_a", "m/s²"))):
        for row, axis in enumerate("xyz"):
            axes = grid[row, column]
            for record in shown:
                arm = str(record.config["arm"])
                own = colour(arm, arms)
                t, value = record.series["t_s"].to_numpy(), record.column(name)[:, row]
                reach = record.column(f"sigma_d{name}")[:, row]
                axes.fill_between(t, value - reach, value + reach, color=own, alpha=0.15, lw=0)
                axes.plot(t, value, color=own, lw=1.2 * wide(arm), label=arm)
                said = statements(record, name, row)
                if said is not None:
                    axes.errorbar(*said, fmt="o", ms=3, lw=0.7, capsize=1.5, color=own, alpha=0.7)
            true = records[0].column(f"true_{name}")[:, row]
            axes.plot(records[0].series["t_s"], true, "--", color=TRUTH_COLOUR, label=GROUND_TRUTH)
            axes.set(ylabel=f"{name} {axis} [{unit}]", ylim=bias_range(shown, name, row))
            axes.grid(alpha=0.3)
    grid[0, 0].legend(frameon=False, fontsize="small")
    for axes in grid[2]:
        axes.set_xlabel("t [s]")
    _save(figure, path)


def save_paths(records: list[Record], arms: list[str], path: Path) -> None:
    """The true and the estimated paths, aligned, from above."""
    figure = Figure(figsize=(6.4, 5.0), layout="constrained")
    axes = figure.subplots()
    truth = records[0].column("true_p_WB")
    axes.plot(truth[:, 0], truth[:, 1], color=TRUTH_COLOUR, lw=3.0, alpha=0.6, label=GROUND_TRUTH)
    for record in records:
        moved = aligned_positions(record)
        if moved is not None:
            arm = str(record.config["arm"])
            axes.plot(moved[:, 0], moved[:, 1], color=colour(arm, arms), lw=1.2, label=arm)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    """As PNG and as PDF, under a name without an ending; a PDF without a date is the same each time."""
    FigureCanvasAgg(figure)
    figure.savefig(f"{path}.png", dpi=_DPI)
    figure.savefig(f"{path}.pdf", metadata={"CreationDate": None})

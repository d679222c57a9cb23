"""The main figures as pictures for papers, beside the page."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from eval.figures import GROUND_TRUTH, TRUTH_COLOUR, aligned_positions, bias_range, colour
from eval.paired import Paired, frame, median_interval
from eval.records import Record

_DPI = 160


def save_ates(records: list[Record], scene: str, arms: list[str], path: Path) -> None:
    """ATE by condition and arm: every run, the median and its interval."""
    table = frame(records)
    table = table[(table.scene == scene) & table.ate_m.notna()]
    conditions = list(table.condition.unique())
    present = [arm for arm in arms if (table.arm == arm).any()]
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    for k, arm in enumerate(present):
        for i, condition in enumerate(conditions):
            ate = table[(table.arm == arm) & (table.condition == condition)].ate_m.to_numpy(dtype=np.float64)
            if len(ate) == 0:
                continue
            x = i + (k - 0.5 * (len(present) - 1)) * 0.8 / len(present)
            axes.plot(np.full(len(ate), x), ate, ".", color=colour(arm, arms), alpha=0.4)
            median = float(np.median(ate))
            low, high = median_interval(ate) or (median, median)
            axes.errorbar(
                x, median, [[median - low], [high - median]], fmt="o", color=colour(arm, arms), capsize=3,
                label=arm if i == 0 else None,
            )  # fmt: skip
    axes.set_xticks(range(len(conditions)), conditions)
    axes.set(yscale="log", ylabel="ATE [m]", title=scene)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    _save(figure, path)


def save_ratios(pairs: list[Paired], arms: list[str], path: Path) -> None:
    """ATE over that of the base, seed by seed, the median and its interval."""
    shown = [p for p in pairs if len(p.seeds) > 1]
    figure = Figure(figsize=(6.4, 0.8 + 0.45 * max(len(shown), 1)), layout="constrained")
    axes = figure.subplots()
    for row, p in enumerate(shown):
        axes.plot(np.exp(p.log_ratios), np.full(len(p.seeds), row), ".", color=colour(p.arm, arms), alpha=0.4)
        if p.median is not None:
            low, high = p.low or p.median, p.high or p.median
            error = [[p.median - low], [high - p.median]]
            axes.errorbar(p.median, row, xerr=error, fmt="o", color=colour(p.arm, arms), capsize=3)
    axes.axvline(1.0, color=TRUTH_COLOUR, linestyle=":")
    axes.set_yticks(range(len(shown)), [f"{p.scene}, {p.condition}: {p.arm}" for p in shown])
    axes.set(xscale="log", xlabel="ATE / ATE of the base (left of 1: better)")
    axes.invert_yaxis()
    axes.grid(alpha=0.3)
    _save(figure, path)


def save_biases(records: list[Record], arms: list[str], path: Path) -> None:
    """Bias estimates with their 3 sigma bands against the truth."""
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    grid = figure.subplots(3, 2, sharex=True)
    for column, (name, unit) in enumerate((("b_g", "rad/s"), ("b_a", "m/s²"))):
        for row, axis in enumerate("xyz"):
            axes = grid[row, column]
            for record in records:
                arm = str(record.config["arm"])
                t, value = record.series["t_s"].to_numpy(), record.column(name)[:, row]
                reach = 3.0 * record.column(f"sigma_d{name}")[:, row]
                axes.fill_between(t, value - reach, value + reach, color=colour(arm, arms), alpha=0.15, lw=0)
                axes.plot(t, value, color=colour(arm, arms), lw=1.2, label=arm)
            true = records[0].column(f"true_{name}")[:, row]
            axes.plot(records[0].series["t_s"], true, "--", color=TRUTH_COLOUR, label=GROUND_TRUTH)
            axes.set(ylabel=f"{name} {axis} [{unit}]", ylim=bias_range(records, name, row))
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
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=_DPI)

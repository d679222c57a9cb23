"""The errors of all runs of a regime: by condition, and against the base."""

from collections.abc import Iterable

import numpy as np

from eval.figures.look import TRUTH_COLOUR, Figure, listed, mark, points
from eval.paired import Paired, frame, median_interval
from eval.records import Record
from navcore.arrays import Floats

_ATE_TICKS = [m * 10.0**e for e in range(-4, 5) for m in (1, 2, 5)]
_RATIO_TICKS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0]


def places(records: Iterable[Record]) -> tuple[dict[str, float], str]:
    """Where the conditions of a regime stand on its axis, and the axis's name: in a row if it has none."""
    levels = {str(r.config["condition"]): r.config["level"] for r in records}
    axis = next((str(r.config["axis"]) for r in records), "")
    if not axis or None in levels.values():
        return {condition: float(k) for k, condition in enumerate(levels)}, ""
    return {condition: float(levels[condition]) for condition in sorted(levels, key=levels.__getitem__)}, axis


def spacing(at: Iterable[float]) -> float:
    """Room for the arms of a condition: the least distance between two, less where there are only a few."""
    ordered = sorted(set(at))
    steps = np.diff(ordered)
    return min(float(steps.min()), 0.25 * (ordered[-1] - ordered[0])) if len(steps) else 1.0


def ate_by_condition(records: list[Record], arms: list[str]) -> Figure:
    """ATE of every run of a regime by condition and arm, with the median and its 95 % interval.

    Medians are joined where conditions are levels of an axis. Runs that diverged are hollow.
    """
    at, axis = places(records)
    step = spacing(at.values())
    table = frame(records)
    table = table[table.ate_m.notna()]
    present = [arm for arm in arms if (table.arm == arm).any()]
    traces: list[Figure] = []
    for k, arm in enumerate(present):
        offset = (k - 0.5 * (len(present) - 1)) * 0.7 * step / len(present)
        look = mark(arm, arms)
        groups = [(at[c] + offset, table[(table.arm == arm) & (table.condition == c)]) for c in at]
        known = [(x, g.sort_values("seed")) for x, g in groups if len(g)]
        if any(len(g) > 1 for _, g in known):
            spread = [x + 0.06 * step * np.linspace(-1.0, 1.0, len(g)) for x, g in known]
            y = np.concatenate([g.ate_m.to_numpy(dtype=np.float64) for _, g in known])
            hollow = f"{look['symbol']}-open"
            symbols = [hollow if d == 1.0 else look["symbol"] for _, g in known for d in g.diverged]
            marks = look | {"size": 5, "opacity": 0.5, "symbol": symbols}
            texts = [str(name) for _, g in known for name in g.recording]
            single = points(arm, np.concatenate(spread), y, marks, False)
            traces.append(single | {"text": texts, "hovertemplate": "%{text}: %{y:.4f} m"})
        medians = [(x, g.ate_m.to_numpy(dtype=np.float64)) for x, g in known]
        traces.append(_medians(arm, medians, look, joined=bool(axis)))
    y_axis = _log_axis("ATE [m]", _ATE_TICKS)
    return {"data": traces, "layout": {"xaxis": _conditions(at, axis, step), "yaxis": y_axis}}


def ratios(records: list[Record], pairs: list[Paired], arms: list[str]) -> Figure | None:
    """ATE over that of the base, seed by seed, with the median and its 95 % interval; None without pairs."""
    at, axis = places(records)
    step = spacing(at.values())
    names = {int(r.config["seed"]): str(r.config["recording"]) for r in records}
    shown = [p for p in pairs if len(p.seeds) > 1]
    present = [arm for arm in arms if any(p.arm == arm for p in shown)]
    if not present:
        return None
    traces: list[Figure] = []
    for k, arm in enumerate(present):
        offset = (k - 0.5 * (len(present) - 1)) * 0.7 * step / len(present)
        look = mark(arm, arms)
        mine = [p for p in shown if p.arm == arm]
        x = np.concatenate([np.full(len(p.seeds), at[p.condition] + offset) for p in mine])
        texts = [names[s] for p in mine for s in p.seeds]
        marks = look | {"size": 5, "opacity": 0.5}
        single = points(arm, x, np.concatenate([np.exp(p.log_ratios) for p in mine]), marks, False)
        traces.append(single | {"text": texts, "hovertemplate": "%{text}: × %{y:.3f}"})
        medians = [(at[p.condition] + offset, np.exp(p.log_ratios)) for p in mine]
        traces.append(_medians(arm, medians, look, joined=False))
    one = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 1, "y1": 1}
    one["line"] = {"dash": "dot", "color": TRUTH_COLOUR}
    y_axis = _log_axis("ATE / ATE of the base", _RATIO_TICKS)
    x_axis = _conditions(at, axis, step)
    return {"data": traces, "layout": {"xaxis": x_axis, "yaxis": y_axis, "shapes": [one]}}


def _medians(arm: str, at: list[tuple[float, Floats]], look: Figure, joined: bool) -> Figure:
    median = np.array([np.median(v) for _, v in at])
    bounds = [median_interval(v) or (m, m) for (_, v), m in zip(at, median, strict=True)]
    with np.errstate(invalid="ignore"):  # the median of runs without a pose is infinite
        up = np.array([high for _, high in bounds]) - median
        down = median - np.array([low for low, _ in bounds])
    bars = {"type": "data", "symmetric": False, "array": listed(up), "arrayminus": listed(down)}
    trace = points(arm, np.array([c for c, _ in at]), median, look | {"size": 10}, True)
    if joined:
        trace |= {"mode": "lines+markers", "line": {"color": look["color"], "width": 1.5}}
    return trace | {"error_y": bars | {"color": look["color"], "thickness": 2.0}}


def _conditions(at: dict[str, float], axis: str, step: float) -> Figure:
    """The axis of a regime, with a tick at each condition."""
    ticks: Figure = {"tickvals": list(at.values()), "zeroline": False}
    ticks["ticktext"] = [f"{x:g}" for x in at.values()] if axis else list(at)
    ticks["range"] = [min(at.values()) - 0.6 * step, max(at.values()) + 0.6 * step]
    return ticks | ({"title": {"text": axis}} if axis else {})


def _log_axis(title: str, ticks: list[float]) -> Figure:
    return {
        "type": "log",
        "title": {"text": title},
        "tickvals": ticks,
        "ticktext": [f"{v:g}" for v in ticks],
    }

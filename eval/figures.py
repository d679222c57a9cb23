"""The figures of a report, as plotly takes them: plain dictionaries of traces and layout."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from eval.alignment import Alignment, align
from eval.paired import Paired, frame, median_interval
from eval.records import Record
from navcore.arrays import Floats
from navcore.odometry import Health

Figure = dict[str, Any]

ARM_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#8A6FDF", "#8C6D31")
"""Okabe and Ito's, told apart by all kinds of colour vision, and two more; in the order in which arms come."""
ARM_SYMBOLS = ("circle", "square", "diamond", "triangle-up", "x", "cross", "star", "triangle-down")
TRUTH_COLOUR = "#808080"
GROUND_TRUTH = "ground truth"
HEALTH_COLOURS = {
    Health.INITIALISING: "#999999",
    Health.TRACKING: "#56B4E9",
    Health.INERTIAL_ONLY: "#E69F00",
    Health.LOST: "#D55E00",
}
_AXES = ("x", "y", "z")
_ATE_TICKS = [m * 10.0**e for e in range(-4, 5) for m in (1, 2, 5)]
_RATIO_TICKS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0]
_SETTLED = 0.3  # share of a run after which the biases have settled, for the range that a figure shows
_MOST = (0.1, 0.9)  # quantiles of a source's statements that the range includes
_FIRST_ARMS = ("none", "ipnet", "motion")


def arms_of(records: Iterable[Record]) -> list[str]:
    """Names of the arms in the order in which they come."""
    return list(dict.fromkeys(str(r.config["arm"]) for r in records))


def colour(arm: str, arms: list[str]) -> str:
    """The same arm has the same colour in every figure."""
    return ARM_COLOURS[arms.index(arm) % len(ARM_COLOURS)]


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
        symbol = ARM_SYMBOLS[arms.index(arm) % len(ARM_SYMBOLS)]
        look = {"color": colour(arm, arms), "symbol": symbol}
        groups = [(at[c] + offset, table[(table.arm == arm) & (table.condition == c)]) for c in at]
        known = [(x, g.sort_values("seed")) for x, g in groups if len(g)]
        if any(len(g) > 1 for _, g in known):
            spread = [x + 0.06 * step * np.linspace(-1.0, 1.0, len(g)) for x, g in known]
            y = np.concatenate([g.ate_m.to_numpy(dtype=np.float64) for _, g in known])
            symbols = [f"{symbol}-open" if d == 1.0 else symbol for _, g in known for d in g.diverged]
            marks = look | {"size": 5, "opacity": 0.5, "symbol": symbols}
            texts = [str(name) for _, g in known for name in g.recording]
            single = _points(arm, np.concatenate(spread), y, marks, False)
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
        look = {"color": colour(arm, arms), "symbol": ARM_SYMBOLS[arms.index(arm) % len(ARM_SYMBOLS)]}
        mine = [p for p in shown if p.arm == arm]
        x = np.concatenate([np.full(len(p.seeds), at[p.condition] + offset) for p in mine])
        texts = [names[s] for p in mine for s in p.seeds]
        marks = look | {"size": 5, "opacity": 0.5}
        single = _points(arm, x, np.concatenate([np.exp(p.log_ratios) for p in mine]), marks, False)
        traces.append(single | {"text": texts, "hovertemplate": "%{text}: × %{y:.3f}"})
        medians = [(at[p.condition] + offset, np.exp(p.log_ratios)) for p in mine]
        traces.append(_medians(arm, medians, look, joined=False))
    one = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 1, "y1": 1}
    one["line"] = {"dash": "dot", "color": TRUTH_COLOUR}
    y_axis = _log_axis("ATE / ATE of the base", _RATIO_TICKS)
    x_axis = _conditions(at, axis, step)
    return {"data": traces, "layout": {"xaxis": x_axis, "yaxis": y_axis, "shapes": [one]}}


def paths(records: list[Record], arms: list[str]) -> Figure:
    """The true and the estimated paths in three dimensions, aligned."""
    truth = records[0].column("true_p_WB")
    traces: list[Figure] = [_path(GROUND_TRUTH, truth, TRUTH_COLOUR, 6)]
    for record in records:
        moved = aligned_positions(record)
        if moved is not None:
            traces.append(_path(str(record.config["arm"]), moved, colour(str(record.config["arm"]), arms), 3))
    scene: Figure = {"aspectmode": "data"}
    for k, axis in enumerate(_AXES):  # a run that diverged leaves the picture
        low, high = np.nanmin(truth[:, k]), np.nanmax(truth[:, k])
        pad = 0.5 + 0.1 * (high - low)
        scene[f"{axis}axis"] = {
            "title": {"text": f"{axis} [m]"},
            "range": _listed(np.array([low - pad, high + pad])),
        }
    return {"data": traces, "layout": {"scene": scene, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}}}


def biases(records: list[Record], arms: list[str]) -> Figure:
    """Bias estimates with their sigma bands, what the sources said, and the truth: gyroscope left, accelerometer right.

    Of many arms only the base and what motion reveals are drawn at first; the legend brings the others.
    """
    traces: list[Figure] = []
    layout: Figure = {
        "grid": {"rows": 3, "columns": 2, "pattern": "independent", "ygap": 0.35},
        "annotations": [],
    }
    first = drawn_first(records)
    shown = arms_of(first)
    for column, (name, unit) in enumerate((("b_g", "rad/s"), ("b_a", "m/s²"))):
        for row, axis in enumerate(_AXES):
            n = 2 * row + column + 1
            place = {"xaxis": f"x{n}", "yaxis": f"y{n}"}
            for record in records:
                hidden = {} if str(record.config["arm"]) in shown else {"visible": "legendonly"}
                own = _band(record, name, row, arms, shown=n == 1) + _statements(record, name, row, arms)
                traces += [trace | place | hidden for trace in own]
            t_s = _listed(records[0].series["t_s"].to_numpy())
            true = _listed(records[0].column(f"true_{name}")[:, row])
            line = {"color": TRUTH_COLOUR, "width": 2, "dash": "dash"}
            traces.append(_line(GROUND_TRUTH, t_s, true, line, n == 1) | place)
            low_high = bias_range(first, name, row)
            layout[f"yaxis{n}"] = {"range": low_high, "nticks": 5}
            corner = {"xref": f"x{n} domain", "yref": f"y{n} domain", "x": 0, "y": 1, "yanchor": "bottom"}
            layout["annotations"].append({"text": f"{name} {axis} [{unit}]", "showarrow": False} | corner)
            layout[f"xaxis{n}"] = {"title": {"text": "t [s]"} if row == 2 else {}, "range": _listed_range(records)}
    return {"data": traces, "layout": layout}


def drawn_first(records: list[Record]) -> list[Record]:
    """Those of a recording that a figure of biases begins with: the base and the sources of measurements; all, where
    there are no such sources."""
    chosen = [r for r in records if str(r.config["arm"]) in _FIRST_ARMS]
    return chosen if len(chosen) > 1 else records


def health(records: list[Record]) -> Figure:
    """What each arm said of itself over time."""
    names = [h.value for h in Health]
    codes = [[names.index(h) for h in r.series["health"]] for r in records]
    steps: list[list[Any]] = []
    for k, state in enumerate(Health):
        steps += [[k / len(names), HEALTH_COLOURS[state]], [(k + 1) / len(names), HEALTH_COLOURS[state]]]
    bar = {"tickvals": [0.375 + 0.75 * k for k in range(len(names))], "ticktext": names, "thickness": 12}
    trace = {
        "type": "heatmap",
        "z": codes,
        "x": _listed(records[0].series["t_s"].to_numpy()),
        "y": [str(r.config["arm"]) for r in records],
        "zmin": 0,
        "zmax": len(names) - 1,
        "ygap": 4,
        "colorscale": steps,
        "colorbar": bar,
        "hovertemplate": "%{y}, %{x:.1f} s<extra></extra>",
    }
    return {
        "data": [trace],
        "layout": {"xaxis": {"title": {"text": "t [s]"}}, "yaxis": {"autorange": "reversed"}},
    }


def aligned_positions(record: Record) -> Floats | None:
    """(M, 3) estimated positions in the world of the truth, NaN where there are none; None without any."""
    p_VB, p_WB = record.column("p_WB"), record.column("true_p_WB")
    good = np.isfinite(np.hstack([p_VB, p_WB])).all(axis=1)
    if not good.any():
        return None
    alignment: Alignment = align(p_VB[good], p_WB[good])
    return p_VB @ alignment.R_WV.T + alignment.p_WV


def bias_range(records: list[Record], name: str, axis: int) -> list[float]:
    """What a figure of a bias shows: the truth, all bands once they have settled, and most of what sources said."""
    lows, highs = [], []
    for record in records:
        late = record.series["t_s"].to_numpy() > _SETTLED * record.series["t_s"].max()
        true = record.column(f"true_{name}")[:, axis]
        estimate = record.column(name)[late, axis]
        reach = record.column(f"sigma_d{name}")[late, axis]
        both = np.concatenate([true, estimate - reach, estimate + reach])
        said = statements(record, name, axis)
        if said is not None:
            both = np.concatenate([both, np.quantile(said[1], _MOST)])
        lows.append(np.nanmin(both))
        highs.append(np.nanmax(both))
    pad = 0.1 * (max(highs) - min(lows))
    return [float(min(lows) - pad), float(max(highs) + pad)]


def statements(record: Record, name: str, axis: int) -> tuple[Floats, Floats, Floats] | None:
    """Times [s], values and sigmas of what a run's source said of a bias; None if nothing worth a mark."""
    table = record.statements
    if table.empty or record.config["prior"].partition(":")[0] == "truth":
        return None
    columns = ("t_s", f"{name}_{_AXES[axis]}", f"sigma_d{name}_{_AXES[axis]}")
    t_s, value, sigma = (table[column].to_numpy(dtype=np.float64) for column in columns)
    return t_s, value, sigma


def _band(record: Record, name: str, axis: int, arms: list[str], shown: bool) -> list[Figure]:
    arm = str(record.config["arm"])
    value, sigma = record.column(name)[:, axis], record.column(f"sigma_d{name}")[:, axis]
    known = np.isfinite(value) & np.isfinite(sigma)
    t = record.series["t_s"].to_numpy()[known]
    value, sigma = value[known], sigma[known]
    outline_t, outline = np.concatenate([t, t[::-1]]), np.concatenate([value + sigma, (value - sigma)[::-1]])
    fill = {"fill": "toself", "fillcolor": _faint(colour(arm, arms)), "hoverinfo": "skip"}
    return [
        _line(arm, _listed(outline_t), _listed(outline), {"width": 0}, False) | fill,
        _line(arm, _listed(t), _listed(value), {"color": colour(arm, arms), "width": 1.5}, shown),
    ]


def _statements(record: Record, name: str, axis: int, arms: list[str]) -> list[Figure]:
    """A mark with a bar of sigma for each statement, at its stamp."""
    said = statements(record, name, axis)
    if said is None:
        return []
    arm, (t_s, value, sigma) = str(record.config["arm"]), said
    bar = {"type": "data", "array": _listed(sigma), "color": colour(arm, arms), "thickness": 1.0, "width": 2}
    trace = _points(arm, t_s, value, {"color": colour(arm, arms), "size": 5}, False)
    return [trace | {"error_y": bar, "opacity": 0.7, "hovertemplate": f"{arm} said %{{y:.5g}}<extra></extra>"}]


def _listed_range(records: list[Record]) -> list[float]:
    """From the first to the last moment of a recording."""
    t_s = records[0].series["t_s"]
    return [float(t_s.min()), float(t_s.max())]


def _medians(arm: str, at: list[tuple[float, Floats]], look: Figure, joined: bool) -> Figure:
    median = np.array([np.median(v) for _, v in at])
    bounds = [median_interval(v) or (m, m) for (_, v), m in zip(at, median, strict=True)]
    with np.errstate(invalid="ignore"):  # the median of runs without a pose is infinite
        up = np.array([high for _, high in bounds]) - median
        down = median - np.array([low for low, _ in bounds])
    bars = {"type": "data", "symmetric": False, "array": _listed(up), "arrayminus": _listed(down)}
    trace = _points(arm, np.array([c for c, _ in at]), median, look | {"size": 10}, True)
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


def _points(arm: str, x: Floats, y: Floats, marker: Figure, shown: bool) -> Figure:
    basics = {"type": "scatter", "mode": "markers", "name": arm, "legendgroup": arm, "showlegend": shown}
    return basics | {"x": _listed(x), "y": _listed(y), "marker": marker}


def _line(arm: str, x: list[Any], y: list[Any], line: Figure, shown: bool) -> Figure:
    basics = {"type": "scatter", "mode": "lines", "name": arm, "legendgroup": arm, "showlegend": shown}
    return basics | {"x": x, "y": y, "line": line}


def _path(name: str, p_WB: Floats, colour_of: str, width: int) -> Figure:
    columns = {axis: _listed(p_WB[:, k]) for k, axis in enumerate(_AXES)}
    return {
        "type": "scatter3d",
        "mode": "lines",
        "name": name,
        "line": {"color": colour_of, "width": width},
    } | columns


def _listed(values: Floats) -> list[float | None]:
    """For JSON: five digits, and null for what is not known."""
    return [float(f"{v:.5g}") if np.isfinite(v) else None for v in values]


def _faint(hex_colour: str) -> str:
    r, g, b = (int(hex_colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({r},{g},{b},0.15)"

"""What runs of a recording held their biases to be, what their sources said, and the truth."""

import numpy as np

from eval.arms import BASE
from eval.figures.look import AXES, GROUND_TRUTH, TRUTH_COLOUR, Figure, arms_of, colour, faint, line, listed, points
from eval.records import Record
from navcore.arrays import Floats

_SETTLED = 0.3  # share of a run after which the biases have settled, for the range that a figure shows
_MOST = (0.1, 0.9)  # quantiles of a source's statements that the range includes
_FIRST_ARMS = (BASE, "ipnet", "motion")


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
        for row, axis in enumerate(AXES):
            n = 2 * row + column + 1
            place = {"xaxis": f"x{n}", "yaxis": f"y{n}"}
            for record in records:
                hidden = {} if str(record.config["arm"]) in shown else {"visible": "legendonly"}
                own = _band(record, name, row, arms, shown=n == 1) + _statements(record, name, row, arms)
                traces += [trace | place | hidden for trace in own]
            t_s = listed(records[0].series["t_s"].to_numpy())
            true = listed(records[0].column(f"true_{name}")[:, row])
            dashed = {"color": TRUTH_COLOUR, "width": 2, "dash": "dash"}
            traces.append(line(GROUND_TRUTH, t_s, true, dashed, n == 1) | place)
            low_high = bias_range(first, name, row)
            layout[f"yaxis{n}"] = {"range": low_high, "nticks": 5}
            corner = {"xref": f"x{n} domain", "yref": f"y{n} domain", "x": 0, "y": 1, "yanchor": "bottom"}
            layout["annotations"].append({"text": f"{name} {axis} [{unit}]", "showarrow": False} | corner)
            layout[f"xaxis{n}"] = {"title": {"text": "t [s]"} if row == 2 else {}, "range": _whole(records)}
    return {"data": traces, "layout": layout}


def drawn_first(records: list[Record]) -> list[Record]:
    """Those of a recording that a figure of biases begins with: the base and the sources of measurements; all, where
    there are no such sources."""
    chosen = [r for r in records if str(r.config["arm"]) in _FIRST_ARMS]
    return chosen if len(chosen) > 1 else records


def wide(arm: str) -> float:
    """How wide a line is beside the others: that of the base is seen below one that covers it."""
    return 2.5 if arm == BASE else 1.0


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
    columns = ("t_s", f"{name}_{AXES[axis]}", f"sigma_d{name}_{AXES[axis]}")
    t_s, value, sigma = (table[column].to_numpy(dtype=np.float64) for column in columns)
    return t_s, value, sigma


def _band(record: Record, name: str, axis: int, arms: list[str], shown: bool) -> list[Figure]:
    arm = str(record.config["arm"])
    value, sigma = record.column(name)[:, axis], record.column(f"sigma_d{name}")[:, axis]
    known = np.isfinite(value) & np.isfinite(sigma)
    t = record.series["t_s"].to_numpy()[known]
    value, sigma = value[known], sigma[known]
    outline_t, outline = np.concatenate([t, t[::-1]]), np.concatenate([value + sigma, (value - sigma)[::-1]])
    fill = {"fill": "toself", "fillcolor": faint(colour(arm, arms)), "hoverinfo": "skip"}
    return [
        line(arm, listed(outline_t), listed(outline), {"width": 0}, False) | fill,
        line(arm, listed(t), listed(value), {"color": colour(arm, arms), "width": 1.5 * wide(arm)}, shown),
    ]


def _statements(record: Record, name: str, axis: int, arms: list[str]) -> list[Figure]:
    """A mark with a bar of sigma for each statement, at its stamp."""
    said = statements(record, name, axis)
    if said is None:
        return []
    arm, (t_s, value, sigma) = str(record.config["arm"]), said
    bar = {"type": "data", "array": listed(sigma), "color": colour(arm, arms), "thickness": 1.0, "width": 2}
    trace = points(arm, t_s, value, {"color": colour(arm, arms), "size": 5}, False)
    return [trace | {"error_y": bar, "opacity": 0.7, "hovertemplate": f"{arm} said %{{y:.5g}}<extra></extra>"}]


def _whole(records: list[Record]) -> list[float]:
    """From the first to the last moment of a recording."""
    t_s = records[0].series["t_s"]
    return [float(t_s.min()), float(t_s.max())]

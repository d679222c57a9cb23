"""What the figures of a report share: the look of arms, and traces as plotly takes them."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from eval.records import Record
from navcore.arrays import Floats

Figure = dict[str, Any]
"""Traces and layout as plain dictionaries."""

ARM_COLOURS = (
    *("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#8A6FDF", "#8C6D31"),
    *("#66A61E", "#E7298A", "#1B9E9E", "#B3A400", "#A0522D"),
    *("#4477AA", "#AA3377", "#228833", "#EE6677", "#997700"),
)
"""Okabe and Ito's, told apart by all kinds of colour vision, and more; in the order in which arms come."""
ARM_SYMBOLS = (
    *("circle", "square", "diamond", "triangle-up", "x", "cross", "star", "triangle-down"),
    *("pentagon", "hexagon", "triangle-left", "triangle-right", "hourglass"),
    *("bowtie", "star-square", "diamond-tall", "hexagram", "diamond-wide"),
)
TRUTH_COLOUR = "#808080"
GROUND_TRUTH = "ground truth"
AXES = ("x", "y", "z")


def arms_of(records: Iterable[Record]) -> list[str]:
    """Names of the arms in the order in which they come."""
    return list(dict.fromkeys(str(r.config["arm"]) for r in records))


def colour(arm: str, arms: list[str]) -> str:
    """The same arm has the same colour in every figure."""
    return ARM_COLOURS[arms.index(arm) % len(ARM_COLOURS)]


def mark(arm: str, arms: list[str]) -> Figure:
    """And the same mark."""
    return {"color": colour(arm, arms), "symbol": ARM_SYMBOLS[arms.index(arm) % len(ARM_SYMBOLS)]}


def points(arm: str, x: Floats, y: Floats, marker: Figure, shown: bool) -> Figure:
    """Marks of an arm; `shown` in the legend, whose entry switches all traces of the arm."""
    basics = {"type": "scatter", "mode": "markers", "name": arm, "legendgroup": arm, "showlegend": shown}
    return basics | {"x": listed(x), "y": listed(y), "marker": marker}


def line(arm: str, x: list[Any], y: list[Any], look: Figure, shown: bool) -> Figure:
    """A line of an arm, likewise; `x`, `y` as `listed` makes them."""
    basics = {"type": "scatter", "mode": "lines", "name": arm, "legendgroup": arm, "showlegend": shown}
    return basics | {"x": x, "y": y, "line": look}


def listed(values: Floats) -> list[float | None]:
    """For JSON: five digits, and null for what is not known."""
    return [float(f"{v:.5g}") if np.isfinite(v) else None for v in values]


def faint(hex_colour: str) -> str:
    """A colour to fill areas with."""
    r, g, b = (int(hex_colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({r},{g},{b},0.15)"

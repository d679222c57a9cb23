"""The figures of a report, as plotly takes them: plain dictionaries of traces and layout."""

from eval.figures.biases import bias_range, biases, drawn_first, statements, wide
from eval.figures.conditions import ate_by_condition, places, ratios, spacing
from eval.figures.health import health
from eval.figures.look import GROUND_TRUTH, TRUTH_COLOUR, arms_of, colour
from eval.figures.paths import aligned_positions, paths

__all__ = [
    "GROUND_TRUTH",
    "TRUTH_COLOUR",
    "aligned_positions",
    "arms_of",
    "ate_by_condition",
    "bias_range",
    "biases",
    "colour",
    "drawn_first",
    "health",
    "paths",
    "places",
    "ratios",
    "spacing",
    "statements",
    "wide",
]

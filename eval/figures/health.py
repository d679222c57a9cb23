"""What the runs of a recording said of themselves."""

from typing import Any

from eval.figures.look import Figure, listed
from eval.records import Record
from navcore.odometry import Health

HEALTH_COLOURS = {
    Health.INITIALISING: "#999999",
    Health.TRACKING: "#56B4E9",
    Health.INERTIAL_ONLY: "#E69F00",
    Health.LOST: "#D55E00",
}


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
        "x": listed(records[0].series["t_s"].to_numpy()),
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

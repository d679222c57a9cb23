"""The true and the estimated paths of a recording."""

import numpy as np

from eval.alignment import Alignment, align
from eval.figures.look import AXES, GROUND_TRUTH, TRUTH_COLOUR, Figure, colour, listed
from eval.records import Record
from navcore.arrays import Floats


def paths(records: list[Record], arms: list[str]) -> Figure:
    """The true and the estimated paths in three dimensions, aligned."""
    truth = records[0].column("true_p_WB")
    traces: list[Figure] = [_path(GROUND_TRUTH, truth, TRUTH_COLOUR, 6)]
    for record in records:
        moved = aligned_positions(record)
        if moved is not None:
            traces.append(_path(str(record.config["arm"]), moved, colour(str(record.config["arm"]), arms), 3))
    scene: Figure = {"aspectmode": "data"}
    for k, axis in enumerate(AXES):  # a run that diverged leaves the picture
        low, high = np.nanmin(truth[:, k]), np.nanmax(truth[:, k])
        pad = 0.5 + 0.1 * (high - low)
        scene[f"{axis}axis"] = {
            "title": {"text": f"{axis} [m]"},
            "range": listed(np.array([low - pad, high + pad])),
        }
    return {"data": traces, "layout": {"scene": scene, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}}}


def aligned_positions(record: Record) -> Floats | None:
    """(M, 3) estimated positions in the world of the truth, NaN where there are none; None without any."""
    p_VB, p_WB = record.column("p_WB"), record.column("true_p_WB")
    good = np.isfinite(np.hstack([p_VB, p_WB])).all(axis=1)
    if not good.any():
        return None
    alignment: Alignment = align(p_VB[good], p_WB[good])
    return p_VB @ alignment.R_WV.T + alignment.p_WV


def _path(name: str, p_WB: Floats, colour_of: str, width: int) -> Figure:
    columns = {axis: listed(p_WB[:, k]) for k, axis in enumerate(AXES)}
    return {
        "type": "scatter3d",
        "mode": "lines",
        "name": name,
        "line": {"color": colour_of, "width": width},
    } | columns

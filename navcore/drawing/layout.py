"""How the viewer arranges a run: images, path and biases side by side, health and its reasons below.

Estimates are blue, truth is orange, spreads are grey.
"""

from navcore.drawing import paths
from navcore.drawing.sdk import rrb


def layout(cameras: int) -> rrb.Blueprint:
    """For a rig of which so many cameras are drawn."""
    so_far = rrb.VisibleTimeRanges(
        timeline=paths.TIMELINE,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    images = [rrb.Spatial2DView(origin=paths.camera(k), name=f"camera {k}") for k in range(cameras)]
    in_space = [f"+ {paths.WORLD}/**", *(f"- {paths.camera(k)}/{x}" for k in range(cameras) for x in ("now", "lately"))]
    space = rrb.Spatial3DView(
        origin=paths.WORLD, name="path, 3σ", contents=in_space, overrides={paths.PATH: [so_far], paths.TRUTH: [so_far]}
    )
    no_legend = rrb.PlotLegend(visible=False)  # in plots that small
    biases = [
        rrb.TimeSeriesView(origin=paths.bias(name, axis), name=f"{title}, {axis}", plot_legend=no_legend)
        for name, title in paths.BIASES.items()
        for axis in paths.AXES
    ]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Vertical(*images, rrb.TimeSeriesView(origin=paths.FEATURES, name="features")),
                space,
                rrb.Vertical(*biases),
                column_shares=[3, 4, 3],
            ),
            rrb.Horizontal(
                rrb.StateTimelineView(origin=paths.HEALTH, name="health"),
                rrb.TextLogView(origin=paths.REASONS, name="reasons"),
            ),
            row_shares=[5, 1],
        ),
        rrb.TimePanel(timeline=paths.TIMELINE, state="collapsed"),
        collapse_panels=True,
    )

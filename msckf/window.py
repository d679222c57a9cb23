"""The sliding window: clones come and go, and features that end become measurements (docs/filter.md, section 4)."""

from dataclasses import dataclass

import numpy as np

from msckf.config import VisionConfig
from msckf.features import FeatureTable
from msckf.frontend import Observations
from msckf.standstill import image_motion
from msckf.state import CLONE_SIZE, FilterState
from msckf.views import Rig, Views
from msckf.visual import measure
from navcore.arrays import Floats, Mask


@dataclass(frozen=True)
class VisualOutcome:
    """What vision did at one frame.

    Attributes:
        used, rejected: features.
        nis, dof: (N,) of the features that were tested.
    """

    used: int = 0
    rejected: int = 0
    nis: Floats | None = None
    dof: Floats | None = None


class VisualWindow:
    """Features over the clones of a filter state."""

    def __init__(self, rig: Rig, config: VisionConfig) -> None:
        self.rig = rig
        self.config = config
        self.table = FeatureTable()

    def disparity(self, observations: Observations) -> float | None:
        """Motion of the image [px] since the newest clone, or None if too few features are common."""
        if len(self.table) == 0 or self.table.seen.shape[1] == 0:
            return None
        seen = self.table.seen[:, -1]
        _, rows, columns = np.intersect1d(
            self.table.keys[seen], observations.keys, assume_unique=True, return_indices=True
        )
        return image_motion(self.table.uv[seen, -1][rows], observations.uv[columns])

    def hold(self, observations: Observations) -> None:
        """The body has not moved since the newest clone: only note which features are still followed."""
        self.table.alive = np.isin(self.table.keys, observations.keys)

    def advance(self, state: FilterState, t_ns: int, observations: Observations) -> VisualOutcome:
        """Clone the current pose, use the features that end, drop the oldest clone when the window is full."""
        state.add_clone(t_ns)
        self.table.add_column(observations.keys, observations.cameras, observations.uv)
        full = len(state.clones) >= self.config.clones
        views = self.table.views
        ended = ~self.table.alive
        candidates = ended | (self.table.seen[:, 0] if full else False)
        candidates = candidates & (views >= self.config.min_views)
        chosen = self._longest(candidates)
        outcome = self._use(state, chosen)
        self.table.drop_rows(~self.table.alive)
        if full:
            state.drop_clone(0)
            self.table.drop_column(0)
        return outcome

    def _longest(self, candidates: Mask) -> Mask:
        """The features with the most views among the candidates, as many as may be used."""
        if candidates.sum() <= self.config.max_features:
            return candidates
        order = np.argsort(np.where(candidates, -self.table.views, 1), kind="stable")
        chosen = np.zeros(len(candidates), dtype=bool)
        chosen[order[: self.config.max_features]] = True
        return chosen

    def _use(self, state: FilterState, chosen: Mask) -> VisualOutcome:
        if not chosen.any():
            return VisualOutcome()
        table, clones = self.table, state.clones
        views = Views(self.rig, table.cameras[chosen], table.uv[chosen], table.seen[chosen])
        R_lin, p_lin = state.linearisation_clones
        first = state.clone_start
        columns = np.arange(first, first + CLONE_SIZE * len(clones))
        P = state.covariance[first:, first:]
        m = measure(views, clones.R_WB, clones.p_WB, R_lin, p_lin, P, self.config)
        if m is None:
            return VisualOutcome()
        if m.used.any():
            state.update(m.H, columns, m.r, self.config.pixel_noise**2 * np.eye(len(m.r)))
        spent = np.zeros(len(table), dtype=bool)
        spent[np.flatnonzero(chosen)[m.used | m.rejected]] = True
        table.consume(spent)
        tested = m.used | m.rejected
        return VisualOutcome(int(m.used.sum()), int(m.rejected.sum()), m.nis[tested], m.dof[tested])

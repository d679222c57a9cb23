"""The sliding window: clones come and go, and features that end become measurements (docs/filter.md, section 4)."""

import numpy as np

from msckf.config import VisionConfig
from msckf.features import FeatureTable
from msckf.frontend import Observations
from msckf.slam import add_landmarks, promotable, update_landmarks
from msckf.standstill import image_motion
from msckf.state import FilterState
from msckf.views import Rig, Views
from msckf.visual import VisualOutcome, measure
from navcore.arrays import Mask


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
        fresh = observations.rows(~np.isin(observations.keys, state.landmarks.keys))
        self.table.add_column(fresh.keys, fresh.cameras, fresh.uv, fresh.bearings)
        full = len(state.clones) >= self.config.clones
        leaving = self.table.seen[:, 0] if full else np.zeros(len(self.table), dtype=bool)
        candidates = (~self.table.alive | leaving) & (self.table.views >= self.config.min_views)
        lasting = candidates & self.table.alive & self.table.seen.all(axis=1)
        corrected = update_landmarks(state, state.rig or self.rig, observations, self.config)
        outcome = self._use(state, self._longest(candidates), lasting)
        self.table.drop_rows(~self.table.alive)
        if full:
            state.drop_clone(0)
            self.table.drop_column(0)
        return VisualOutcome(
            outcome.used + corrected.used, outcome.rejected + corrected.rejected, outcome.nis, outcome.dof
        )

    def _views(self, rows: Mask, rig: Rig) -> Views:
        t = self.table
        return Views(rig, t.cameras[rows], t.uv[rows], t.seen[rows], t.bearings[rows])

    def _longest(self, candidates: Mask) -> Mask:
        """The features with the most views among the candidates, as many as may be used."""
        if candidates.sum() <= self.config.max_features:
            return candidates
        order = np.argsort(np.where(candidates, -self.table.views, 1), kind="stable")
        chosen = np.zeros(len(candidates), dtype=bool)
        chosen[order[: self.config.max_features]] = True
        return chosen

    def _use(self, state: FilterState, chosen: Mask, lasting: Mask) -> VisualOutcome:
        """Correct the state by the chosen features; those that are lasting become landmarks while there is room."""
        if not chosen.any():
            return VisualOutcome()
        clones, config = state.clones, self.config
        columns = state.seen_columns
        R_lin, p_lin = state.linearisation_clones
        P = state.covariance[np.ix_(columns, columns)]
        views = self._views(chosen, state.rig or self.rig)
        estimated = state.rig is not None
        m = measure(views, clones.R_WB, clones.p_WB, R_lin, p_lin, P, config, extrinsics=estimated)
        if m is None:
            return VisualOutcome()
        where = np.flatnonzero(chosen)
        promoted = lasting[where[m.used]] & promotable(state, m, config)
        promoted &= np.cumsum(promoted) <= config.landmarks - len(state.landmarks)
        if promoted.any():
            add_landmarks(state, self.table.keys[where[m.used][promoted]], m, promoted, config)
        if m.used.any():
            state.update(m.H, columns, m.r, config.pixel_noise**2 * np.eye(len(m.r)))
        spent = np.zeros(len(self.table), dtype=bool)
        spent[where[m.used | m.rejected]] = True
        self.table.alive[where[m.used][promoted]] = False  # the state follows them from here on
        self.table.consume(spent)
        return VisualOutcome(int(m.used.sum()), int(m.rejected.sum()), m.nis, m.dof)

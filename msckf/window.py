"""The sliding window: clones come and go, and features that end become measurements (docs/filter.md, section 4)."""

from dataclasses import replace

import numpy as np

from msckf.blocks import THETA
from msckf.config import VisionConfig
from msckf.features import FeatureTable
from msckf.slam import add_landmarks, move_anchors, promotable, update_landmarks
from msckf.state import FilterState
from msckf.views import Views
from msckf.visual import VisualMeasurement, VisualOutcome, measure
from navcore.arrays import Mask, Vectors, among
from navcore.frontend import Observations
from navcore.pixel_noise import PixelNoise
from navcore.stillness import image_motion

_ITERATIONS = 8
_ASKEW = 0.003  # rad, standard deviation of how a camera is turned, past which updates are iterated
_SETTLED = 1e-3  # rad or m, norm of a step over the window


class VisualWindow:
    """Features over the clones of a filter state."""

    def __init__(self, cameras: int, config: VisionConfig) -> None:
        self._asked = self.config = config
        self.noise = PixelNoise(config)
        self.table = FeatureTable(cameras)

    def disparity(self, observations: Observations) -> float | None:
        """Motion of the image [px] since the newest clone, or None if too few features are common."""
        if len(self.table) == 0 or self.table.clones == 0:
            return None
        columns = self.table.columns(np.array([self.table.clones - 1]))[observations.cameras]
        rows = np.minimum(np.searchsorted(self.table.keys, observations.keys), len(self.table) - 1)
        both = (self.table.keys[rows] == observations.keys) & self.table.seen[rows, columns]
        return image_motion(self.table.uv[rows[both], columns[both]], observations.uv[both])

    def hold(self, observations: Observations) -> None:
        """The body has not moved since the newest clone: only note which features are still followed."""
        self.table.alive = among(self.table.keys, observations.keys)

    def advance(self, state: FilterState, t_ns: int, omega_B: Vectors, observations: Observations) -> VisualOutcome:
        """Clone the current pose, use the features that end, drop the oldest clone when the window is full."""
        self.config = replace(self._asked, pixel_noise=self.noise.sigma)
        state.add_clone(t_ns, omega_B)
        self.table.add_clone(observations.rows(~among(observations.keys, state.landmarks.keys)))
        leaving = self._leaving() if len(state.clones) >= self.config.clones else None
        seen_from = self.table.seen_from
        last_chance = seen_from[:, 0] if leaving == 0 else np.zeros(len(self.table), dtype=bool)
        candidates = (~self.table.alive | last_chance) & (self.table.views >= self.config.min_views)
        lasting = candidates & self.table.alive & seen_from.all(axis=1)
        corrected = update_landmarks(state, observations, self.config)
        outcome = self._use(state, self._longest(candidates), lasting)
        self.table.drop_rows(~self.table.alive)
        if leaving is not None:
            move_anchors(state, leaving)
            state.drop_clone(leaving)
            self.table.drop_clone(leaving)
        return VisualOutcome(
            outcome.used + corrected.used, outcome.rejected + corrected.rejected, outcome.nis, outcome.dof
        )

    def _leaving(self) -> int:
        """The clone that leaves a full window: the oldest, or the last before the newest if it is no keyframe.

        What was seen from a clone that is no keyframe goes unused: the window reaches farther back in its place.
        """
        before, last = self.table.clones - 3, self.table.clones - 2
        if self.config.marginalise == "oldest" or before < 0:
            return 0
        moved = image_motion(*self.table.followed(before, last))
        return last if moved is not None and moved < self.config.keyframe_disparity else 0

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
        config, columns = self.config, state.seen_columns
        views = self.table.views_of(state.rig, chosen)
        unsure = state.velocity_sigma > config.unsure_velocity
        m = self._settled(state, views) if unsure or _seen_askew(state) else self._measured(state, views)
        self.noise.learn(m.nis, m.dof, only_up=unsure)
        where = np.flatnonzero(chosen)
        promoted = lasting[where[m.used]] & promotable(m, config) & (not unsure)
        promoted &= np.cumsum(promoted) <= config.landmarks - len(state.landmarks)
        if promoted.any():
            cameras = views.cameras[views.last[m.used]]
            keys = self.table.keys[where[m.used][promoted]]
            add_landmarks(state, keys, cameras[promoted], m, promoted, config.pixel_noise)
        if m.used.any():
            state.update(m.H, columns, m.r, config.pixel_noise**2 * np.eye(len(m.r)))
            if unsure:
                state.linearise_anew()
        spent = np.zeros(len(self.table), dtype=bool)
        spent[where[m.used | m.rejected]] = True
        self.table.alive[where[m.used][promoted]] = False  # the state follows them from here on
        self.table.consume(spent)
        return VisualOutcome(int(m.used.sum()), int(m.rejected.sum()), m.nis, m.dof)

    def _measured(self, state: FilterState, views: Views) -> VisualMeasurement:
        """What the views say at the present estimate."""
        columns, clones = state.seen_columns, state.clones
        P = state.covariance[np.ix_(columns, columns)]
        return measure(views, clones.R_WB, clones.p_WB, *state.linearisation_clones, P, self.config, state.estimated)

    def _settled(self, state: FilterState, views: Views) -> VisualMeasurement:
        """The same, linearised where the update will end (iterated Kalman filter: Bell and Cathey 1993)."""
        before, columns = state.checkpoint(), state.seen_columns
        P = before.covariance[np.ix_(columns, columns)]
        dx = np.zeros(len(columns))
        for _ in range(_ITERATIONS):
            at = state.clones.R_WB, state.clones.p_WB
            m = measure(replace(views, rig=state.rig), *at, *at, P, self.config, state.estimated, dx)
            state.back_to(before)
            last = dx
            if m.used.any():
                dx = state.update(m.H, columns, m.r, self.config.pixel_noise**2 * np.eye(len(m.r)))[columns]
            if np.linalg.norm(dx - last) < _SETTLED:
                break
        state.back_to(before)
        if m.used.any():
            state.clones.R_first, state.clones.p_first = at
        return m


def _seen_askew(state: FilterState) -> bool:
    """Whether it is so uncertain how the cameras are turned that one linearisation does not do."""
    if not state.estimated.extrinsics:
        return False
    variance = np.diagonal(state.covariance)[state.cameras].reshape(len(state.rig), -1)
    return bool(variance[:, THETA].max() > _ASKEW**2)

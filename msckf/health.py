"""How good the estimate is, and why it is not better."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from msckf.blocks import POSITION, VELOCITY
from msckf.config import HealthConfig
from msckf.state import FilterState
from msckf.visual import VisualOutcome
from navcore.arrays import Stamps, among
from navcore.frontend import Observations
from navcore.odometry import Health


@dataclass(frozen=True)
class Verdict:
    """Health with its reasons."""

    health: Health
    reasons: tuple[str, ...]


class HealthMonitor:
    """Judges every frame by what vision did and by the state's own bounds."""

    def __init__(self, config: HealthConfig) -> None:
        self._config = config
        self._last_vision_ns = 0
        self._position_variance = 0.0
        self._said: deque[tuple[int, int, int]] = deque()  # t_ns, features used, features refused
        self._followed: Stamps = np.zeros(0, dtype=np.int64)  # keys of the features in the last frame
        self._cut_ns: int | None = None  # when nearly all features were lost from one frame to the next
        self._contradicted_ns: int | None = None  # when the state was last contradicted, if not confirmed since

    def started(self, t_ns: int) -> None:
        """The filter has just started."""
        self._last_vision_ns = t_ns

    @property
    def contradicted(self) -> bool:
        """Whether the state has been contradicted, and not confirmed since."""
        return self._contradicted_ns is not None

    def contradict(self, t_ns: int) -> None:
        """Something says that the state is wrong."""
        self._contradicted_ns = t_ns

    def confirm(self) -> None:
        """Something says that the state is right."""
        self._contradicted_ns = None

    def judge(
        self, state: FilterState, t_ns: int, observations: Observations, outcome: VisualOutcome, still: bool
    ) -> Verdict:
        """The verdict on the frame at `t_ns`."""
        c = self._config
        self._weigh(t_ns, outcome, observations)
        if outcome.used or still:
            self._last_vision_ns = t_ns
            self._position_variance = float(np.diagonal(state.covariance)[POSITION].max())
        lost = self._lost(state)
        if lost:
            return Verdict(Health.LOST, (lost, *observations.faults))
        reasons = list(observations.faults)
        if still:
            reasons.append("standing still")
        if outcome.rejected > 2 * max(outcome.used, 4):
            reasons.append(f"{outcome.rejected} features refused")
        if len(observations) < c.min_tracked:
            reasons.append(f"{len(observations)} features followed")
        if self.contradicted:
            reasons.append("vision contradicts the state")
        blind_s = (t_ns - self._last_vision_ns) * 1e-9
        if len(observations) >= c.min_tracked and blind_s <= c.blind_s and not self.contradicted:
            return Verdict(Health.TRACKING, tuple(reasons))
        if blind_s > c.blind_s:
            reasons.append(f"no visual correction for {blind_s:.1f} s")
        return Verdict(Health.INERTIAL_ONLY, tuple(reasons))

    def _weigh(self, t_ns: int, outcome: VisualOutcome, observations: Observations) -> None:
        """Hear what vision says of the state.

        A view full of things that move contradicts it, too: what is wrong, state or vision, this does not tell. And a
        wrong state is not refused by every feature at all times: what has been contradicted stays so until most agree.
        Most must agree, too, where the view has become another one: what was seen before tells nothing of it.
        """
        c = self._config
        self._said.append((t_ns, outcome.used, outcome.rejected))
        if len(observations):
            if among(self._followed, observations.keys).sum() < c.cut_share * len(self._followed):
                self._cut_ns = t_ns
                self._said = deque([(t_ns, 0, 0)])
            self._followed = observations.keys
        while t_ns - self._said[0][0] > round(c.confirmed_s * 1e9):
            self._said.popleft()
        used, refused = self._counted(t_ns - round(c.contradicted_s * 1e9))
        many = max(c.contradicted_features, c.contradicted_followed * len(observations))
        anew = self._cut_ns is not None and t_ns - self._cut_ns <= round(c.confirmed_s * 1e9)
        if refused >= many and used < (1.0 if anew else c.contradicted_share) * refused:
            self.contradict(t_ns)
        elif self._contradicted_ns is not None and t_ns - self._contradicted_ns > round(c.confirmed_s * 1e9):
            used, refused = self._counted(self._said[0][0])
            if used >= c.contradicted_features and used > refused:
                self.confirm()

    def _counted(self, since_ns: int) -> tuple[int, int]:
        """Features used and refused since then."""
        recent = [entry for entry in self._said if entry[0] >= since_ns]
        return sum(entry[1] for entry in recent), sum(entry[2] for entry in recent)

    def _lost(self, state: FilterState) -> str:
        """Why the state is not to be trusted at all, or nothing."""
        c = self._config
        variance = np.diagonal(state.covariance)
        if not (np.isfinite(variance).all() and np.isfinite(state.p_WB).all() and np.isfinite(state.R_WB).all()):
            return "state is not finite"
        if variance.min() < 0.0:
            return "a variance is negative"
        speed = float(np.linalg.norm(state.v_WB))
        if speed > c.max_speed:
            return f"speed {speed:.1f} m/s is past {c.max_speed:.1f}"
        if variance[VELOCITY].max() > c.max_velocity_sigma**2:
            return f"velocity is known to {np.sqrt(variance[VELOCITY].max()):.1f} m/s only"
        if variance[POSITION].max() - self._position_variance > c.max_position_sigma**2:
            return f"position was lost by {np.sqrt(variance[POSITION].max()):.1f} m"
        return ""

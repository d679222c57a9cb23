"""How good the estimate is, and why it is not better."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from msckf.blocks import POSITION, VELOCITY
from msckf.config import HealthConfig
from msckf.frontend import Observations
from msckf.state import FilterState
from msckf.visual import VisualOutcome
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
        self.contradicted = False  # whether vision has contradicted the state, and not confirmed it since

    def started(self, t_ns: int) -> None:
        """The filter has just started."""
        self._last_vision_ns = t_ns

    def confirmed(self) -> None:
        """Another estimate agrees with the state."""
        self._said.clear()
        self.contradicted = False

    def judge(
        self, state: FilterState, t_ns: int, observations: Observations, outcome: VisualOutcome, still: bool
    ) -> Verdict:
        """The verdict on the frame at `t_ns`."""
        c = self._config
        self._weigh(t_ns, outcome)
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

    def _weigh(self, t_ns: int, outcome: VisualOutcome) -> None:
        """Hear what vision says of the state.

        A view full of things that move contradicts it, too: what is wrong, state or vision, this does not tell. A wrong
        state is not refused by every feature at all times, least of all once some have pulled at it: so what has been
        contradicted stays so until most features agree.
        """
        c = self._config
        self._said.append((t_ns, outcome.used, outcome.rejected))
        while t_ns - self._said[0][0] > round(c.confirmed_s * 1e9):
            self._said.popleft()
        used, refused = self._counted(t_ns, c.contradicted_s)
        if refused >= c.contradicted_features and used < c.contradicted_share * refused:
            self.contradicted = True
        elif self.contradicted:
            used, refused = self._counted(t_ns, c.confirmed_s)
            self.contradicted = used < c.contradicted_features or refused > c.confirmed_share * used

    def _counted(self, t_ns: int, seconds: float) -> tuple[int, int]:
        """Features used and refused in the last seconds."""
        recent = [entry for entry in self._said if t_ns - entry[0] <= round(seconds * 1e9)]
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

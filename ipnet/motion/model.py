"""How a platform moves: a linear autoregression of force, velocity, tilt and rate in the body's frame, learned."""

from dataclasses import dataclass

import numpy as np

from ipnet.errors import ConfigError
from ipnet.motion.intervals import FEATURES, FORCE, SPEED, TURNS, Intervals
from navcore.arrays import Floats, Mask, frozen

ROWS = 12
"""Features that are predicted: all but the place."""
EFFECTS = ROWS + 9
"""What is constant over a run: a constant in each row (12), and how force depends on velocity (3 x 3)."""
_SHAPES: dict[str, tuple[int, ...]] = {
    "A": (ROWS, FEATURES),
    "B": (ROWS, TURNS),
    "C": (ROWS, TURNS),
    "c": (ROWS,),
    "D": (3, 3),
    "Q": (ROWS, ROWS),
    "effects": (EFFECTS, EFFECTS),
    "mean": (FEATURES,),
    "spread": (FEATURES, FEATURES),
}


@dataclass(frozen=True)
class MotionModel:
    """u' = A u + (D v', 0) + B s' + C s + c + effects + w: the features of an interval from those of the one before.

    What a platform cannot do shows as directions in which `w` is small: a quadrotor has no force across its thrust but
    drag, f = D v up to the lever arm of the IMU (in B, C); a rover does not slide sideways.

    Attributes:
        interval_s: length of an interval.
        A: (12, 15).
        B, C: (12, 9), for the turns of this interval and the last.
        c: (12,).
        D: (3, 3) 1/s, force by velocity in the same interval.
        Q: (12, 12) covariance of w, white.
        effects: (21, 21) covariance of what differs from run to run, of mean zero.
        mean, spread: (15,), (15, 15) of u itself: what is known before anything is seen.
        dof: of w's tails, as Student's t.
        gate: least `Intervals.shake` with which it moves by itself, or None: a drone that is carried is no drone.
    """

    interval_s: float
    A: Floats
    B: Floats
    C: Floats
    c: Floats
    D: Floats
    Q: Floats
    effects: Floats
    mean: Floats
    spread: Floats
    dof: float
    gate: float | None

    def __post_init__(self) -> None:
        for name, shape in _SHAPES.items():
            values = frozen(name, getattr(self, name), np.float64, shape)
            object.__setattr__(self, name, values)
            if not np.isfinite(values).all():
                raise ConfigError(f"{name} of a motion model is not finite: {values[~np.isfinite(values)]}")

    def innovations(self, u: Floats, turns: Floats, effects: Floats) -> Floats:
        """(N - 1, 12) w between successive features (N, 15) with turns (N, 9), at given effects (21,)."""
        expected = u[:-1] @ self.A.T + turns[1:] @ self.B.T + turns[:-1] @ self.C.T + self.c + effects[:ROWS]
        expected[:, FORCE] += u[1:, SPEED] @ self._drag(effects).T
        return u[1:, :ROWS] - expected

    def jacobians(self, u: Floats, effects: Floats) -> tuple[Floats, Floats, Floats]:
        """Derivatives of `innovations` by u' (12, 15), by u (12, 15), and by the effects (N - 1, 12, 21)."""
        by_next = np.eye(ROWS, FEATURES)
        by_next[FORCE, SPEED] -= self._drag(effects)
        by_effects = np.zeros((len(u) - 1, ROWS, EFFECTS))
        by_effects[:, :, :ROWS] = -np.eye(ROWS)
        for row in range(3):
            begin = ROWS + 3 * row
            by_effects[:, row, begin : begin + 3] = -u[1:, SPEED]
        return by_next, -self.A, by_effects

    def applies(self, intervals: Intervals) -> Mask:
        """(N - 1,) whether both of two successive intervals are the platform's own motion."""
        own = ~intervals.still if self.gate is None else ~intervals.still & (intervals.shake > self.gate)
        return np.asarray(own[1:] & own[:-1])

    def _drag(self, effects: Floats) -> Floats:
        """(3, 3) of a run."""
        return self.D + effects[ROWS:].reshape(3, 3)

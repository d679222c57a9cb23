"""Things that move through a world on paths of their own: carts and people as boxes on its floor."""

from dataclasses import dataclass

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Vectors
from sim.errors import ConfigError
from sim.world.block import Triple, gaps, triple
from sim.world.layout import Layout
from sim.world.look import PAINTED, Look

KEEPS_FROM_BODY = 0.7
"""How far a mover keeps from the body at any time [m]."""
MAX_SPEED = 1.4
"""Walking speed [m/s]."""

_KEEPS_FROM_THINGS = 0.1  # m
_STEP_S = 0.05
_BETWEEN_STEPS = 0.15  # m, more than the body and a mover approach between two steps
_SLOWEST = 0.4  # m/s, of the fastest part of a loop
_RADIUS = (0.5, 2.5)  # m, of a loop
_REACH = 3.5  # m, from the body's path to the middle of a loop
_TRIES = 600


@dataclass(frozen=True)
class Loop:
    """A smooth closed way over the floor, gone round and round: a Fourier series of two terms, the second small.

    Attributes:
        middle: (2,) m in W.
        cosine, sine: (2, 2) m, by term, then x and y.
        period_s: of one round.
    """

    middle: Floats
    cosine: Floats
    sine: Floats
    period_s: float

    def at(self, t_s: Floats) -> tuple[Floats, Floats]:
        """Places (N, 2) m and velocities (N, 2) m/s at times (N,)."""
        rate = 2.0 * np.pi / self.period_s * np.arange(1, 3)
        angle = np.multiply.outer(t_s, rate)
        place = self.middle + np.cos(angle) @ self.cosine + np.sin(angle) @ self.sine
        velocity = (np.cos(angle) * rate) @ self.sine - (np.sin(angle) * rate) @ self.cosine
        return place, velocity


@dataclass(frozen=True)
class Mover:
    """A box that goes along a loop, facing ahead.

    Attributes:
        half: half sizes [m] along, across and up.
        floor: height of the floor [m].
        loop: where it goes.
        look: of its sides.
    """

    half: Triple
    floor: float
    loop: Loop
    look: Look = PAINTED

    @property
    def radius(self) -> float:
        """Of the upright cylinder around it [m]."""
        return float(np.hypot(self.half[0], self.half[1]))

    def at(self, t_s: Floats) -> tuple[Vectors, Floats]:
        """Centres (N, 3) m in W and headings (N,) rad at times (N,)."""
        place, velocity = self.loop.at(t_s)
        height = np.full((len(place), 1), self.floor + self.half[2])
        return np.hstack([place, height]), np.arctan2(velocity[:, 1], velocity[:, 0])

    def corners(self, t_s: Floats) -> Vectors:
        """Its corners (N, 8, 3) m in W at times (N,)."""
        centres, headings = self.at(t_s)
        signs = np.stack(np.meshgrid(*3 * ([-1.0, 1.0],)), axis=-1).reshape(-1, 3)
        R_WM = so3.exp(headings[:, None] * [0.0, 0.0, 1.0])
        corners: Vectors = centres[:, None] + (signs * self.half) @ np.swapaxes(R_WM, 1, 2)
        return corners

    def clearance(self, t_s: Floats, points: Vectors) -> Floats:
        """(N,) m: how far points (N, 3) are, each at its time (N,), from the cylinder around it."""
        aside = np.linalg.norm(points[:, :2] - self.loop.at(t_s)[0], axis=1) - self.radius
        above = points[:, 2] - (self.floor + 2.0 * self.half[2])
        away: Floats = np.hypot(np.maximum(aside, 0.0), np.maximum(above, 0.0))
        return away


def make_movers(n: int, layout: Layout, path: Vectors, seconds: float, rng: np.random.Generator) -> tuple[Mover, ...]:
    """Movers through the free space of a world, near the body's path but never where the body is.

    Args:
        n: how many.
        layout: what they go around.
        path: (N, 3) m in W, the body's, sampled evenly over `seconds`.
        seconds: how long the path lasts.
        rng: draws them.

    Raises:
        ConfigError: `n` is negative, or there is no room for so many.
    """
    if n < 0:
        raise ConfigError(f"{n} movers were asked for; expected 0 or more")
    t_s = np.arange(0.0, seconds + _STEP_S, _STEP_S)
    times = np.linspace(0.0, seconds, len(path))
    body = np.stack([np.interp(t_s, times, x) for x in np.asarray(path).T], axis=1)
    found: list[Mover] = []
    failed = 0
    while len(found) < n and failed < _TRIES:
        mover = _draw(layout, body, 1.0 - failed / _TRIES, rng)
        if _fits(mover, layout, body, t_s, found):
            found.append(mover)
            failed = 0
        else:
            failed += 1
    if len(found) < n:
        raise ConfigError(f"{n} movers were asked for; there is room for {len(found)} between things and path")
    return tuple(found)


def _draw(layout: Layout, body: Vectors, scale: float, rng: np.random.Generator) -> Mover:
    """A cart or a person somewhere near the path, on a loop of up to `scale` of the largest."""
    if rng.random() < 0.5:
        half = triple(rng.uniform((0.35, 0.2, 0.3), (0.5, 0.3, 0.55)))
    else:
        half = triple(rng.uniform((0.13, 0.2, 0.75), (0.2, 0.28, 0.92)))
    middle = body[rng.integers(len(body)), :2] + rng.uniform(-_REACH, _REACH, 2)
    radius = _RADIUS[0] + scale * rng.uniform(0.0, _RADIUS[1] - _RADIUS[0])
    narrow = radius * rng.uniform(0.4, 1.0)
    turn, second = rng.uniform(0.0, 2.0 * np.pi), 0.2 * narrow * rng.uniform(-1.0, 1.0, (2, 2)) / np.sqrt(2.0)
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    side = rng.choice([-1.0, 1.0])
    cosine, sine = np.stack([radius * along, second[0]]), np.stack([side * narrow * across, second[1]])
    fastest = float(np.linalg.norm(Loop(middle, cosine, sine, 1.0).at(np.arange(0.0, 1.0, 0.01))[1], axis=1).max())
    loop = Loop(middle, cosine, sine, 1.01 * fastest / rng.uniform(_SLOWEST, MAX_SPEED))
    return Mover(half, layout.low[2], loop)


def _fits(mover: Mover, layout: Layout, body: Vectors, t_s: Floats, others: list[Mover]) -> bool:
    """Whether it stays in the box, clear of things, of the body and of the other movers."""
    round_s = np.linspace(0.0, mover.loop.period_s, 200)
    centres, _ = mover.at(round_s)
    keeps = mover.radius + _KEEPS_FROM_THINGS
    low, high = np.array(layout.low)[:2] + keeps, np.array(layout.high)[:2] - keeps
    if np.any(centres[:, :2] < low) or np.any(centres[:, :2] > high):
        return False
    for block in layout.blocks:
        overlaps = block.low[2] < mover.floor + 2.0 * mover.half[2] and block.high[2] > mover.floor
        if overlaps and gaps(centres[:, :2], block.low[:2], block.high[:2]).min() < keeps:
            return False
    if mover.clearance(t_s, body).min() < KEEPS_FROM_BODY + _BETWEEN_STEPS:
        return False
    place = mover.loop.at(t_s)[0]
    apart = (np.linalg.norm(place - o.loop.at(t_s)[0], axis=1).min() - mover.radius - o.radius for o in others)
    return all(a > _KEEPS_FROM_THINGS for a in apart)

"""A long, narrow corridor with plain walls: little to see but doors, frames, skirting and a few notices."""

import numpy as np

from sim.world.block import Block, triple
from sim.world.layout import Layout
from sim.world.look import LINOLEUM, NOTICE, PLAIN, WOOD, Look
from sim.world.plan import Plan
from sim.world.way import Way

_BESIDE, _BEYOND, _ABOVE = 0.8, 6.0, 0.85  # m, from the path to the side walls, the ends and the ceiling
_LEAST_WIDTH, _LEAST_HEIGHT = 2.2, 2.7  # m
_DOOR = (0.9, 2.05)  # m, width and height
_DOORS_EVERY = (2.5, 4.5)  # m
_LAMPS_EVERY = 4.0  # m
_LAMPS = 12  # at most


def corridor(way: Way, rng: np.random.Generator) -> Layout:
    """One straight corridor along the longer side of the path's bounding box.

    It is as wide as the path needs, so around a path that fills a room it is a wide, plain-walled passage, not a
    network of narrow ones.
    """
    extent = (way.high - way.low)[:2]
    along = int(np.argmax(extent))
    half = 0.5 * extent + np.where(np.arange(2) == along, _BEYOND, _BESIDE)
    half[1 - along] = max(half[1 - along], 0.5 * _LEAST_WIDTH)
    middle = 0.5 * (way.low + way.high)[:2]
    top = max(way.floor + _LEAST_HEIGHT, way.high[2] + _ABOVE)
    plan = Plan(way, np.array([*(middle - half), way.floor]), np.array([*(middle + half), top]))
    for wall in (0, 1):
        _set_doors(plan, along, wall, rng)
    _hang_lamps(plan, along)
    return Layout(
        triple(plan.low),
        triple(plan.high),
        tuple(plan.blocks),
        tuple(plan.lamps),
        floor=LINOLEUM,
        walls=PLAIN,
        ceiling=PLAIN,
        way=way.points,
    )


def _set_doors(plan: Plan, along: int, wall: int, rng: np.random.Generator) -> None:
    """Doors in frames along a side wall, skirting from door to door, and a notice on every third stretch."""
    floor, end = plan.low[2], plan.high[along]
    width, height = _DOOR
    begun = plan.low[along]
    s = begun + rng.uniform(0.5, 2.0)
    k = 0
    while s + width + 0.2 < end:
        plan.put(_on_wall(plan, along, wall, (s, floor), (s + width, floor + height), 0.02))
        for a in (s - 0.09, s + width + 0.03):
            plan.put(_on_wall(plan, along, wall, (a, floor), (a + 0.06, floor + height + 0.1), 0.05))
        plan.put(_on_wall(plan, along, wall, (s, floor + height + 0.03), (s + width, floor + height + 0.1), 0.05))
        plan.put(_on_wall(plan, along, wall, (begun, floor), (s - 0.12, floor + 0.09), 0.015))
        begun = s + width + 0.12
        s += width + rng.uniform(*_DOORS_EVERY)
        if k % 3 == 1:
            at, up = 0.5 * (begun + s), floor + rng.uniform(1.3, 1.5)
            size = rng.uniform(0.15, 0.35, 2)
            plan.put(
                _on_wall(plan, along, wall, (at - size[0], up - size[1]), (at + size[0], up + size[1]), 0.02, NOTICE)
            )
        k += 1
    plan.put(_on_wall(plan, along, wall, (begun, floor), (end, floor + 0.09), 0.015))


def _on_wall(
    plan: Plan,
    along: int,
    wall: int,
    low: tuple[float, float],
    high: tuple[float, float],
    depth: float,
    look: Look = WOOD,
) -> Block:
    """A block on a side wall between two corners (along the wall, height) m, standing out by a depth [m]."""
    face = (plan.low, plan.high)[wall][1 - along]
    across = sorted((face, face + depth * (1.0, -1.0)[wall]))
    ends = np.empty((2, 3))
    ends[:, along], ends[:, 1 - along], ends[:, 2] = (low[0], high[0]), across, (low[1], high[1])
    return Block.between(ends[0], ends[1], look)


def _hang_lamps(plan: Plan, along: int) -> None:
    length = plan.high[along] - plan.low[along]
    n = min(_LAMPS, max(2, round(length / _LAMPS_EVERY)))
    for k in range(n):
        at = 0.5 * (plan.low + plan.high)
        at[along] = plan.low[along] + (k + 0.5) / n * length
        plan.hang_lamp(float(at[0]), float(at[1]))

"""A room with crates and pillars along its walls and lamps under its ceiling."""

import numpy as np

from navcore.arrays import Vectors
from sim.world.block import Block, triple
from sim.world.layout import Layout
from sim.world.plan import Plan
from sim.world.way import Way

SIZE = (10.0, 8.0, 4.0)
"""Least size along x, y, z [m]. A path that fits is in a room of this size about the origin of W."""

_CRATES = 14  # in a room of that size
_LAMPS = (4, 12)  # in a room of that size, and at most
_RING = 0.95  # m, how far clutter stands out from the walls
_WALL, _FROM_WALL = 1.0, 1.5  # m, from the path: what still fits, and what a room that is made larger has
_HEADROOM = 0.8  # m
_TABLES = 8  # in the middle, for each further room of that size


def room(way: Way, rng: np.random.Generator) -> Layout:
    """A furnished room of `SIZE`, larger where the path asks for it."""
    low, high = _walls(way)
    plan = Plan(way, low, high)
    w, d, h = high - low
    middle = 0.5 * (low + high)
    for _ in range(round(_CRATES * (w + d) / (SIZE[0] + SIZE[1]))):
        half = np.array([rng.uniform(0.15, 0.45), rng.uniform(0.15, 0.45), rng.uniform(0.15, 0.9)])
        if rng.random() < 0.25:
            half[:2], half[2] = rng.uniform(0.12, 0.2), 0.5 * h  # a pillar
        across = 1 if rng.random() < w / (w + d) else 0
        room_to_stand = 0.5 * (high - low) - half
        depth = rng.uniform(0.0, max(0.0, _RING - 2.0 * half[across]))
        side = rng.choice([-1.0, 1.0])
        at = np.array([*middle[:2], low[2] + half[2]])
        at[1 - across] += rng.uniform(-room_to_stand[1 - across], room_to_stand[1 - across])
        for back in (depth, 0.0):
            at[across] = middle[across] + side * (room_to_stand[across] - back)
            block = Block(triple(at), triple(half))
            if way.clear_of(block):
                plan.blocks.append(block)
                break
    _hang_lamps(plan, rng)
    _set_tables(plan, rng)
    return Layout(triple(low), triple(high), tuple(plan.blocks), tuple(plan.lamps), way=way.points)


def _walls(way: Way) -> tuple[Vectors, Vectors]:
    half = 0.5 * np.array(SIZE[:2])
    floor, ceiling = way.floor, max(way.floor + SIZE[2], way.high[2] + _HEADROOM)
    if np.all(np.maximum(way.high[:2], -way.low[:2]) <= half - _WALL):
        return np.array([*-half, floor]), np.array([*half, ceiling])
    half = np.maximum(half, 0.5 * (way.high - way.low)[:2] + _FROM_WALL)
    middle = 0.5 * (way.high + way.low)[:2]
    return np.array([*(middle - half), floor]), np.array([*(middle + half), ceiling])


def _hang_lamps(plan: Plan, rng: np.random.Generator) -> None:
    size, middle = plan.high - plan.low, 0.5 * (plan.low + plan.high)
    for _ in range(min(_LAMPS[1], round(_LAMPS[0] * size[0] * size[1] / (SIZE[0] * SIZE[1])))):
        plan.hang_lamp(*(middle[:2] + [rng.uniform(-0.4 * size[k], 0.4 * size[k]) for k in (0, 1)]))


def _set_tables(plan: Plan, rng: np.random.Generator) -> None:
    """In a large room walls are far away: things in the middle are near."""
    size = plan.high - plan.low
    for _ in range(round(_TABLES * (size[0] * size[1] / (SIZE[0] * SIZE[1]) - 1.0))):
        half = np.array([rng.uniform(0.25, 0.6), rng.uniform(0.25, 0.6), rng.uniform(0.2, 0.8)])
        plan.put(Block(triple([*plan.near(rng, (0.4, 2.5)), plan.low[2] + half[2]]), triple(half)))

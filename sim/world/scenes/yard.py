"""A yard under a bright sky: house fronts, a fence, trees, containers, and small things beside the path."""

import numpy as np

from sim.world.block import Block, triple
from sim.world.layout import Layout
from sim.world.look import BOARDS, FOLIAGE, FRONT, MACHINE, SKY, SOIL
from sim.world.plan import Plan
from sim.world.way import Way

_SKY, _SKY_ABOVE = 22.0, 18.0  # m, from the path
_HOUSES = (3.5, 6.0)  # m, from the path's bounding box to the fronts
_FENCE = (2.0, 3.5)  # m, the same
_FAR_HOUSES = (11.0, 15.0)  # m, the same, behind the fence
_SUN_HEIGHT = (35.0, 55.0)  # deg above the horizon
_TREES, _CONTAINERS, _THINGS = 14, 4, 40  # tried


def yard(way: Way, rng: np.random.Generator) -> Layout:
    """A yard around the path: houses on two of its sides, a fence and what is behind it on the others.

    The sky is a box so far away that it shows hardly any parallax; shadows are those of a sun.
    """
    margin = np.array([_SKY, _SKY])
    low, high = way.low[:2] - margin, way.high[:2] + margin
    plan = Plan(way, np.array([*low, way.floor]), np.array([*high, way.high[2] + _SKY_ABOVE]))
    first = rng.integers(4)
    for k in range(4):
        axis, side = divmod(int(first + k) % 4, 2)
        houses = k in (0, 2)
        _build_row(plan, axis, side, _HOUSES if houses else _FAR_HOUSES, rng)
        if not houses:
            _build_fence(plan, axis, side, rng.uniform(*_FENCE))
    _set_containers(plan, rng)
    _plant_trees(plan, rng)
    _set_things(plan, rng)
    azimuth, height = rng.uniform(0.0, 2.0 * np.pi), np.deg2rad(rng.uniform(*_SUN_HEIGHT))
    sun = (np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height))
    return Layout(
        triple(plan.low),
        triple(plan.high),
        tuple(plan.blocks),
        floor=SOIL,
        walls=SKY,
        ceiling=SKY,
        sun=triple(sun),
        way=way.points,
    )


def _build_row(plan: Plan, axis: int, side: int, distance: tuple[float, float], rng: np.random.Generator) -> None:
    """Houses beside each other along one side of the path's bounding box."""
    way, floor = plan.way, plan.low[2]
    s, end = way.low[1 - axis] - 6.0, way.high[1 - axis] + 6.0
    while s < end:
        width, depth, height = rng.uniform(5.0, 9.0), rng.uniform(3.0, 5.0), rng.uniform(4.0, 8.0)
        ends = np.empty((2, 3))
        front = rng.uniform(*distance)
        ends[:, axis] = _beyond(way, axis, side, front, front + depth)
        ends[:, 1 - axis], ends[:, 2] = (s, s + width), (floor, floor + height)
        plan.put(Block.between(ends[0], ends[1], FRONT))
        s += width + rng.choice([0.05, 2.0])


def _build_fence(plan: Plan, axis: int, side: int, distance: float) -> None:
    """Boards between posts, lower than a body flies."""
    way, floor = plan.way, plan.low[2]
    s, end = way.low[1 - axis] - 4.0, way.high[1 - axis] + 4.0
    for at in np.linspace(s, end, max(2, round((end - s) / 2.5))):
        for width, thick, height in ((0.07, 0.07, 1.7), (1.0, 0.02, 1.4)):
            ends = np.empty((2, 3))
            ends[:, axis] = _beyond(way, axis, side, distance - thick, distance + thick)
            middle = at if width < 1.0 else at + 1.15
            ends[:, 1 - axis], ends[:, 2] = (middle - width, middle + width), (floor, floor + height)
            plan.put(Block.between(ends[0], ends[1], BOARDS))


def _beyond(way: Way, axis: int, side: int, near: float, far: float) -> list[float]:
    """Two coordinates [m] so far outside one side of the path's bounding box, in order."""
    if side == 0:
        return [float(way.low[axis]) - far, float(way.low[axis]) - near]
    return [float(way.high[axis]) + near, float(way.high[axis]) + far]


def _set_containers(plan: Plan, rng: np.random.Generator) -> None:
    for _ in range(_CONTAINERS):
        half = np.array([2.0, 1.1, 1.2])
        if rng.random() < 0.5:
            half[:2] = half[1::-1]
        plan.put(Block(triple((*plan.near(rng, (2.5, 6.0)), plan.low[2] + half[2])), triple(half), MACHINE))


def _plant_trees(plan: Plan, rng: np.random.Generator) -> None:
    """A trunk, and a crown of three boxes; higher trees where the path is high."""
    tallest = max(3.0, 0.7 * (plan.way.high[2] - plan.low[2]))
    for _ in range(_TREES):
        x, y = plan.near(rng, (1.0, 9.0))
        thick, height, crown = rng.uniform(0.1, 0.2), rng.uniform(1.8, tallest), rng.uniform(0.6, 1.3)
        floor = plan.low[2]
        trunk = Block.between((x - thick, y - thick, floor), (x + thick, y + thick, floor + height), BOARDS)
        parts, z = [trunk], floor + height
        for share in (0.8, 1.0, 0.6):
            half = crown * share * rng.uniform(0.8, 1.2, 3) * [1.0, 1.0, 0.6]
            parts.append(Block(triple((x, y, z + half[2])), triple(half), FOLIAGE))
            z += 2.0 * half[2]
        plan.put(*parts)


def _set_things(plan: Plan, rng: np.random.Generator) -> None:
    """Crates, bins and benches beside the path."""
    for _ in range(_THINGS):
        half = np.array([rng.uniform(0.15, 0.6), rng.uniform(0.15, 0.6), rng.uniform(0.15, 0.6)])
        plan.put(Block(triple((*plan.near(rng, (0.3, 3.0)), plan.low[2] + half[2])), triple(half)))

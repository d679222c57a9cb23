"""A large, high hall with machines, racks, crates, pillars and beams in and around the space that the path leaves."""

from itertools import pairwise

import numpy as np

from sim.world.block import Block, triple
from sim.world.layout import Layout
from sim.world.look import BOARDS, CONCRETE, MACHINE
from sim.world.plan import Plan
from sim.world.way import Way

_LEAST = (22.0, 18.0, 7.0)  # m
_AROUND, _ABOVE = 3.0, 2.0  # m, from the path to walls and ceiling
_BAY = 5.5  # m, between pillars and between beams
_LAMPS = 12  # at most
_MACHINES, _CRATES = 45, 45  # tried


def hall(way: Way, rng: np.random.Generator) -> Layout:
    """A hall of 22 x 18 x 7 m or as large as the path asks for, centred on the path."""
    middle = 0.5 * (way.low + way.high)[:2]
    half = np.maximum(0.5 * np.array(_LEAST[:2]), 0.5 * (way.high - way.low)[:2] + _AROUND)
    top = max(way.floor + _LEAST[2], way.high[2] + _ABOVE)
    plan = Plan(way, np.array([*(middle - half), way.floor]), np.array([*(middle + half), top]))
    _raise_frame(plan, rng)
    _set_racks(plan, rng)
    _set_machines(plan, rng)
    _set_crates(plan, rng)
    return Layout(
        triple(plan.low),
        triple(plan.high),
        tuple(plan.blocks),
        tuple(plan.lamps),
        floor=CONCRETE,
        way=way.points,
    )


def _raise_frame(plan: Plan, rng: np.random.Generator) -> None:
    """Pillars, beams across, pipes along the walls, and lamps between the beams."""
    low, high = plan.low, plan.high
    bays = np.linspace(low[0], high[0], max(2, round((high[0] - low[0]) / _BAY)) + 1)
    thick = rng.uniform(0.18, 0.28)
    rows = [low[1] + share * (high[1] - low[1]) for share in (0.03, 0.33, 0.67, 0.97)]
    for x in bays[1:-1]:
        plan.put(Block.between((x - 0.15, low[1], high[2] - 0.9), (x + 0.15, high[1], high[2] - 0.5), MACHINE))
        for y in rows:
            plan.put(Block.between((x - thick, y - thick, low[2]), (x + thick, y + thick, high[2] - 0.9), CONCRETE))
    for _ in range(4):
        z, y = rng.uniform(low[2] + 2.8, high[2] - 1.2), rng.choice([low[1] + 0.9, high[1] - 0.9])
        plan.put(Block.between((low[0], y - 0.1, z - 0.1), (high[0], y + 0.1, z + 0.1), MACHINE))
    across = max(2, min(_LAMPS // (len(bays) - 1), round((high[1] - low[1]) / 8.0)))
    for x in [0.5 * (a + b) for a, b in pairwise(bays)][: _LAMPS // across]:
        for k in range(across):
            plan.hang_lamp(x + rng.uniform(-0.5, 0.5), low[1] + (k + 0.5) / across * (high[1] - low[1]))


def _set_racks(plan: Plan, rng: np.random.Generator) -> None:
    """Shelves with boxes on them, against the walls along x."""
    for _ in range(8):
        x, wall = rng.uniform(plan.low[0] + 1.8, plan.high[0] - 1.8), rng.choice([0, 1])
        y, inner = ((plan.low[1], 1.0), (plan.high[1], -1.0))[wall]
        a, b = sorted((y + 0.05 * inner, y + 0.85 * inner))
        levels = plan.low[2] + np.array([0.15, 1.1, 2.05])
        parts = [
            Block.between((x + s - 0.04, a, plan.low[2]), (x + s + 0.04, b, levels[-1] + 0.8)) for s in (-1.6, 1.6)
        ]
        for z in levels:
            parts.append(Block.between((x - 1.5, a, z - 0.03), (x + 1.5, b, z + 0.03), BOARDS))
            half = np.array([rng.uniform(0.2, 0.5), rng.uniform(0.2, 0.36), rng.uniform(0.15, 0.36)])
            at = (x + rng.uniform(-0.9, 0.9), 0.5 * (a + b), z + 0.03 + half[2])
            parts.append(Block(triple(at), triple(half)))
        plan.put(*parts)


def _set_machines(plan: Plan, rng: np.random.Generator) -> None:
    """Boxes of some metres, most with a smaller one on top, half of them beside the path, higher where it is high."""
    tallest = max(1.3, 0.4 * (plan.way.high[2] - plan.low[2]))
    for k in range(_MACHINES):
        half = np.array([rng.uniform(0.4, 1.2), rng.uniform(0.4, 1.2), rng.uniform(0.4, tallest)])
        x, y = plan.near(rng, (1.0, 4.0)) if k % 2 else plan.anywhere(rng)
        base = Block(triple((x, y, plan.low[2] + half[2])), triple(half), MACHINE)
        upper = half * rng.uniform(0.3, 0.8, 3)
        shift = (half - upper)[:2] * rng.uniform(-1.0, 1.0, 2)
        top = Block(triple((*(np.array([x, y]) + shift), base.high[2] + upper[2])), triple(upper), MACHINE)
        if not (rng.random() < 0.7 and plan.put(base, top)):
            plan.put(base)


def _set_crates(plan: Plan, rng: np.random.Generator) -> None:
    """Small things beside the path."""
    for _ in range(_CRATES):
        half = rng.uniform(0.15, 0.4, 3)
        x, y = plan.near(rng, (0.3, 2.5))
        plan.put(Block(triple((x, y, plan.low[2] + half[2])), triple(half)))

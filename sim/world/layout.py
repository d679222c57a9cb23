"""The geometry of a room: walls, floor, ceiling and clutter, as boxes and the rectangles one sees of them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from navcore.arrays import Floats, Vectors
from sim.errors import ConfigError

ROOM_SIZE = (10.0, 8.0, 4.0)
"""Room along x, y, z [m]; x and y are centred on the origin of W, the floor is z = 0."""

_CRATES = 14
_LAMPS = 4
_LAMP_HALF = (0.3, 0.3, 0.1)  # m
_RING = 0.95  # m, how far clutter may stand out from the walls: the flying box begins behind it


@dataclass(frozen=True)
class Block:
    """A solid box, axis-aligned: centre and half sizes [m] in W."""

    centre: tuple[float, float, float]
    half: tuple[float, float, float]


@dataclass(frozen=True)
class Layout:
    """A room and what stands in it."""

    size: tuple[float, float, float]
    blocks: tuple[Block, ...]
    lamp_places: tuple[tuple[float, float], ...]

    def landmarks(self, n: int, rng: np.random.Generator) -> tuple[Vectors, Vectors]:
        """Points (n, 3) m spread evenly over all surfaces, and the normals (n, 3) there, into the air."""
        corners, edges_u, edges_v = (np.array(x) for x in zip(*self.rectangles(), strict=True))
        normals = np.cross(edges_u, edges_v)
        area = np.linalg.norm(normals, axis=1)
        which = rng.choice(len(area), size=n, p=area / area.sum())
        s = rng.uniform(size=(n, 2))
        points = corners[which] + s[:, :1] * edges_u[which] + s[:, 1:] * edges_v[which]
        return points, (normals / area[:, None])[which]

    def lamps(self) -> Vectors:
        """(L, 3) m: where the light comes from, just under the lamps."""
        return np.array([(x, y, self.size[2] - 2.0 * _LAMP_HALF[2] - 0.02) for x, y in self.lamp_places])

    def distance(self, start: Vectors, direction: Vectors) -> Floats:
        """(N,) m: how far rays from (N, 3) m along unit directions (N, 3) go until they hit anything."""
        half = 0.5 * np.array(self.size)
        centre = np.array([0.0, 0.0, half[2]])
        with np.errstate(divide="ignore", invalid="ignore"):
            exits = np.where(direction != 0.0, (np.sign(direction) * half - (start - centre)) / direction, np.inf)
        free: Floats = np.minimum(exits.min(axis=1), self.clutter_distance(start, direction))
        return free

    def clutter_distance(self, start: Vectors, direction: Vectors) -> Floats:
        """(N,) m: the same for the clutter alone, infinite where a ray misses it."""
        nearest = np.full(len(start), np.inf)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / direction
            for block in self.blocks:
                a = (np.array(block.centre) - block.half - start) * inverse
                b = (np.array(block.centre) + block.half - start) * inverse
                enter, leave = np.fmin(a, b).max(axis=1), np.fmax(a, b).min(axis=1)
                hit = (enter < leave) & (enter > 0.0)
                nearest = np.where(hit, np.minimum(nearest, enter), nearest)
        return nearest

    def rectangles(self) -> list[tuple[Floats, Floats, Floats]]:
        """Corner and two edges of every rectangle; edge u x edge v points into the air."""
        w, d, h = self.size
        room = _sides(np.array([0.0, 0.0, 0.5 * h]), 0.5 * np.array([w, d, h]))
        inwards = [(corner, v, u) for corner, u, v in room]
        return inwards + [r for b in self.blocks for r in _sides(np.array(b.centre), np.array(b.half))]


def _sides(centre: Floats, half: Floats) -> list[tuple[Floats, Floats, Floats]]:
    """The six sides of a box, normals outwards."""
    sides = []
    for axis in range(3):
        u = 2.0 * half * np.eye(3)[(axis + 1) % 3]
        v = 2.0 * half * np.eye(3)[(axis + 2) % 3]
        out = half * np.eye(3)[axis]
        middle = centre - 0.5 * (u + v)
        sides += [(middle + out, u, v), (middle - out, v, u)]
    return sides


def make_layout(scene: str, path: Vectors, rng: np.random.Generator) -> Layout:
    """A world of a kind around a path; the same generator state gives the same world.

    Args:
        scene: one of `SCENES`.
        path: (N, 3) m in W, where the body goes: nothing stands in its way.
        rng: draws it.

    Raises:
        ConfigError: an unknown scene (the message lists the known ones).
    """
    if scene not in SCENES:
        raise ConfigError(f"scene {scene!r} is unknown; known are {sorted(SCENES)}")
    return SCENES[scene](path, rng)


def _room(path: Vectors, rng: np.random.Generator) -> Layout:
    """A room with crates and pillars along its walls and lamps under its ceiling."""
    w, d, h = ROOM_SIZE
    blocks = []
    for _ in range(_CRATES):
        half = np.array([rng.uniform(0.15, 0.45), rng.uniform(0.15, 0.45), rng.uniform(0.15, 0.9)])
        if rng.random() < 0.25:
            half[:2], half[2] = rng.uniform(0.12, 0.2), 0.5 * h  # a pillar
        along_x = rng.random() < w / (w + d)
        depth = rng.uniform(0.0, max(0.0, _RING - 2.0 * half[1 if along_x else 0]))
        side = rng.choice([-1.0, 1.0])
        if along_x:
            x, y = rng.uniform(-0.5 * w + half[0], 0.5 * w - half[0]), side * (0.5 * d - half[1] - depth)
        else:
            x, y = side * (0.5 * w - half[0] - depth), rng.uniform(-0.5 * d + half[1], 0.5 * d - half[1])
        blocks.append(Block((float(x), float(y), float(half[2])), (float(half[0]), float(half[1]), float(half[2]))))
    lamps = tuple((float(rng.uniform(-0.4 * w, 0.4 * w)), float(rng.uniform(-0.4 * d, 0.4 * d))) for _ in range(_LAMPS))
    blocks += [Block((x, y, h - _LAMP_HALF[2]), _LAMP_HALF) for x, y in lamps]
    return Layout(ROOM_SIZE, tuple(blocks), lamps)


SCENES: dict[str, Callable[[Vectors, np.random.Generator], Layout]] = {"room": _room}
"""Makers of layouts by scene: (path, rng)."""

"""The geometry of a room: walls, floor, ceiling and clutter, as boxes and the rectangles one sees of them."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Floats, Vectors

ROOM_SIZE = (10.0, 8.0, 4.0)
"""Room along x, y, z [m]; x and y are centred on the origin of W, the floor is z = 0."""

_CRATES = 14
_LAMPS = 4
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

    def landmarks(self, n: int, rng: np.random.Generator) -> tuple[Vectors, Vectors]:
        """Points (n, 3) m spread evenly over all surfaces, and the normals (n, 3) there, into the air."""
        corners, edges_u, edges_v = (np.array(x) for x in zip(*self._rectangles(), strict=True))
        normals = np.cross(edges_u, edges_v)
        area = np.linalg.norm(normals, axis=1)
        which = rng.choice(len(area), size=n, p=area / area.sum())
        s = rng.uniform(size=(n, 2))
        points = corners[which] + s[:, :1] * edges_u[which] + s[:, 1:] * edges_v[which]
        return points, (normals / area[:, None])[which]

    def _rectangles(self) -> list[tuple[Floats, Floats, Floats]]:
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


def furnished_room(rng: np.random.Generator) -> Layout:
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
        blocks.append(
            Block((float(x), float(y), float(half[2])), (float(half[0]), float(half[1]), float(half[2])))
        )
    for _ in range(_LAMPS):
        x, y = rng.uniform(-0.4 * w, 0.4 * w), rng.uniform(-0.4 * d, 0.4 * d)
        blocks.append(Block((float(x), float(y), h - 0.1), (0.3, 0.3, 0.1)))
    return Layout(ROOM_SIZE, tuple(blocks))

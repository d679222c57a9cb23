"""The geometry of a world: an enclosing box, the blocks in it, and where its light comes from."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from navcore.arrays import Floats, Vectors
from sim.world.block import Block, Triple, first_hit
from sim.world.look import PAINTED, Look
from sim.world.surface import Surface, sides

LAMP_HALF = (0.3, 0.3, 0.1)
"""Half sizes of a lamp [m]."""

_UNDER_LAMP = 0.02  # m
_FLUSH = 1e-6  # m


@dataclass(frozen=True)
class Layout:
    """An enclosing box and what is in it.

    Attributes:
        low, high: corners of the box [m] in W.
        blocks: what stands in it.
        lamp_places: where lamps hang [m]: the middles of their undersides.
        floor, walls, ceiling: how the box looks from inside.
        sun: unit vector towards the sun, if that is the light.
        way: (P, 3) m, where the body goes; surfaces far from it need less detail.
    """

    low: Triple
    high: Triple
    blocks: tuple[Block, ...] = ()
    lamp_places: tuple[Triple, ...] = ()
    floor: Look = PAINTED
    walls: Look = PAINTED
    ceiling: Look = PAINTED
    sun: Triple | None = None
    way: Vectors = field(default_factory=lambda: np.zeros((0, 3)), repr=False)

    @property
    def diagonal(self) -> float:
        """The longest way [m] that light can go in it."""
        return float(np.linalg.norm(np.subtract(self.high, self.low)))

    @property
    def lights(self) -> int:
        """How many can be told apart: the lamps, or the sun."""
        return len(self.lamp_places) if self.sun is None else 1

    def landmarks(self, n: int, rng: np.random.Generator) -> tuple[Vectors, Vectors]:
        """Points (n, 3) m on the surfaces, and the normals (n, 3) there, into the air.

        They are spread as detail is: evenly where it is seen from near, thinner far away, none in the sky.
        """
        solid = [s for s in self.surfaces if not s.look.shines]
        corners, edges_u, edges_v, normals = (
            np.array([getattr(s, name) for s in solid]) for name in ("corner", "edge_u", "edge_v", "normal")
        )
        weight = np.array([s.area * s.texels_per_m**2 for s in solid])
        which = rng.choice(len(weight), size=n, p=weight / weight.sum())
        s = rng.uniform(size=(n, 2))
        points = corners[which] + s[:, :1] * edges_u[which] + s[:, 1:] * edges_v[which]
        return points, normals[which]

    def lamps(self) -> Vectors:
        """(L, 3) m: where the light comes from, just under the lamps."""
        return np.array(self.lamp_places).reshape(-1, 3) - [0.0, 0.0, _UNDER_LAMP]

    def distance(self, start: Vectors, direction: Vectors) -> Floats:
        """(N,) m: how far rays from (N, 3) m along unit directions (N, 3) go until they hit anything."""
        half, centre = 0.5 * np.subtract(self.high, self.low), 0.5 * np.add(self.high, self.low)
        with np.errstate(divide="ignore", invalid="ignore"):
            exits = np.where(direction != 0.0, (np.sign(direction) * half - (start - centre)) / direction, np.inf)
        free: Floats = np.minimum(exits.min(axis=1), self.clutter_distance(start, direction))
        return free

    def clutter_distance(self, start: Vectors, direction: Vectors) -> Floats:
        """(N,) m: the same for the clutter alone, infinite where a ray misses it."""
        return first_hit(self.blocks, start, direction)

    @cached_property
    def corners(self) -> tuple[Vectors, Vectors]:
        """The lower and the upper corners (B, 3) m of the blocks."""
        both = np.array([(b.low, b.high) for b in self.blocks]).reshape(-1, 2, 3)
        return both[:, 0], both[:, 1]

    @cached_property
    def surfaces(self) -> tuple[Surface, ...]:
        """All that can be seen: the box from inside, then the blocks, but for sides flush against the box."""
        low, high = np.array(self.low), np.array(self.high)
        whole = sides(low, high, (*4 * (self.walls,), self.ceiling, self.floor), inwards=True)
        for block in self.blocks:
            flush = np.stack([np.abs(block.high - high), np.abs(block.low - low)], axis=1).ravel() < _FLUSH
            faces = sides(block.low, block.high, 6 * (block.look,))
            whole += [s for s, hidden in zip(faces, flush, strict=True) if not hidden]
        return tuple(p for k, s in enumerate(whole) for p in replace(s, whole=k).panels(self.way))

"""The rectangles one sees of a world."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Floats, Vectors
from sim.world.block import gaps
from sim.world.look import Look

_LONG, _PANEL = 12.0, 6.0  # m: longer rectangles are cut into panels, fine near the path and coarse far from it
_TEXELS_PER_M = (15.0, 200.0)
_TEXELS_PER_RADIAN = 690.0  # a texel is a rendered pixel of EuRoC's cameras at 1.5 times supersampling
_INWARD = 1e-3  # m, how far before a rectangle its light is worked out


@dataclass(frozen=True)
class Surface:
    """A rectangle, axis-aligned; edge_u x edge_v points into the air, and edge_v up if the rectangle is upright.

    Attributes:
        corner, edge_u, edge_v: (3,) m in W.
        look: of its texture.
        whole: number of the rectangle of which this is a panel.
        texels_per_m: of its texture.
    """

    corner: Vectors
    edge_u: Vectors
    edge_v: Vectors
    look: Look
    whole: int = 0
    texels_per_m: float = _TEXELS_PER_M[1]

    @property
    def half(self) -> tuple[float, float]:
        """Half sizes along the edges [m]."""
        return 0.5 * float(np.linalg.norm(self.edge_u)), 0.5 * float(np.linalg.norm(self.edge_v))

    @property
    def middle(self) -> Vectors:
        """(3,) m."""
        return self.corner + 0.5 * (self.edge_u + self.edge_v)

    @property
    def area(self) -> float:
        """m^2."""
        return 4.0 * self.half[0] * self.half[1]

    @property
    def upright(self) -> bool:
        """Whether it is a wall."""
        return bool(self.edge_v[2] > 0.0)

    @property
    def R_WS(self) -> Floats:
        """(3, 3), x and y along the edges, z into the air."""
        u, v = self.edge_u / (2.0 * self.half[0]), self.edge_v / (2.0 * self.half[1])
        return np.stack([u, v, np.cross(u, v)], axis=1)

    @property
    def normal(self) -> Vectors:
        """(3,) into the air."""
        return self.R_WS[:, 2]

    @property
    def texels(self) -> tuple[int, int]:
        """Width and height of its texture."""
        u, v = (max(8, round(2.0 * h * self.texels_per_m)) for h in self.half)
        return u, v

    def grid(self, spacing: float) -> tuple[Vectors, tuple[int, int]]:
        """Points (rows * columns, 3) m over the rectangle, v from top to bottom as in an image."""
        rows, columns = (max(2, round(2.0 * h / spacing)) for h in reversed(self.half))
        v, u = np.meshgrid(*((np.arange(n) + 0.5) / n for n in (rows, columns)), indexing="ij")
        at = self.corner + u.reshape(-1, 1) * self.edge_u + (1.0 - v.reshape(-1, 1)) * self.edge_v
        return at + _INWARD * self.normal, (rows, columns)

    def panels(self, way: Vectors) -> list["Surface"]:
        """It, cut where it is long, with texels as they are seen from points (P, 3) m; none given: from near."""
        n, m = (1, 1) if self.look.shines else (_pieces(2.0 * h) for h in self.half)
        u, v = self.edge_u / n, self.edge_v / m
        return [self._panel(self.corner + i * u + j * v, u, v, way) for i in range(n) for j in range(m)]

    def _panel(self, corner: Vectors, u: Vectors, v: Vectors, way: Vectors) -> "Surface":
        ends = np.stack([corner, corner + u + v])
        distance = gaps(way, ends.min(axis=0), ends.max(axis=0)).min() if len(way) else 0.0
        texels_per_m = float(np.clip(_TEXELS_PER_RADIAN / max(distance, 1e-3), *_TEXELS_PER_M))
        return Surface(corner, u, v, self.look, self.whole, texels_per_m)


def _pieces(length: float) -> int:
    return 1 if length <= _LONG else int(np.ceil(length / _PANEL))


def sides(low: Vectors, high: Vectors, looks: tuple[Look, ...], inwards: bool = False) -> list[Surface]:
    """The six sides of a box: +x, -x, +y, -y, +z, -z, with a look each; normals outwards or `inwards`."""
    found = []
    extent = high - low
    for axis in range(3):
        for k, sign in enumerate((1.0, -1.0)):
            normal = (-sign if inwards else sign) * np.eye(3)[axis]
            up = np.eye(3)[1 if axis == 2 else 2]
            v = up * extent
            u = np.cross(up, normal) * extent
            middle = 0.5 * (low + high) + 0.5 * sign * extent * np.eye(3)[axis]
            found.append(Surface(middle - 0.5 * (u + v), u, v, looks[2 * axis + k]))
    return found

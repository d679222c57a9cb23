"""Things that move in front of the cameras: textured, opaque, on paths of their own around the rig.

They are a few metres away, keep their distance from the rig, and go around places that are fixed in the world's
directions. All cameras see the same things, each from where it sits.
"""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.arrays import Floats, Image, Rotations, Vectors
from sim.degrade.sphere import evenly
from sim.degrade.view import STEP, Coarse, Light, View, coarse
from sim.radiance import decode

MOVING_OBJECTS = (0.075, 0.115, 0.16, 0.22, 0.405)
"""Radius of a thing as it is seen [rad], by severity: 5, 13, 25, 45 and 90 % of all directions are covered."""
_THINGS = 40
_NEAREST, _FARTHEST = 1.2, 4.0  # m
_WAY = (0.2, 0.45)  # rad, how far a thing goes from its place
_PACE = (0.3, 0.9)  # rad/s of its way around the place: some 4 to 23 degrees/s as it is seen
_REACH = 1.4  # a thing's outline lies within this many radii
_TEXTURES = 8


@dataclass(frozen=True)
class _Things:
    """All things, in the order from the farthest to the nearest.

    Attributes:
        homes: (N, 3) unit, in W.
        ways: (N, 2) rad, along the two axes across the home.
        paces, phases, spins: (N,) rad/s, rad, rad/s about the line of sight.
        distances: (N,) m from the body.
        looks: (N,) which texture.
    """

    homes: Vectors
    ways: Floats
    paces: Floats
    phases: Floats
    spins: Floats
    distances: Floats
    looks: NDArray[np.int64]

    @staticmethod
    def of(rng: np.random.Generator) -> "_Things":
        return _Things(
            rng.permutation(evenly(_THINGS, rng)),
            rng.uniform(*_WAY, (_THINGS, 2)),
            rng.uniform(*_PACE, _THINGS) * rng.choice([-1.0, 1.0], _THINGS),
            rng.uniform(0.0, 2.0 * np.pi, _THINGS),
            rng.normal(0.0, 0.3, _THINGS),
            np.sort(rng.uniform(_NEAREST, _FARTHEST, _THINGS))[::-1],
            rng.integers(0, _TEXTURES, _THINGS),
        )

    def at(self, t_s: float) -> tuple[Vectors, Rotations]:
        """Where they are: positions (N, 3) m from the body, along W; R_WO (N, 3, 3), z away from the body."""
        across = np.cross(self.homes, np.eye(3)[np.argmin(np.abs(self.homes), axis=1)])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        other = np.cross(self.homes, across)
        angle = self.paces * t_s + self.phases
        a, b = self.ways[:, :1] * np.cos(angle)[:, None], self.ways[:, 1:] * np.sin(angle)[:, None]
        z = self.homes + a * across + b * other
        z /= np.linalg.norm(z, axis=1, keepdims=True)
        x = across - np.sum(across * z, axis=1, keepdims=True) * z
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        y = np.cross(z, x)
        c, s = np.cos(self.spins * t_s)[:, None], np.sin(self.spins * t_s)[:, None]
        R_WO = np.stack([c * x + s * y, c * y - s * x, z], axis=2)
        return self.distances[:, None] * z, R_WO


def moving_objects(view: View, light: Light, severity: int) -> None:
    """Draw the things over the scene, the far ones first."""
    radius = MOVING_OBJECTS[severity - 1]
    things = _things(view.seed)
    p_WO, R_WO = things.at(view.t_s)
    R_WC = view.R_WC(np.zeros(1))[0]
    p_WC = R_WC @ view.mount.R_BC.T @ view.mount.p_BC  # from the body
    p_CO, R_CO = (p_WO - p_WC) @ R_WC, R_WC.T @ R_WO
    grid = coarse(view.mount.camera)
    side = int(np.clip(2.0 * _REACH * radius * view.mount.camera.focal, 48, 512))
    for p, R, distance, look in zip(p_CO, R_CO, things.distances, things.looks, strict=True):
        half = _REACH * float(distance) * float(np.tan(radius))
        box = _box(grid, p, half)
        if box is not None:
            _draw(light, grid, box, p, R, half, _texture(view.seed, int(look), side))


@lru_cache(maxsize=4)
def _things(seed: int) -> _Things:
    return _Things.of(np.random.default_rng((seed, 11)))


def _box(grid: Coarse, p_CO: Vectors, half: float) -> tuple[slice, slice] | None:
    """Rows and columns of pixels in which a thing may be seen; None if it is out of view."""
    away = float(np.linalg.norm(p_CO))
    seen = grid.rays @ (p_CO / away) > np.cos(np.arctan(half * np.sqrt(2.0) / away))
    if not seen.any():
        return None
    sides = []
    for axis, size in ((1, grid.height), (0, grid.width)):
        where = np.flatnonzero(seen.any(axis=axis))
        sides.append(slice(max(0, (int(where[0]) - 2) * STEP), min(size, (int(where[-1]) + 1) * STEP)))
    return None if any(s.start >= s.stop for s in sides) else (sides[0], sides[1])


def _draw(
    light: Light,
    grid: Coarse,
    box: tuple[slice, slice],
    p_CO: Vectors,
    R_CO: Rotations,
    half: float,
    texture: Image,
) -> None:
    """One thing: rays meet its plane, and the texture (side, side, 2) of grey and opacity is looked up there."""
    side = texture.shape[0]
    a = R_CO.T  # rays into O
    c = -a @ p_CO  # the camera in O: a ray meets z = 0 at c - c_z / ray_z * ray
    scale, middle = 0.5 * side / half, 0.5 * (side - 1)
    plane = np.stack(
        [
            scale * (c[0] * a[2] - c[2] * a[0]) + middle * a[2],
            scale * (c[1] * a[2] - c[2] * a[1]) + middle * a[2],
            a[2],
        ]
    )
    at = cv2.transform(grid.all_rays[box], plane.astype(np.float32))
    depth = np.maximum(at[..., 2], np.float32(0.05))  # z is away from the body: what is met lies ahead
    u, v = at[..., 0] / depth, at[..., 1] / depth
    seen = cv2.remap(texture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    opacity = seen[..., 1].astype(np.float32) * np.float32(1.0 / 255.0)
    clear = np.float32(1.0) - opacity
    light.linear[box] *= clear
    light.linear[box] += opacity * decode(np.ascontiguousarray(seen[..., 0]))
    light.held[box] *= clear * clear


@lru_cache(maxsize=4 * _TEXTURES)
def _texture(seed: int, look: int, side: int) -> Image:
    """(side, side, 2) uint8, grey and opacity: patches over each other, within a wavy outline."""
    rng = np.random.default_rng((seed, 13, look))
    full = 512
    grey = np.full((full, full), rng.uniform(60.0, 140.0), dtype=np.uint8)
    for size in 160.0 * 0.97 ** np.arange(90):
        corner, shape = rng.uniform(0.0, full, 2), size * rng.uniform(0.4, 1.0, 2)
        outline = cv2.boxPoints((corner.tolist(), shape.tolist(), float(rng.uniform(0.0, 90.0))))
        cv2.fillConvexPoly(
            grey, np.rint(outline * 16.0).astype(np.int32), float(rng.uniform(30.0, 200.0)), cv2.LINE_AA, 4
        )
    angle = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    radius = np.full(64, 0.5 * full / _REACH)
    for k in (2, 3, 5):
        radius *= 1.0 + 0.1 * np.cos(k * angle + rng.uniform(0.0, 2.0 * np.pi))
    outline = 0.5 * full + np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    opacity = np.zeros_like(grey)
    cv2.fillPoly(opacity, [np.rint(outline * 16.0).astype(np.int32)], 255.0, cv2.LINE_AA, 4)
    texture = cv2.resize(np.stack([grey, opacity], axis=-1), (side, side), interpolation=cv2.INTER_AREA)
    return np.asarray(texture, dtype=np.uint8)

"""A room that can be rendered: a MuJoCo model of textured surfaces with their light baked in."""

from dataclasses import dataclass

import cv2
import mujoco
import numpy as np

from navcore import so3
from navcore.arrays import Floats, Image, Vectors
from sim.radiance import RESPONSE_GAMMA
from sim.world.layout import Layout
from sim.world.lighting import irradiance
from sim.world.texture import dead_leaves

_TEXELS_PER_M = 200.0
_LIGHT_GRID_M = 0.15  # spacing at which light is worked out
_MEAN_RADIANCE = 0.28  # of what saturates the camera
_Z_NEAR, _Z_FAR = 0.05, 60.0  # m


@dataclass(frozen=True)
class Scene:
    """A layout and the model that looks like it; its textures are encoded radiance, no lamp acts on them."""

    layout: Layout
    model: mujoco.MjModel


@dataclass(frozen=True)
class _Surface:
    """A rectangle: middle [m], rotation whose z is the normal, half sizes [m] along its x and y."""

    middle: Vectors
    R_WS: Floats
    half: tuple[float, float]

    @staticmethod
    def of(corner: Vectors, edge_u: Vectors, edge_v: Vectors) -> "_Surface":
        u, v = float(np.linalg.norm(edge_u)), float(np.linalg.norm(edge_v))
        R_WS = np.stack([edge_u / u, edge_v / v, np.cross(edge_u / u, edge_v / v)], axis=1)
        return _Surface(corner + 0.5 * (edge_u + edge_v), R_WS, (0.5 * u, 0.5 * v))

    def grid(self, spacing: float) -> tuple[Vectors, tuple[int, int]]:
        """Points (rows * columns, 3) m over the rectangle, y from top to bottom as in an image."""
        shape = tuple(max(2, round(2.0 * h / spacing)) for h in reversed(self.half))
        y, x = np.meshgrid(*((np.arange(n) + 0.5) / n * 2.0 - 1.0 for n in shape), indexing="ij")
        local = np.stack([x * self.half[0], -y * self.half[1], np.full_like(x, 1e-3)], axis=-1).reshape(-1, 3)
        return self.middle + local @ self.R_WS.T, (shape[0], shape[1])


def build(layout: Layout, rng: np.random.Generator) -> Scene:
    """A scene of a layout, with textures drawn from `rng`."""
    surfaces = [_Surface.of(*r) for r in layout.rectangles()]
    grids = [s.grid(_LIGHT_GRID_M) for s in surfaces]
    points = np.concatenate([p for p, _ in grids])
    normals = np.concatenate([np.tile(s.R_WS[:, 2], (len(p), 1)) for s, (p, _) in zip(surfaces, grids, strict=True)])
    light = irradiance(layout, points, normals)
    spec = mujoco.MjSpec()
    spec.visual.headlight.ambient = [1.0, 1.0, 1.0]
    spec.visual.headlight.diffuse = [0.0, 0.0, 0.0]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.visual.map.znear, spec.visual.map.zfar, spec.stat.extent = _Z_NEAR, _Z_FAR, 1.0
    spec.visual.quality.offsamples = 0
    first = 0
    for k, (surface, (_, shape)) in enumerate(zip(surfaces, grids, strict=True)):
        n = shape[0] * shape[1]
        _add(spec, f"s{k}", surface, _texture(surface, light[first : first + n].reshape(shape), rng))
        first += n
    return Scene(layout, spec.compile())


def _texture(surface: _Surface, light: Floats, rng: np.random.Generator) -> Image:
    width, height = (max(8, round(2.0 * h * _TEXELS_PER_M)) for h in surface.half)
    albedo = dead_leaves(width, height, _TEXELS_PER_M, rng)
    lit = cv2.resize(light.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    radiance = np.clip(albedo * lit * (_MEAN_RADIANCE / 0.5), 0.0, 1.0)
    encoded: Image = np.rint(255.0 * radiance ** (1.0 / RESPONSE_GAMMA)).astype(np.uint8)
    return encoded


def _add(spec: mujoco.MjSpec, name: str, surface: _Surface, texture: Image) -> None:
    height, width = texture.shape
    added = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=width, height=height, nchannel=3)
    added.data = np.repeat(texture[..., None], 3, axis=2).tobytes()
    material = spec.add_material(name=name, texrepeat=[1.0, 1.0], specular=0.0, shininess=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    quaternion_wxyz = np.roll(so3.to_quaternion(surface.R_WS), 1)
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[*surface.half, 0.1],
        pos=surface.middle,
        quat=quaternion_wxyz,
        material=name,
    )

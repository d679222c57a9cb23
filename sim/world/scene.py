"""A world that can be rendered: a MuJoCo model of textured surfaces with their light baked in."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from navcore import so3
from navcore.arrays import Floats, Image, Mask
from sim.errors import ConfigError
from sim.world.layout import Layout
from sim.world.lighting import direct
from sim.world.movers import Mover
from sim.world.painting import Painting
from sim.world.surface import Surface, sides
from sim.world.switches import Switches
from sim.world.texture import paint

_LIGHT_GRID_TEXELS = 30.0  # at which light is worked out
_COARSEST_LIGHT_M = 0.6
_MOST_TEXELS = 60e6  # of all textures: 180 MB; a world that would have more is drawn coarser
_Z_NEAR, _FURTHEST = 0.05, 1.05  # m; of the diagonal
_ONE_PIECE = 100.0  # m; MuJoCo draws a plane as a mesh of this spacing, which costs a sixth of a frame at 0.1
_ROUND = 12  # places on a mover's loop at which its light is averaged


@dataclass(frozen=True)
class Scene:
    """A layout and the model that looks like it; its textures are encoded radiance, no lamp acts on them.

    Attributes:
        layout: what stands still.
        model: geoms are the surfaces; movers are mocap bodies, in order.
        movers: what moves.
        switches: of the lamps, if they are switched.
        paintings: of the textures, in order, kept if the lamps are switched.
    """

    layout: Layout
    model: mujoco.MjModel
    movers: tuple[Mover, ...] = ()
    switches: Switches | None = None
    paintings: tuple[Painting, ...] = ()

    def place(self, data: mujoco.MjData, t_s: float) -> None:
        """Put the movers of a model's data where they are at a time."""
        for k, mover in enumerate(self.movers):
            centre, heading = mover.at(np.array([t_s]))
            data.mocap_pos[k] = centre[0]
            data.mocap_quat[k] = [np.cos(0.5 * heading[0]), 0.0, 0.0, np.sin(0.5 * heading[0])]
        mujoco.mj_kinematics(self.model, data)

    def light(self, t_s: float) -> Mask:
        """(L,), which lamps are on at a time."""
        return np.ones(self.layout.lights, dtype=bool) if self.switches is None else self.switches.on(t_s)

    def relit(self, on: Mask) -> Iterator[tuple[int, Image]]:
        """Id and RGB bytes (n,) of every texture with those lamps on (L,); none if the lamps are not switched.

        They belong at `model.tex_adr[id]` of `model.tex_data`, and then to the GPU by `mjr_uploadTexture`.
        """
        for k, painting in enumerate(self.paintings):
            yield k, painting.texture(on).ravel()


def build(
    layout: Layout,
    rng: np.random.Generator,
    movers: tuple[Mover, ...] = (),
    switches: Switches | None = None,
) -> Scene:
    """A scene of a layout, with textures drawn from `rng`.

    What stands still looks the same with movers or without, and while all lamps are on.

    Args:
        layout: what stands still.
        rng: draws the textures.
        movers: what moves.
        switches: one for each of the layout's lamps; None leaves them on.

    Raises:
        ConfigError: there are not as many switches as lamps.
    """
    if switches is not None and len(switches.on_s) != len(layout.lamp_places):
        raise ConfigError(f"there are {len(switches.on_s)} switches, and {len(layout.lamp_places)} lamps to switch")
    surfaces = _bounded(layout.surfaces)
    lights, unit = _lights(layout, surfaces)
    grounds: dict[int, float] = {}
    paintings, places = [], []
    for surface, light in zip(surfaces, lights, strict=True):
        if surface.whole not in grounds:
            grounds[surface.whole] = rng.uniform(*surface.look.ground)
        albedo = paint(surface, grounds[surface.whole], rng)
        paintings.append(Painting.of(albedo, None if surface.look.shines else light / unit))
        places.append((surface, -1))
    for k, mover in enumerate(movers):
        ground = rng.uniform(*mover.look.ground)
        for surface in _faces(mover):
            light = _passing_light(layout, mover, surface) / unit
            paintings.append(Painting.of(paint(surface, ground, rng), light))
            places.append((surface, k))
    model = _compile(layout, places, len(movers))
    on = np.ones(layout.lights, dtype=bool)
    for address, painting in zip(model.tex_adr, paintings, strict=True):
        rgb = painting.texture(on).ravel()
        model.tex_data[address : address + len(rgb)] = rgb
    kept = tuple(paintings) if switches is not None and len(switches.on_s) > 0 else ()
    return Scene(layout, model, movers, switches if kept else None, kept)


def _bounded(surfaces: tuple[Surface, ...]) -> list[Surface]:
    share = min(1.0, float(np.sqrt(_MOST_TEXELS / sum(np.prod(s.texels) for s in surfaces))))
    return [replace(s, texels_per_m=share * s.texels_per_m) for s in surfaces]


def _lights(layout: Layout, surfaces: list[Surface]) -> tuple[list[Floats], float]:
    """Of each surface (L, rows, columns) by each lamp, and the mean of all lamps together over what does not shine."""
    found: list[Floats] = []
    weighted = area = 0.0
    for surface in surfaces:
        if surface.look.shines:
            found.append(np.zeros(0))
            continue
        points, shape = surface.grid(min(_LIGHT_GRID_TEXELS / surface.texels_per_m, _COARSEST_LIGHT_M))
        light = direct(layout, points, np.tile(surface.normal, (len(points), 1)))
        found.append(light.reshape(-1, *shape))
        weighted += surface.area * float(light.sum(axis=0).mean())
        area += surface.area
    return found, weighted / area if weighted > 0.0 else 1.0


def _faces(mover: Mover) -> list[Surface]:
    """What one sees of a mover, in its own frame: all but its underside."""
    half = np.array(mover.half)
    return sides(-half, half, 6 * (mover.look,))[:-1]


def _passing_light(layout: Layout, mover: Mover, surface: Surface) -> Floats:
    """(L, 1, 1): light on a mover's face, the mean over its loop."""
    centres, headings = mover.at(np.arange(_ROUND) / _ROUND * mover.loop.period_s)
    R_WM = so3.exp(headings[:, None] * [0.0, 0.0, 1.0])
    light = direct(layout, centres + R_WM @ surface.middle, R_WM @ surface.normal)
    mean: Floats = light.mean(axis=1)[:, None, None]
    return mean


def _compile(layout: Layout, places: list[tuple[Surface, int]], movers: int) -> mujoco.MjModel:
    """The model of surfaces in the world (-1) or on a mover, with blank textures."""
    spec = mujoco.MjSpec()
    spec.visual.headlight.ambient = [1.0, 1.0, 1.0]
    spec.visual.headlight.diffuse = [0.0, 0.0, 0.0]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.visual.map.znear, spec.visual.map.zfar = _Z_NEAR, _FURTHEST * layout.diagonal
    spec.stat.extent = 1.0
    spec.visual.quality.offsamples = 0
    bodies = [spec.worldbody.add_body(name=f"mover{k}", mocap=True) for k in range(movers)]
    for k, (surface, carrier) in enumerate(places):
        _add(spec, spec.worldbody if carrier < 0 else bodies[carrier], f"s{k}", surface)
    return spec.compile()


def _add(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, surface: Surface) -> None:
    width, height = surface.texels
    spec.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        width=width,
        height=height,
        nchannel=3,
    )
    material = spec.add_material(name=name, texrepeat=[1.0, 1.0], specular=0.0, shininess=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[*surface.half, _ONE_PIECE],
        pos=surface.middle,
        quat=np.roll(so3.to_quaternion(surface.R_WS), 1),
        material=name,
    )

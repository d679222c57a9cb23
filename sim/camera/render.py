"""Images of a scene through any camera model: fine pinhole renderings, bent through the exact distortion."""

from functools import lru_cache

import cv2
import mujoco
import numpy as np

from navcore.arrays import Floats, Image, Mask
from navcore.camera import Camera
from sim.camera.atlas import Atlas, Pane
from sim.camera.faces import faces_of
from sim.camera.gl import make_context
from sim.radiance import decode
from sim.world.scene import Scene

FINE = 2.0
"""Supersampling: rendered pixels per pixel and axis where the lens spreads most, for a single sharp image."""
COARSE = 1.0
"""The same for sub-frames that are averaged, so that their average takes the place of supersampling."""


@lru_cache(maxsize=4)
def atlases_of(camera: Camera) -> dict[float, Atlas]:
    """By supersampling. They take seconds to make, so those of the last few cameras are kept.

    Raises:
        RenderError: the camera looks too far backwards.
    """
    faces = faces_of(camera)
    return {fine: Atlas(camera, faces, fine) for fine in (COARSE, FINE)}


class SceneCamera:
    """Renders a scene through one camera. Holds an OpenGL context: call `close` when done, or use `with`."""

    def __init__(self, scene: Scene, camera: Camera) -> None:
        """For images of `camera.width` x `camera.height` px.

        Raises:
            RenderError: no OpenGL here, or the camera looks too far backwards.
        """
        self._atlases = atlases_of(camera)
        width, height = (max(getattr(x, side) for x in self._atlases.values()) for side in ("width", "height"))
        self._scene, self._model = scene, scene.model
        self._model.vis.global_.offwidth, self._model.vis.global_.offheight = width, height
        self._pixels = np.empty(width * height * 3, dtype=np.uint8)
        self._gl = make_context(width, height)
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._data, self._option, self._anywhere = mujoco.MjData(self._model), mujoco.MjvOption(), mujoco.MjvCamera()
        self._drawn = mujoco.MjvScene(self._model, maxgeom=self._model.ngeom + 1)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._drawn.flags[flag] = False
        self._lit: Mask | None = None
        mujoco.mj_forward(self._model, self._data)
        self._update()

    def __enter__(self) -> "SceneCamera":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._context.free()
        self._gl.free()

    def linear_image(self, T_WC: Floats, fine: float = FINE, t_s: float = 0.0) -> Image:
        """(height, width) uint16, radiance from 0 to `LINEAR_MAX`, seen from the pose T_WC (4, 4) at a time."""
        atlas = self._atlases[fine]
        self._gl.make_current()
        self._come_to(t_s)
        for pane in atlas.panes:
            self._aim(T_WC, pane)
            rectangle = mujoco.MjrRect(pane.left, pane.bottom, pane.width, pane.height)
            mujoco.mjr_render(rectangle, self._drawn, self._context)
        pixels = self._pixels[: atlas.width * atlas.height * 3].reshape(atlas.height, atlas.width, 3)
        mujoco.mjr_readPixels(pixels, None, mujoco.MjrRect(0, 0, atlas.width, atlas.height), self._context)
        return atlas.bend(decode(cv2.extractChannel(pixels, 0)))

    def _come_to(self, t_s: float) -> None:
        """Bring what moves to where it is at a time, and light what lamps light then."""
        if self._scene.movers:
            self._scene.place(self._data, t_s)
            self._update()
        if self._scene.switches is None:
            return
        lit = self._scene.light(t_s)
        if self._lit is None or np.any(lit != self._lit):
            for texture, rgb in self._scene.relit(lit):
                first = self._model.tex_adr[texture]
                self._model.tex_data[first : first + len(rgb)] = rgb
                mujoco.mjr_uploadTexture(self._model, self._context, texture)
            self._lit = lit

    def _update(self) -> None:
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, self._data, self._option, None, self._anywhere, everything, self._drawn)

    def _aim(self, T_WC: Floats, pane: Pane) -> None:
        depth, extent = self._model.vis.map, self._model.stat.extent
        near, far = extent * depth.znear, extent * depth.zfar
        R_WF = T_WC[:3, :3] @ pane.R_CF
        (left, top), (right, bottom) = near * pane.low, near * pane.high
        for eye in self._drawn.camera:
            eye.pos, eye.forward, eye.up = T_WC[:3, 3], R_WF[:, 2], -R_WF[:, 1]
            eye.frustum_near, eye.frustum_far = near, far
            eye.frustum_center, eye.frustum_width = 0.5 * (left + right), 0.5 * (right - left)
            eye.frustum_bottom, eye.frustum_top = -bottom, -top

"""Images of a scene through any camera model: a fine pinhole rendering, bent through the exact distortion."""

import cv2
import mujoco
import numpy as np

from navcore.arrays import Floats, Image
from navcore.camera import Camera
from sim.camera.gl import make_context
from sim.errors import RenderError
from sim.radiance import decode
from sim.world.scene import Scene

FINE = 1.5
"""Supersampling: rendered pixels per pixel and axis in the middle of the image, for a single sharp image."""
COARSE = 1.0
"""The same for sub-frames that are averaged, so that their average takes the place of supersampling."""
_BENT = 2  # samples per pixel and axis at which the rendering is bent
_MAX_TANGENT = 3.0  # a pinhole rendering reaches no further than 72 degrees from the axis
_NEAR = 0.05  # m


class SceneCamera:
    """Renders a scene through one camera. Holds an OpenGL context: call `close` when done, or use `with`."""

    def __init__(self, scene: Scene, camera: Camera) -> None:
        """For images of `camera.width` x `camera.height` px.

        Raises:
            RenderError: no OpenGL here, or the camera sees further than a pinhole rendering can.
        """
        self._maps = {fine: _PinholeMap(camera, fine) for fine in (COARSE, FINE)}
        widest = self._maps[FINE]
        scene.model.vis.global_.offwidth, scene.model.vis.global_.offheight = widest.width, widest.height
        self._gl = make_context(widest.width, widest.height)
        self._context = mujoco.MjrContext(scene.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        data = mujoco.MjData(scene.model)
        mujoco.mj_forward(scene.model, data)
        self._scene = mujoco.MjvScene(scene.model, maxgeom=scene.model.ngeom + 1)
        option, anywhere = mujoco.MjvOption(), mujoco.MjvCamera()
        mujoco.mjv_updateScene(scene.model, data, option, None, anywhere, mujoco.mjtCatBit.mjCAT_ALL.value, self._scene)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[flag] = False

    def __enter__(self) -> "SceneCamera":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._context.free()
        self._gl.free()

    def linear_image(self, T_WC: Floats, fine: float = FINE) -> Image:
        """(height, width) uint16, radiance from 0 to `LINEAR_MAX`, seen from the pose T_WC (4, 4)."""
        bend = self._maps[fine]
        self._aim(T_WC, bend)
        rectangle = mujoco.MjrRect(0, 0, bend.width, bend.height)
        self._gl.make_current()
        mujoco.mjr_render(rectangle, self._scene, self._context)
        mujoco.mjr_readPixels(bend.pixels, None, rectangle, self._context)
        return bend.apply(decode(cv2.extractChannel(bend.pixels, 0)))

    def _aim(self, T_WC: Floats, bend: "_PinholeMap") -> None:
        for eye in self._scene.camera:
            eye.pos, eye.forward, eye.up = T_WC[:3, 3], T_WC[:3, 2], -T_WC[:3, 1]
            eye.frustum_near, eye.frustum_far = _NEAR, 60.0
            eye.frustum_center, eye.frustum_width = 0.0, _NEAR * bend.half_width
            eye.frustum_bottom, eye.frustum_top = -_NEAR * bend.half_height, _NEAR * bend.half_height


class _PinholeMap:
    """Where the pixels of a camera lie in a symmetric pinhole image that covers its whole field of view."""

    def __init__(self, camera: Camera, fine: float) -> None:
        self._size = (camera.width, camera.height)
        samples = _BENT if fine > 1.0 else 1
        u, v = ((np.arange(n * samples) + 0.5) / samples - 0.5 for n in self._size)
        rays = camera.unproject(np.stack(np.meshgrid(u, v), axis=-1))
        tangent = rays[..., :2] / np.maximum(rays[..., 2:], 1e-6)
        reach = np.abs(tangent).max(axis=(0, 1))
        if not np.all(reach < _MAX_TANGENT):
            raise RenderError(f"the camera sees tangents up to {reach.max():.1f}; rendering covers {_MAX_TANGENT}")
        focal = fine * camera.focal
        self.width, self.height = (2 * int(np.ceil(r * focal + 2.0)) for r in reach)
        self.half_width, self.half_height = 0.5 * self.width / focal, 0.5 * self.height / focal
        self.pixels = np.empty((self.height, self.width, 3), dtype=np.uint8)
        x = tangent[..., 0] * focal + 0.5 * (self.width - 1)
        y = 0.5 * (self.height - 1) - tangent[..., 1] * focal  # OpenGL's first row is the lowest
        self._map = cv2.convertMaps(x.astype(np.float32), y.astype(np.float32), cv2.CV_16SC2)

    def apply(self, image: Image) -> Image:
        """The pinhole image as the camera sees it: bent, then averaged over each pixel."""
        bent = cv2.remap(image, *self._map, cv2.INTER_LINEAR)
        whole = (bent.shape[1], bent.shape[0]) == self._size
        seen = bent if whole else cv2.resize(bent, self._size, interpolation=cv2.INTER_AREA)
        return np.asarray(seen)

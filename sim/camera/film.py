"""Films a motion: every frame of every camera, rendered when it is asked for."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from navcore.arrays import Image, Stamps
from navcore.calibration import Calibration
from navcore.sequence import Frame
from sim.camera.exposure import EXPOSURE_S, Shutter
from sim.camera.render import SceneCamera
from sim.camera.sensor import ImageSensor
from sim.degrade.schedule import Schedule
from sim.motion import Motion
from sim.world.scene import Scene

Progress = Callable[[int, int], None]
"""Called with the number of images done and of all."""


class Film:
    """The frames of a motion through a scene. Holds OpenGL contexts: call `close` when done, or use `with`.

    What happens to vision inside the camera is rendered here (`motion_blur`); all that can be done to an
    image afterwards is done by `sim.degrade`. The noise of a frame depends on the generator, its camera and
    its place alone: a schedule changes no frame that it does not speak of.
    """

    def __init__(
        self,
        motion: Motion,
        calibration: Calibration,
        scene: Scene,
        stamps: Stamps,
        schedule: Schedule,
        rng: np.random.Generator,
    ) -> None:
        """For frames at stamps (N,) ns of the cameras; `rng` draws the sensors and their noise.

        Raises:
            RenderError: no OpenGL here, or a camera that cannot be rendered.
        """
        self._motion, self._scene, self._schedule = motion, scene, schedule
        self._mounts, self._stamps = calibration.cameras, stamps
        self._cameras: dict[int, SceneCamera] = {}
        self._sensors, self._seeds = [], []
        for mount, seed in zip(self._mounts, _seeds(rng, len(self._mounts)), strict=True):
            sensor_seed, *frame_seeds = seed.spawn(1 + len(stamps))
            sensor_rng = np.random.default_rng(sensor_seed)
            self._sensors.append(ImageSensor.of(mount.camera.width, mount.camera.height, sensor_rng))
            self._seeds.append(frame_seeds)

    def __enter__(self) -> "Film":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the OpenGL contexts back; frames that were not loaded can no longer be."""
        for camera in self._cameras.values():
            camera.close()
        self._cameras.clear()

    @property
    def frames(self) -> tuple[Frame, ...]:
        """All frames; an image is rendered when it is loaded."""
        cameras = range(len(self._mounts))
        return tuple(
            Frame(t_ns, {c: RenderedImage(self, c, k) for c in cameras}) for k, t_ns in enumerate(self._stamps.tolist())
        )

    def image(self, camera: int, index: int) -> Image:
        """(height, width) uint8: frame `index` of a camera."""
        if camera not in self._cameras:
            self._cameras[camera] = SceneCamera(self._scene, self._mounts[camera].camera)
        t_ns = int(self._stamps[index])
        severity = self._schedule.severity("motion_blur", (t_ns - int(self._stamps[0])) * 1e-9)
        shutter = Shutter(self._motion, self._mounts[camera], self._scene.layout, self._scene.movers)
        linear = shutter.expose(self._cameras[camera], t_ns, EXPOSURE_S[severity])
        rng = np.random.default_rng(self._seeds[camera][index])
        return self._sensors[camera].develop(linear, 1.0, rng)


@dataclass(frozen=True)
class RenderedImage:
    """An image that is rendered when it is asked for, while its film is open."""

    film: Film
    camera: int
    index: int
    exposed: ClassVar[bool] = True  # its shutter was open for a time: it must not be blurred once more

    def load(self) -> Image:
        """(height, width) uint8."""
        return self.film.image(self.camera, self.index)


def _seeds(rng: np.random.Generator, n: int) -> list[np.random.SeedSequence]:
    sequence = rng.bit_generator.seed_seq
    assert isinstance(sequence, np.random.SeedSequence)
    return sequence.spawn(n)

"""Films a motion: every frame of every camera through exposure, degradation and sensor, to disk."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from navcore.arrays import Image, Stamps
from navcore.calibration import Calibration
from sim import asl
from sim.camera import SceneCamera
from sim.exposure import EXPOSURE_S, Shutter
from sim.motion import Motion
from sim.scene import Scene
from sim.schedule import Schedule
from sim.sensor import ImageSensor, light_at

Progress = Callable[[int, int], None]
"""Called with the number of images done and of all."""

_BEHIND = 8  # images that may wait to be developed while the next ones are rendered


@dataclass(frozen=True)
class Film:
    """What is filmed, and what happens to vision meanwhile."""

    motion: Motion
    calibration: Calibration
    scene: Scene
    schedule: Schedule

    def shoot(self, folder: Path, stamps: Stamps, rng: np.random.Generator, progress: Progress | None = None) -> None:
        """Write `camN/data/*.png` and `camN/data.csv` for frames at stamps (N,).

        A frame's noise depends on the generator and its place alone: another schedule changes no clean frame.

        Raises:
            RenderError: no OpenGL here, or a camera that cannot be rendered.
        """
        cameras = self.calibration.cameras
        for index in range(len(cameras)):
            sensor_rng, *frame_rngs = rng.spawn(1 + len(stamps))
            sensor = ImageSensor.of(cameras[index].camera.width, cameras[index].camera.height, sensor_rng)
            waiting: deque[Future[None]] = deque()
            with SceneCamera(self.scene, cameras[index].camera) as camera, ThreadPoolExecutor(1) as darkroom:
                for k, t_ns in enumerate(stamps.tolist()):
                    since_s = (t_ns - int(stamps[0])) * 1e-9
                    linear, light = self._light(camera, index, t_ns, since_s)
                    job = (folder, index, t_ns, linear, light, sensor, frame_rngs[k])
                    waiting.append(darkroom.submit(_develop, *job))
                    if len(waiting) > _BEHIND:
                        waiting.popleft().result()
                    if progress is not None:
                        progress(index * len(stamps) + k + 1, len(cameras) * len(stamps))
                for future in waiting:
                    future.result()
            asl.write_image_list(folder, index, stamps)

    def _light(self, camera: SceneCamera, index: int, t_ns: int, since_s: float) -> tuple[Image, float]:
        """What reaches the sensor `since_s` after the first frame: (height, width) uint16, and its share."""
        mount, schedule = self.calibration.cameras[index], self.schedule
        light = light_at(schedule.severity("low_light", since_s), schedule.severity("blackout", since_s) > 0)
        if light == 0.0:
            return np.zeros((mount.camera.height, mount.camera.width), dtype=np.uint16), light
        shutter = Shutter(self.motion, mount, self.scene.layout)
        exposure_s = EXPOSURE_S[schedule.severity("motion_blur", since_s)]
        return shutter.expose(camera, t_ns, exposure_s), light


def _develop(
    folder: Path,
    index: int,
    t_ns: int,
    linear: Image,
    light: float,
    sensor: ImageSensor,
    rng: np.random.Generator,
) -> None:
    asl.write_image(folder, index, t_ns, sensor.develop(linear, light, rng))

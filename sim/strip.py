"""One view of a flight under every degradation: a picture to look at."""

from pathlib import Path

import cv2
import numpy as np

from navcore.arrays import Image
from sim.camera import SceneCamera
from sim.errors import ConfigError
from sim.exposure import EXPOSURE_S, Shutter
from sim.imu import grade
from sim.motion import EPOCH_NS, Motion
from sim.platforms import simulate_motion
from sim.points import IMU_GRADE
from sim.rig import euroc_like
from sim.scene import room
from sim.schedule import MAX_SEVERITY
from sim.sensor import ImageSensor, light_at
from sim.streams import Streams

_SECONDS = 30.0
_SMALL = (225, 144)  # px of one view in the picture


def strip(out: Path, seed: int = 1) -> None:
    """Write a PNG of two rows, low light and motion blur, each from clean to the worst severity.

    Raises:
        ConfigError: the folder of `out` is missing.
        RenderError: no OpenGL here.
    """
    if not out.parent.is_dir():
        raise ConfigError(f"{out.parent}: no such folder")
    motion = simulate_motion("quadrotor", _SECONDS, seed)
    mount = euroc_like(grade(IMU_GRADE).noise).cameras[0]
    streams = Streams.of(seed)
    scene = room(streams.world)
    sensor = ImageSensor.of(mount.camera.width, mount.camera.height, streams.vision)
    shutter = Shutter(motion, mount, scene.layout)
    t_ns = _fastest(motion)
    with SceneCamera(scene, mount.camera) as camera:
        sharp = shutter.expose(camera, t_ns, 0.0)
        blurred = [shutter.expose(camera, t_ns, s) for s in EXPOSURE_S]
    severities = range(MAX_SEVERITY + 1)
    dark_row = [sensor.develop(sharp, light_at(k, dark=False), streams.vision) for k in severities]
    blur_row = [sensor.develop(image, 1.0, streams.vision) for image in blurred]
    rows = [
        np.hstack([_labelled(im, f"{name} {k}") for k, im in enumerate(row)])
        for name, row in (("low_light", dark_row), ("motion_blur", blur_row))
    ]
    done, data = cv2.imencode(".png", np.vstack(rows), (cv2.IMWRITE_PNG_COMPRESSION, 9))
    assert done
    out.write_bytes(data.tobytes())


def _fastest(motion: Motion) -> int:
    """When, well inside the flight, the body turns fastest [ns]."""
    rate = np.linalg.norm(motion.omega_B, axis=1)
    inside = slice(round(8.0 / motion.step_s), -round(1.0 / motion.step_s))
    k = int(np.argmax(rate[inside])) + inside.start
    return EPOCH_NS + round(k * motion.step_s * 1e9)


def _labelled(image: Image, text: str) -> Image:
    small = cv2.resize(image, _SMALL, interpolation=cv2.INTER_AREA)
    text = "clean" if text.endswith(" 0") else text
    for colour, shift in ((0, 1), (255, 0)):
        place = (6 + shift, 16 + shift)
        cv2.putText(small, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
    return np.asarray(small, dtype=np.uint8)

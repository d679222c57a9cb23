"""Degradations applied to any recording with images: each image when it is loaded."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from zlib import crc32

import numpy as np

from navcore.arrays import Image, Vectors
from navcore.sequence import Frame, ImageSource, Sequence
from sim.camera.sensor import ImageSensor
from sim.degrade import exposure
from sim.degrade.attitude import Attitude
from sim.degrade.blur import motion_blur
from sim.degrade.codec import jpeg
from sim.degrade.dirt import lens_dirt
from sim.degrade.exposure import Exposure
from sim.degrade.fog import fog
from sim.degrade.lamps import light_switch
from sim.degrade.movers import moving_objects
from sim.degrade.schedule import CODEC, KINDS, STREAM, Degradation, Schedule
from sim.degrade.stream import restream
from sim.degrade.texture import texture_loss
from sim.degrade.view import Light, View
from sim.errors import ConfigError

_OF_FRAME, _OF_SENSOR = (crc32(what) for what in (b"frame", b"sensor"))  # keep random streams apart
_IMAGE_KINDS = tuple(kind for kind in KINDS if kind not in STREAM)

_LIGHT: dict[str, Callable[[View, Light, Degradation], None]] = {
    "texture_loss": lambda _, light, d: texture_loss(light, d.severity),
    "light_switch": light_switch,
    "moving_objects": lambda view, light, d: moving_objects(view, light, d.severity),
    "fog": lambda view, light, d: fog(view, light, d.severity),
    "motion_blur": lambda view, light, d: motion_blur(view, light, d.severity),
    "lens_dirt": lambda view, light, d: lens_dirt(view, light, d.severity),
}
"""What changes the light, in the order in which light meets it."""

_EXPOSURE: dict[str, Callable[[View, Degradation], Exposure]] = {
    "low_light": lambda _, d: exposure.low_light(d.severity),
    "overexposure": lambda _, d: exposure.overexposure(d.severity),
    "auto_exposure": exposure.auto_exposure,
    "blackout": lambda _view, _d: exposure.COVERED,
}
"""What changes how much the sensor gets."""


def degrade_sequence(sequence: Sequence, schedule: Schedule, seed: int = 1) -> Sequence:
    """A recording whose images are degraded as a schedule says; frames of which it says nothing stay as they are.

    Args:
        sequence: real or rendered, with images; with tracks alone if only frames and stamps are degraded.
        schedule: times count from its first frame.
        seed: fixes all that is random; a frame's draw does not depend on the schedule.

    Raises:
        ConfigError: the schedule reaches beyond the recording, there are no images to degrade, or the images are
            rendered and the camera had to do it (`Schedule.in_camera`).
    """
    if not schedule.degradations:
        return sequence
    if not sequence.frames:
        raise ConfigError(f"{sequence.name} has no frames to degrade")
    schedule.check((sequence.frames[-1].t_ns - sequence.frames[0].t_ns) * 1e-9)
    on_images = schedule.only(_IMAGE_KINDS)
    frames = tuple(sequence.frames)
    if on_images.degradations:
        _check_images(sequence, on_images)
        frames = tuple(_degraded(sequence, on_images, seed))
    return replace(sequence, frames=restream(frames, schedule, seed))


def _check_images(sequence: Sequence, schedule: Schedule) -> None:
    sources = [source for frame in sequence.frames for source in frame.images.values()]
    if not sources:
        raise ConfigError(f"{sequence.name} has no images; without them only {', '.join(STREAM)} can be done")
    # An image that says it was exposed by a simulated shutter must not be blurred once more.
    if schedule.in_camera.degradations and any(getattr(source, "exposed", False) for source in sources):
        raise ConfigError(f"{schedule.in_camera} belongs into the rendering of these images: Schedule.in_camera")


def _degraded(sequence: Sequence, schedule: Schedule, seed: int) -> Iterator[Frame]:
    attitude = Attitude.of(sequence.imu, gyro_bias(sequence))
    for index, frame in enumerate(sequence.frames):
        t_s = (frame.t_ns - sequence.frames[0].t_ns) * 1e-9
        found = (schedule.worst(kind, t_s) for kind in _IMAGE_KINDS)
        active = tuple(d for d in found if d is not None)
        if not active:
            yield frame
            continue
        images = {}
        for camera, source in frame.images.items():
            mount = sequence.calibration.cameras[camera]
            images[camera] = DegradedImage(source, View(seed, camera, index, t_s, frame.t_ns, mount, attitude), active)
        yield replace(frame, images=images)


def gyro_bias(sequence: Sequence) -> Vectors | None:
    """(N, 3) rad/s at the IMU's stamps, where truth knows it."""
    truth = sequence.truth
    if truth is None or truth.b_g is None:
        return None
    known = np.isfinite(truth.b_g).all(axis=1)
    if not known.any():
        return None
    t_s, at_s = ((t - sequence.imu.t_ns[0]) * 1e-9 for t in (sequence.imu.t_ns, truth.t_ns[known]))
    return np.stack([np.interp(t_s, at_s, b) for b in truth.b_g[known].T], axis=1)


@dataclass(frozen=True)
class DegradedImage:
    """An image that is degraded when it is asked for."""

    source: ImageSource
    view: View
    active: tuple[Degradation, ...]

    def load(self) -> Image:
        """(height, width) uint8."""
        by_kind = {d.kind: d for d in self.active}
        image = self.source.load()
        if by_kind.keys() - CODEC:
            image = self._exposed(image, by_kind)
        return jpeg(image, by_kind["jpeg"].severity) if "jpeg" in by_kind else image

    def _exposed(self, image: Image, by_kind: dict[str, Degradation]) -> Image:
        view, light = self.view, Light.of(image)
        for kind, change in _LIGHT.items():
            if kind in by_kind:
                change(view, light, by_kind[kind])
        total = Exposure()
        for kind, expose in _EXPOSURE.items():
            if kind in by_kind:
                total = total.and_then(expose(view, by_kind[kind]))
        height, width = image.shape
        rng = np.random.default_rng((view.seed, _OF_FRAME, view.camera, view.index))
        return _sensor(width, height, view.seed, view.camera).develop(
            light.linear, total.light, rng, total.gain, light.held
        )


@lru_cache(maxsize=8)
def _sensor(width: int, height: int, seed: int, camera: int) -> ImageSensor:
    return ImageSensor.of(width, height, np.random.default_rng((seed, _OF_SENSOR, camera)))

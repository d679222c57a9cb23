"""Recordings of a study that lie in folders, and what is done to the images of any of them."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eval.cells import Cost, Source
from eval.errors import StudyError
from eval.flights import IMAGE_RUN_S, Flight, PointsFlight, RenderedFlight
from navcore.readers import open_sequence
from navcore.sequence import ImageFile, Sequence
from sim.degrade import Schedule, degrade_sequence
from sim.degrade.schedule import Degradation

_DEGRADE_S = 0.006  # CPU seconds a frame, at most


@dataclass(frozen=True)
class Recording:
    """A recording on disk, as `navcore.readers` knows it.

    Attributes:
        path: where it is, for all workers.
        frames: how many it has, for what it costs.
        digest: of its stamps, IMU samples, calibration and truth, and of the sizes of its images' files: another
            recording in the same place is another one.
    """

    path: str
    frames: int
    digest: str

    @staticmethod
    def of(path: Path, sequence: Sequence) -> "Recording":
        """The one that was read from there."""
        digest = hashlib.sha256(np.array([f.t_ns for f in sequence.frames], dtype=np.int64).tobytes())
        imu, truth = sequence.imu, sequence.truth
        told = () if truth is None else (truth.t_ns, truth.p_WB, truth.q_WB, truth.v_WB, truth.b_g, truth.b_a)
        for values in (imu.t_ns, imu.gyro, imu.accel, *told):
            digest.update(b"" if values is None else values.tobytes())
        digest.update(repr(sequence.calibration.imu).encode())
        for mount in sequence.calibration.cameras:
            digest.update(mount.T_BC.tobytes() + repr((mount.camera, mount.dt_cam_imu)).encode())
        digest.update(np.array(_sizes(sequence), dtype=np.int64).tobytes())
        return Recording(str(path.resolve()), len(sequence.frames), digest.hexdigest()[:12])

    @property
    def name(self) -> str:
        """The folder's name."""
        path = Path(self.path)
        return path.parent.name if path.name == "mav0" else path.name

    @property
    def cost(self) -> Cost:
        """It is there already."""
        return Cost(0.0, 0.5, IMAGE_RUN_S * self.frames)

    def load(self, workspace: Path) -> Sequence:
        """Read it."""
        return open_sequence(Path(self.path))


@dataclass(frozen=True)
class Degraded:
    """The images of another source, degraded when they are loaded; nothing is kept twice.

    Attributes:
        clean: the source.
        degrade: what is done to its images, as `Schedule.parse` reads it.
        seed: of all that is random about it.
    """

    clean: "RenderedFlight | Recording"
    degrade: str
    seed: int

    @property
    def name(self) -> str:
        """The clean recording's."""
        return self.clean.name

    @property
    def cost(self) -> Cost:
        """That of the clean one, and the degrading."""
        clean = self.clean.cost
        return replace(clean, run_s=clean.run_s * (1.0 + _DEGRADE_S / IMAGE_RUN_S))

    def load(self, workspace: Path) -> Sequence:
        """Read it and wrap its images."""
        return degrade_sequence(self.clean.load(workspace), Schedule.parse(self.degrade), self.seed)


def _sizes(sequence: Sequence) -> list[int]:
    """Bytes of the file of every image that is one, which are known without reading it; -1 of one that is gone."""
    images = (x for frame in sequence.frames for _, x in sorted(frame.images.items()) if isinstance(x, ImageFile))
    return [x.path.stat().st_size if x.path.is_file() else -1 for x in images]


def rendered(flight: Flight, degrade: str) -> RenderedFlight | Degraded:
    """A flight with images: what happens inside the camera is rendered, the rest is done to its images."""
    schedule = Schedule.parse(degrade)
    film = RenderedFlight.of(flight, str(schedule.in_camera))
    after = str(schedule.after_camera)
    return Degraded(film, after, flight.seed) if after else film


def to_render(source: Source) -> RenderedFlight | None:
    """What has to be rendered before a source can be loaded, None if nothing."""
    inner = source.clean if isinstance(source, Degraded) else source
    return inner if isinstance(inner, RenderedFlight) else None


def degradations(source: Source) -> tuple[Degradation, ...]:
    """All that happens to the vision of a source."""
    within = degradations(source.clean) if isinstance(source, Degraded) else ()
    own = source.degrade if isinstance(source, Degraded | RenderedFlight | PointsFlight) else ""
    return (*within, *Schedule.parse(own).degradations)


def restored(content: Mapping[str, Any]) -> Any:
    """The source that `eval.cells.described` described.

    Raises:
        StudyError: it is of a kind that is not from here.
    """
    kinds = {kind.__name__: kind for kind in (Flight, PointsFlight, RenderedFlight, Recording, Degraded)}
    parts = dict(content)
    kind = str(parts.pop("kind"))
    if kind not in kinds:
        raise StudyError(f"source {kind!r} is unknown; known are {', '.join(kinds)}")
    return kinds[kind](**{k: restored(v) if isinstance(v, dict) else v for k, v in parts.items()})

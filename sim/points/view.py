"""A rig on its way through the world: where its images put a point, and which landmarks are in them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from navcore.arrays import Floats, Mask, Pixels, Rotations, Stamps, Vectors
from navcore.calibration import Calibration
from navcore.trajectory import Trajectory
from sim.points.outline import Outline

_MIN_DEPTH = 0.2  # m
_CHUNK = 8  # frames
_BORDER = 4.0  # px that a tracker needs around a feature
_SURFACE = 0.03  # m, how much nearer than a landmark a ray must end for the landmark to be hidden


@dataclass(frozen=True)
class Seen:
    """What camera 0 makes of a set of L points in one frame; single precision, for choosing what to follow.

    Attributes:
        may: (L,), whether a point may be seen.
        which: (K,) the points that are in the image.
        cells: (K,) their cells of the image, as `Outline` numbers them.
    """

    may: Mask
    which: Stamps
    cells: Stamps


@dataclass(frozen=True)
class View:
    """Poses of a rig's cameras at the frames.

    Attributes:
        calibration: of the rig.
        poses: of the body at the F frames.
    """

    calibration: Calibration
    poses: Trajectory

    def pixels(self, frame: int, camera: int, p_WF: Vectors) -> tuple[Pixels, Mask]:
        """Pixels (K, 2) of points (K, 3) m in W in one image, and whether a tracker can see them there (K,)."""
        p_CF = (p_WF - self.p_WC[camera][frame]) @ self.R_WC[camera][frame]
        model = self.calibration.cameras[camera].camera
        uv = model.project(p_CF)
        return uv, model.unfolded(p_CF) & model.inside(uv, _BORDER)

    @cached_property
    def R_WC(self) -> list[Rotations]:
        """By camera, (F, 3, 3)."""
        R_WB = self.poses.R_WB
        return [R_WB @ mount.R_BC for mount in self.calibration.cameras]

    @cached_property
    def p_WC(self) -> list[Vectors]:
        """By camera, (F, 3) m."""
        R_WB = self.poses.R_WB
        return [self.poses.p_WB + R_WB @ mount.p_BC for mount in self.calibration.cameras]

    @cached_property
    def outline(self) -> Outline:
        """Of camera 0's image."""
        return Outline.of(self.calibration.cameras[0].camera)

    def chunks(self) -> Iterator[slice]:
        """The frames, a few at once."""
        for first in range(0, len(self.poses), _CHUNK):
            yield slice(first, min(first + _CHUNK, len(self.poses)))

    def look(self, frames: slice, points: Vectors, normals: Vectors) -> "Looked":
        """At points on surfaces with normals, both (L, 3) if they stand still or (F, L, 3)."""
        R_WC, p_WC = _coarse(self.R_WC[0][frames]), _coarse(self.p_WC[0][frames])
        p_CF = points @ R_WC - (p_WC[:, None, :] @ R_WC)
        height = (normals @ p_WC[..., None])[..., 0] - np.einsum("...i,...i", points, normals)
        may = (p_CF[..., 2] > _MIN_DEPTH) & (height > 0.0)
        frame, which = np.nonzero(may)
        may[frame, which], cell = self.outline.look_up(p_CF[frame, which])
        return Looked(may, frame[cell >= 0], which[cell >= 0], cell[cell >= 0])


@dataclass(frozen=True)
class Looked:
    """What `Seen` says, for F frames at once: `may` (F, L); frame, point and cell (K,) of what is in the images."""

    may: Mask
    frame: Stamps
    which: Stamps
    cells: Stamps

    def but(self, hidden: Mask) -> Iterator[Seen]:
        """Frame by frame, without the points that are hidden (F, L) or, in all frames, (L,)."""
        may = self.may & ~hidden
        seen = may[self.frame, self.which]
        which, cells = self.which[seen], self.cells[seen]
        edges = np.searchsorted(self.frame[seen], np.arange(len(may) + 1)).tolist()
        for k, (begin, end) in enumerate(pairwise(edges)):
            yield Seen(may[k], which[begin:end], cells[begin:end])


@dataclass(frozen=True)
class Landmarks:
    """Points that stand still.

    Attributes:
        view: who looks at them.
        points: (L, 3) m in W.
        normals: (L, 3) of the surfaces they are on; a point is seen from that side only.
        free_way: (N,) m, how far rays from (N, 3) m along unit directions (N, 3) go until they hit anything.
    """

    view: View
    points: Vectors
    normals: Vectors
    free_way: Callable[[Vectors, Vectors], Floats]

    def seen(self) -> Iterator[Seen]:
        """Frame by frame. What stands in the way is looked up once for 8 frames (.4 s at 20 Hz), from camera 0."""
        points, normals = _coarse(self.points), _coarse(self.normals)
        for frames in self.view.chunks():
            looked = self.view.look(frames, points, normals)
            yield from looked.but(self._hidden((frames.start + frames.stop) // 2, np.unique(looked.which)))

    def positions(self, which: Stamps) -> Vectors:
        """(K, 3) m in W."""
        return self.points[which]

    def _hidden(self, frame: int, which: Stamps) -> Mask:
        """(L,): those of `which` that something stands before."""
        # Coordinate by coordinate in memory: what reduces over the three axes of many rays is then twice as fast.
        start = np.repeat(self.view.p_WC[0][frame][:, None], len(which), axis=1)
        towards = self.points[which].T - start
        distance = np.sqrt(np.einsum("ij,ij->j", towards, towards))
        hidden = np.zeros(len(self.points), dtype=bool)
        hidden[which] = self.free_way(start.T, (towards / distance).T) < distance - _SURFACE
        return hidden


def _coarse(values: Floats) -> Any:
    return values.astype(np.float32)

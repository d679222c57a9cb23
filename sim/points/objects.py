"""Things that move through the view: rigid bodies whose points are followed like any others, and mislead."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Mask, Stamps, Vectors
from sim.points.view import Seen, View

_OBJECTS = 8
_POINTS = 60  # on each
_RADII = (0.2, 0.6)  # m
_NEAR, _FAR = 1.0, 3.5  # m, where they appear before the camera
_FREE_SHARE = 0.7  # of the way to what is behind
_SPEED = (0.3, 1.5)  # m/s
_SWAY = (0.05, 0.25)  # m, amplitude
_SWAY_RATE = (1.0, 4.0)  # rad/s
_TURN = 0.8  # rad/s, sd, about the vertical
_LIFE_S = 8.0  # after which an object leaves, seen or not


@dataclass
class Objects:
    """Ellipsoids that drift, sway and turn smoothly; one that has left the view comes back as another.

    Attributes:
        view: who looks at them.
        free_way: as in `Landmarks`; objects appear between the camera and what is behind.
        rng: draws them.
    """

    view: View
    free_way: Callable[[Vectors, Vectors], Floats]
    rng: np.random.Generator
    _where: Vectors = field(init=False, repr=False)  # (F, O P, 3) m in W, of the frames looked at last
    _first: int = field(init=False, repr=False)  # of them

    def seen(self) -> Iterator[Seen]:
        """Frame by frame. Objects leave and appear every 8 frames; a new one can be followed from its second on."""
        t_s = (self.view.poses.t_ns - self.view.poses.t_ns[0]) * 1e-9
        bodies = self._appear(_OBJECTS, 0, 0.0)
        gone = np.zeros(_OBJECTS, dtype=bool)
        for frames in self.view.chunks():
            self._first, start_s = frames.start, float(t_s[frames.start])
            if frames.start > 0:
                gone = (start_s - bodies.since_s > _LIFE_S) | ~self._in_view(
                    frames.start, bodies.centres(t_s[frames.start : frames.start + 1])[0]
                )
                bodies.replace(gone, self._appear(int(np.count_nonzero(gone)), frames.start, start_s))
            self._where, normals = bodies.place(t_s[frames])
            hidden = np.zeros(self._where.shape[:2], dtype=bool)
            hidden[0] = np.repeat(gone, _POINTS)
            yield from self.view.look(frames, self._where, normals).but(hidden)

    def positions(self, frame: int, which: Stamps) -> Vectors:
        """(K, 3) m in W, of points (K,) in the frame that was yielded last."""
        positions: Vectors = self._where[frame - self._first, which]
        return positions

    def _in_view(self, frame: int, centres: Vectors) -> Mask:
        p_CO = (centres - self.view.p_WC[0][frame]) @ self.view.R_WC[0][frame]
        in_front: Mask = p_CO[:, 2] > 0.5 * _NEAR
        in_front[in_front] = self.view.outline.look_up(p_CO[in_front])[0]
        return in_front

    def _appear(self, n: int, frame: int, t_s: float) -> "_Bodies":
        """Bodies anywhere in the image."""
        rng, model = self.rng, self.view.calibration.cameras[0].camera
        uv = rng.uniform(0.1, 0.9, (n, 2)) * [model.width, model.height]
        rays = model.unproject(uv) @ self.view.R_WC[0][frame].T
        start = np.repeat(self.view.p_WC[0][frame][None], n, axis=0)
        free = _FREE_SHARE * self.free_way(start, rays)
        distance = np.maximum(0.6 * _NEAR, np.minimum(rng.uniform(_NEAR, _FAR, n), free))[:, None]
        radii = rng.uniform(*_RADII, (n, 3)) * np.minimum(1.0, 0.5 * distance)
        heading = rng.standard_normal((n, 3)) * [1.0, 1.0, 0.3]
        ball = rng.standard_normal((n, _POINTS, 3))
        ball /= np.linalg.norm(ball, axis=2, keepdims=True)
        return _Bodies(
            since_s=np.full(n, t_s),
            start=start + distance * rays,
            velocity=rng.uniform(*_SPEED, (n, 1)) * heading / np.linalg.norm(heading, axis=1, keepdims=True),
            sway=rng.uniform(*_SWAY, (n, 3)),
            sway_rate=rng.uniform(*_SWAY_RATE, (n, 3)),
            turn_rate=_TURN * rng.standard_normal(n),
            points=ball * radii[:, None],
            normals=ball / radii[:, None],
        )


@dataclass(frozen=True)
class _Bodies:
    """O objects: `points` and outward `normals` (O, P, 3) about their centres, and how each moves from `since_s` on."""

    since_s: Floats
    start: Vectors
    velocity: Vectors
    sway: Vectors
    sway_rate: Vectors
    turn_rate: Floats
    points: Vectors
    normals: Vectors

    def replace(self, gone: Mask, others: "_Bodies") -> None:
        """Put others in the place of those that are gone."""
        for name, values in vars(self).items():
            values[gone] = getattr(others, name)

    def centres(self, t_s: Floats) -> Vectors:
        """(F, O, 3) m in W at times (F,)."""
        tau = (t_s[:, None] - self.since_s)[..., None]
        centres: Vectors = self.start + self.velocity * tau + self.sway * np.sin(self.sway_rate * tau)
        return centres

    def place(self, t_s: Floats) -> tuple[Vectors, Vectors]:
        """Points (F, O P, 3) m and normals (F, O P, 3), not of unit length, in W at times (F,)."""
        angle = self.turn_rate * (t_s[:, None] - self.since_s)
        R_OW = so3.exp(angle[..., None] * [0.0, 0.0, -1.0])
        points = self.centres(t_s)[:, :, None] + self.points @ R_OW
        return points.reshape(len(t_s), -1, 3), (self.normals @ R_OW).reshape(len(t_s), -1, 3)

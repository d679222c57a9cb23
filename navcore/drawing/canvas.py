"""Draws a run frame by frame: images with tracks, path with its spread, biases with theirs, health."""

import logging
from collections import deque
from collections.abc import Mapping

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Rotations, Vectors
from navcore.calibration import Calibration
from navcore.drawing import paths
from navcore.drawing.sdk import rr
from navcore.errors import DataError
from navcore.odometry import BLOCKS, Estimate, Health, State
from navcore.sequence import Frame, Tracks
from navcore.trajectory import Trajectory

_LOG = logging.getLogger(__name__)
_SIGMAS = 3.0  # of all spreads
_TAIL = 8  # frames of a track that are shown
_MATURE = 20  # frames after which a track has the colour of an old one
_JPEG_QUALITY = 80
_PATIENCE_S = 10.0
_GREY, _BLUE, _GREEN, _ORANGE, _RED = (150, 150, 150), (70, 130, 220), (60, 180, 90), (240, 150, 40), (220, 60, 60)
_HEALTH = {
    Health.INITIALISING: _GREY,
    Health.TRACKING: _GREEN,
    Health.INERTIAL_ONLY: _ORANGE,
    Health.LOST: _RED,
}


class Canvas:
    """Draws on a stream what an estimator says. It only reads: estimates are the same with and without it.

    Args:
        stream: as `open_stream` gives it.
        calibration: of the rig.
        cameras: how many of its cameras are drawn.
        truth: shown in the frame of the first pose: turned in heading and moved so that the two agree there.
    """

    def __init__(
        self, stream: rr.RecordingStream, calibration: Calibration, cameras: int, truth: Trajectory | None = None
    ) -> None:
        self._stream = stream
        self._tails: list[dict[int, deque[Floats]]] = [{} for _ in range(cameras)]
        self._ages: list[dict[int, int]] = [{} for _ in range(cameras)]
        self._truth = truth
        self._shift: tuple[Rotations, Vectors] | None = None
        self._zero_ns: int | None = None
        self._last: dict[str, Vectors] = {}
        self._said: tuple[Health | None, tuple[str, ...]] = (None, ())
        self._draw_fixed(calibration, cameras)

    def add(self, frame: Frame, estimate: Estimate, tracks: Mapping[int, Tracks]) -> None:
        """Draw a frame, what was known at it, and what its cameras followed into it."""
        if self._zero_ns is None:
            self._zero_ns = estimate.t_ns
        self._stream.set_time(paths.TIMELINE, duration=(estimate.t_ns - self._zero_ns) * 1e-9)
        for index in range(len(self._tails)):
            self._draw_image(frame, index)
            self._draw_tracks(tracks.get(index), index)
        self._stream.log(paths.FEATURES, rr.Scalars([estimate.tracked, estimate.used]))
        self._draw_health(estimate)
        if estimate.state is None:
            self._last.clear()
            return
        at = self._true(estimate.t_ns)
        self._draw_pose(estimate.state)
        self._draw_truth(at, estimate.state)
        self._draw_biases(at, estimate.state)

    def flush(self) -> None:
        """Send off what was drawn; a viewer that was closed meanwhile is no reason to lose the run."""
        try:
            self._stream.flush(timeout_sec=_PATIENCE_S)
        except RuntimeError as error:
            _LOG.warning("not all of the drawing arrived: %s", error)

    def _draw_fixed(self, calibration: Calibration, cameras: int) -> None:
        """What is the same at all times."""
        log = self._stream.log
        log(paths.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        log(paths.BODY, rr.TransformAxes3D(0.15), static=True)
        for index, mount in enumerate(calibration.cameras[:cameras]):
            c, at = mount.camera, paths.camera(index)
            K = np.array([[c.fx, 0.0, c.cx], [0.0, c.fy, c.cy], [0.0, 0.0, 1.0]])
            size, xyz = (c.width, c.height), rr.ViewCoordinates.RDF
            log(at, rr.Transform3D(translation=mount.T_BC[:3, 3], mat3x3=mount.T_BC[:3, :3]), static=True)
            log(
                at,
                rr.Pinhole(image_from_camera=K, resolution=size, camera_xyz=xyz, image_plane_distance=0.25),
                static=True,
            )
        log(paths.FEATURES, rr.SeriesLines(names=["tracked", "used"], colors=[_GREY, _GREEN]), static=True)
        names, colours = ["estimate", "+3σ", "−3σ", "truth"], [_BLUE, _GREY, _GREY, _ORANGE]
        known = len(names) if self._truth is not None else len(names) - 1
        for entity in (paths.bias(name, axis) for name in paths.BIASES for axis in paths.AXES):
            log(entity, rr.SeriesLines(names=names[:known], colors=colours[:known]), static=True)
        states = {"values": [h.value for h in _HEALTH], "colors": list(_HEALTH.values())}
        log(paths.HEALTH, rr.StateConfiguration(**states), static=True)

    def _draw_image(self, frame: Frame, index: int) -> None:
        if index not in frame.images:
            return
        try:
            image = frame.images[index].load()
        except DataError:
            return  # the estimator has said so among its reasons
        picture = rr.Image(image, color_model="L").compress(jpeg_quality=_JPEG_QUALITY)
        self._stream.log(f"{paths.camera(index)}/image", picture)

    def _draw_tracks(self, tracks: Tracks | None, index: int) -> None:
        """Where features are, by age from red to green, and where they came from."""
        seen = {} if tracks is None else dict(zip(tracks.ids.tolist(), tracks.uv, strict=True))
        tails, ages = self._tails[index], self._ages[index]
        self._tails[index] = {k: _longer(tails.get(k), uv) for k, uv in seen.items()}
        self._ages[index] = {k: ages.get(k, 0) + 1 for k in seen}
        uv = np.array(list(seen.values())).reshape(-1, 2)
        share = np.minimum(np.array(list(self._ages[index].values())).reshape(-1, 1) / _MATURE, 1.0)
        colours = np.rint((1.0 - share) * _RED + share * _GREEN).astype(np.uint8)
        at = paths.camera(index)
        self._stream.log(f"{at}/now", rr.Points2D(uv, colors=colours, radii=2.0))
        strips = [np.array(tail) for tail in self._tails[index].values()]
        self._stream.log(f"{at}/lately", rr.LineStrips2D(strips, colors=colours, radii=0.7))

    def _draw_health(self, estimate: Estimate) -> None:
        health, reasons = self._said
        if estimate.health is not health:
            self._stream.log(paths.HEALTH, rr.StateChange(state=estimate.health.value))
        if estimate.reasons and estimate.reasons != reasons:
            text = f"{estimate.health.value}: {', '.join(estimate.reasons)}"
            self._stream.log(paths.REASONS, rr.TextLog(text, color=_HEALTH[estimate.health]))
        self._said = (estimate.health, estimate.reasons)

    def _draw_pose(self, state: State) -> None:
        p_WB = state.p_WB
        self._stream.log(paths.BODY, rr.Transform3D(translation=p_WB, mat3x3=state.R_WB))
        half_sizes, quaternion = ellipsoid(_block(state.covariance, "dp"))
        shape = {"centers": [p_WB], "half_sizes": [half_sizes], "quaternions": [rr.Quaternion(xyzw=quaternion)]}
        self._stream.log(paths.SPREAD, rr.Ellipsoids3D(**shape, colors=[_BLUE]))
        self._draw_step(paths.PATH, p_WB, _BLUE)

    def _draw_truth(self, at: Trajectory | None, state: State) -> None:
        """Its path, turned in heading and moved so that the first pose is on it."""
        if at is None:
            self._last.pop(paths.TRUTH, None)
            return
        if self._shift is None:
            turn = so3.exp(np.array([0.0, 0.0, _heading(state.R_WB) - _heading(at.R_WB[0])]))
            self._shift = (turn, state.p_WB - turn @ at.p_WB[0])
        turn, shift = self._shift
        self._draw_step(paths.TRUTH, turn @ at.p_WB[0] + shift, _ORANGE)

    def _draw_step(self, entity: str, p_WB: Vectors, colour: tuple[int, int, int]) -> None:
        """One more step of a path."""
        if entity in self._last:
            self._stream.log(entity, rr.LineStrips3D([[self._last[entity], p_WB]], colors=[colour]))
        self._last[entity] = p_WB

    def _draw_biases(self, at: Trajectory | None, state: State) -> None:
        for name, block in (("b_g", "db_g"), ("b_a", "db_a")):
            values = getattr(state, name)
            spread = _SIGMAS * np.sqrt(np.diagonal(_block(state.covariance, block)))
            true = None if at is None else getattr(at, name)
            for k, axis in enumerate(paths.AXES):
                lines = [values[k], values[k] + spread[k], values[k] - spread[k]]
                if self._truth is not None:
                    lines.append(np.nan if true is None else true[0, k])
                self._stream.log(paths.bias(name, axis), rr.Scalars(lines))

    def _true(self, t_ns: int) -> Trajectory | None:
        """The truth of a moment, None where it is not known."""
        if self._truth is None:
            return None
        k = int(np.searchsorted(self._truth.t_ns, t_ns, side="right"))
        near, now = self._truth[max(k - 1, 0) : k + 1], np.array([t_ns])  # of the whole it would take long
        return near.at(now) if near.covers(now)[0] else None


def ellipsoid(covariance: Floats) -> tuple[Floats, Floats]:
    """Half sizes (3,) of the ellipsoid at 3 sigma of a covariance (3, 3), and the quaternion (4,) xyzw of its axes."""
    values, axes = np.linalg.eigh(covariance)
    axes = axes * np.linalg.det(axes)  # a rotation, no reflection
    return _SIGMAS * np.sqrt(np.maximum(values, 0.0)), so3.to_quaternion(axes)


def _block(covariance: Floats, name: str) -> Floats:
    k = 3 * BLOCKS.index(name)
    return covariance[k : k + 3, k : k + 3]


def _heading(R_WB: Rotations) -> float:
    return float(np.arctan2(R_WB[1, 0], R_WB[0, 0]))


def _longer(tail: deque[Floats] | None, uv: Floats) -> deque[Floats]:
    tail = deque(maxlen=_TAIL) if tail is None else tail
    tail.append(uv)
    return tail

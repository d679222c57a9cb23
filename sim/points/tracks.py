"""Tracks as a tracker would report them, frame by frame, in every camera."""

from itertools import count

import numpy as np

from navcore.arrays import Stamps
from navcore.calibration import Calibration
from navcore.sequence import Frame, Tracks
from sim.degrade.schedule import Schedule
from sim.motion import Motion
from sim.points.followed import Followed
from sim.points.objects import Objects
from sim.points.seeing import Seeing
from sim.points.view import Landmarks, View
from sim.streams import Streams
from sim.world import make_layout

LANDMARKS = 3000


def tracks_along(
    motion: Motion,
    calibration: Calibration,
    stamps: Stamps,
    scene: str,
    seeing: Seeing,
    schedule: Schedule,
    streams: Streams,
) -> list[Frame]:
    """Tracks of landmarks on the surfaces of a scene that is built around a motion, at stamps (N,) ns."""
    layout = make_layout(scene, motion.p_WB, streams.world)
    points, normals = layout.landmarks(LANDMARKS, streams.world)
    view = View(calibration, motion.at(stamps))
    landmarks = Landmarks(view, points, normals, layout.distance)
    objects = Objects(view, layout.distance, streams.vision.spawn(1)[0])
    return follow(landmarks, objects, seeing, schedule, streams.vision)


def follow(
    landmarks: Landmarks, objects: Objects, seeing: Seeing, schedule: Schedule, rng: np.random.Generator
) -> list[Frame]:
    """The frames, with the tracks of every camera; a point that is lost and found again gets a new id.

    Where nothing ever moves, `objects` are left alone. Pixel noise is drawn for camera 0 first, then for the others.
    """
    view, next_id = landmarks.view, count()
    t_ns = view.poses.t_ns.tolist()
    period_s = 1.0 / view.calibration.cameras[0].rate_hz
    seeings = [seeing.degraded(schedule, (t - t_ns[0]) * 1e-9) for t in t_ns]
    on_landmarks, on_objects = Followed.none(next_id), Followed.none(next_id)
    moves = any(now is not None and now.moving > 0.0 for now in seeings)
    seen_objects = objects.seen() if moves else None
    frames = []
    for k, (now, seen) in enumerate(zip(seeings, landmarks.seen(), strict=True)):
        moving = next(seen_objects) if seen_objects else None
        if now is None:
            on_landmarks.drop()
            on_objects.drop()
        else:
            hazard = period_s / now.track_life_s
            wanted_moving = round(now.moving * now.max_features)
            wanted = now.max_features - wanted_moving
            on_landmarks.lose(seen, wanted, hazard, rng)
            if now.outliers > 0.0:
                on_landmarks.mismatch(seen, round(now.outliers * wanted), period_s, rng)
            on_landmarks.fill(seen, wanted, rng)
            if moving is not None:
                on_objects.lose(moving, wanted_moving, hazard, rng)
                on_objects.fill(moving, wanted_moving, rng)
        p_WF, ids = landmarks.positions(on_landmarks.which), on_landmarks.ids
        if moves:
            p_WF = np.concatenate([p_WF, objects.positions(k, on_objects.which)])
            ids = np.concatenate([ids, on_objects.ids])
        tracks = {}
        in_first = np.ones(len(ids), dtype=bool)
        for camera in range(len(view.calibration.cameras)):
            uv, in_image = view.pixels(k, camera, p_WF)
            in_image &= in_first
            sigma = 0.0 if now is None else now.pixel_noise
            tracks[camera] = Tracks(ids[in_image], (uv + sigma * rng.standard_normal(uv.shape))[in_image])
            if camera == 0:
                in_first = in_image
        on_landmarks.keep(in_first[: len(on_landmarks.ids)])
        on_objects.keep(in_first[len(in_first) - len(on_objects.ids) :])
        frames.append(Frame(t_ns[k], tracks=tracks))
    return frames

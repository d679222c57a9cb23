"""A rig in the hand of somebody who walks about and looks around."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from navcore.arrays import Floats
from sim.motion import Motion
from sim.platforms.course import Course, Going, random_course
from sim.platforms.gait import Holding, hand_of
from sim.platforms.physics import Physics

MODEL = Path(__file__).with_name("handheld.xml")

_HEIGHT = 1.4  # m, at which it is carried
_SHELF = 1.1  # m, where it lies before
_LIFT_S = 2.0  # in which it is taken up
_SETTLE_S = 1.0  # the spring of the arm comes to rest before time begins
_MOVING_START_S = 6.0  # of walking that is thrown away for a start in motion
_HAND = int(mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT)


@dataclass(frozen=True)
class HandheldWalk:
    """How somebody walks with the rig."""

    going: Going
    holding: Holding
    rest_s: float = 2.0  # lying still before it is taken up


_ROOM = (2.9, 1.9)  # m, half of where goals lie; turns lead out of it by a metre
WALKS = {
    "easy": HandheldWalk(Going(_ROOM, 0.6, 0.8, 1.0, 0.3), Holding((0.03, 0.06, 0.12), 2.0, 0.05)),
    "medium": HandheldWalk(Going(_ROOM, 1.0, 0.6, 1.5, 0.25), Holding((0.06, 0.12, 0.35), 1.5, 0.12)),
    "difficult": HandheldWalk(Going(_ROOM, 1.6, 0.5, 2.5, 0.15), Holding((0.12, 0.25, 0.7), 1.0, 0.3, 1.4)),
}
"""Walks by difficulty."""


def carry(seconds: float, rng: np.random.Generator, walk: HandheldWalk, moving_start: bool = False) -> Motion:
    """The motion of `seconds` in a hand; the same generator state walks the same way.

    With `moving_start` it begins in full walk instead of at rest.
    """
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    skip_s = walk.rest_s + _MOVING_START_S if moving_start else 0.0
    total_s = seconds + skip_s
    course = random_course(walk.going, total_s, rng, walk.rest_s + _LIFT_S)
    hand = _hand(course, walk, float(model.opt.timestep), rng)
    data.mocap_pos[0], data.mocap_quat[0] = np.split(hand[0], [3])
    data.qpos[:] = hand[0]
    mujoco.mj_step(model, data, round(_SETTLE_S / model.opt.timestep))
    physics = Physics(model, data, total_s, _HAND)
    physics.advance(hand)
    motion = physics.motion()
    return motion.after(skip_s) if skip_s else motion


def _hand(course: Course, walk: HandheldWalk, dt_s: float, rng: np.random.Generator) -> Floats:
    """(N, 7): position [m] in W and attitude (wxyz) of the hand, every `dt_s`."""
    t = np.arange(round(course.seconds / dt_s) + 1, dtype=np.float64) * dt_s
    beside = hand_of(np.clip(course.speed(t), 0.0, None), dt_s, walk.holding, rng)
    held = _rise((t - walk.rest_s) / _LIFT_S)[:, None]
    heading = course.heading(t)
    ahead, left, up = (held * beside.offset).T
    c, s = np.cos(heading), np.sin(heading)
    place = course.place(t) + np.stack([c * ahead - s * left, s * ahead + c * left], axis=1)
    roll, pitch, yaw = (held * beside.angles).T
    attitude = Rotation.from_euler("ZYX", np.stack([heading + yaw, pitch, roll], axis=1)).as_quat()
    height = _SHELF + (_HEIGHT - _SHELF) * held[:, 0] + up
    return np.column_stack([place, height, np.roll(attitude, 1, axis=1)])


def _rise(x: Floats) -> Floats:
    """From 0 at 0 to 1 at 1, with three continuous derivatives."""
    x = np.clip(x, 0.0, 1.0)
    out: Floats = x**4 * (35.0 - x * (84.0 - x * (70.0 - 20.0 * x)))
    return out

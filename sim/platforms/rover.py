"""A wheeled rover in MuJoCo that drives over rough ground."""

from dataclasses import dataclass
from math import atan2, cos, sin
from pathlib import Path

import mujoco
import numpy as np

from sim.errors import ConfigError
from sim.motion import Motion
from sim.platforms.controller import Frame
from sim.platforms.course import Going, random_course
from sim.platforms.driver import Wanted, Wheelbase, steer, wanted_along
from sim.platforms.ground import Ground
from sim.platforms.physics import Physics
from sim.platforms.tread import Tread

MODEL = Path(__file__).with_name("rover.xml")

_CONTROL_EVERY = 10  # physics steps
_SETTLE_S = 3.0  # the springs come to rest before time begins
_SHARPEST = 0.6  # m, the least radius that the front wheels allow
_MOVING_START_S = 6.0  # of driving that is thrown away for a start in motion
_MOST_ROUGHNESS = 1e-3  # m^3: heights of 3 cm
_PLANES = int(mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT)
_DRIVEN = int(mujoco.mjtState.mjSTATE_CTRL) | _PLANES


@dataclass(frozen=True)
class RoverDrive:
    """How the rover drives, and on what."""

    going: Going
    roughness: float  # m^3, of the ground at 0.1 cycles/m, as ISO 8608 states it
    rest_s: float = 2.0  # standing before it sets off

    def __post_init__(self) -> None:
        if not 0.0 <= self.roughness <= _MOST_ROUGHNESS:
            raise ConfigError(f"roughness is {self.roughness} m^3, expected 0 to {_MOST_ROUGHNESS}")


_ROOM = (2.7, 1.6)  # m, half of where goals lie
DRIVES = {
    "easy": RoverDrive(Going(_ROOM, 0.6, 0.75, 0.5, 0.3), 4e-6),
    "medium": RoverDrive(Going(_ROOM, 1.0, 0.7, 1.0, 0.25), 64e-6),
    "difficult": RoverDrive(Going(_ROOM, 1.5, 0.65, 2.0, 0.15), 400e-6),
}
"""Drives by difficulty."""


def drive(seconds: float, rng: np.random.Generator, way: RoverDrive, moving_start: bool = False) -> Motion:
    """The motion of `seconds` of driving; the same generator state drives the same way.

    With `moving_start` it begins in full drive instead of standing.
    """
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    skip_s = way.rest_s + _MOVING_START_S if moving_start else 0.0
    total_s = seconds + skip_s
    period_s = _CONTROL_EVERY * float(model.opt.timestep)
    wanted = wanted_along(random_course(way.going, total_s, rng, way.rest_s), period_s)
    tread = Tread(model, Ground(way.roughness, rng), _CONTROL_EVERY)
    _stand(model, data, tread, wanted[0])
    physics = Physics(model, data, total_s, _DRIVEN)
    _follow(physics, tread, wanted)
    motion = physics.motion()
    return motion.after(skip_s) if skip_s else motion


def _stand(model: mujoco.MjModel, data: mujoco.MjData, tread: Tread, wanted: Wanted) -> None:
    """Put the wheels on the ground at the beginning of the course, turned to where it leads."""
    x, y, heading = wanted[:3]
    data.qpos[:2] = x, y
    data.qpos[3:7] = cos(0.5 * heading), 0.0, 0.0, sin(0.5 * heading)
    data.ctrl[:] = steer(_wheelbase(model), x, y, heading, wanted)
    for _ in range(round(_SETTLE_S / model.opt.timestep / _CONTROL_EVERY)):
        p, q = np.split(data.qpos[:7], [3])
        v, omega = np.split(data.qvel[:6], [3])
        mujoco.mj_setState(model, data, tread.under(p.tolist(), q.tolist(), v.tolist(), omega.tolist())[0], _PLANES)
        mujoco.mj_step(model, data, _CONTROL_EVERY)


def _follow(physics: Physics, tread: Tread, course: list[Wanted]) -> None:
    """Drive along what is wanted at each control; commands go on evenly from one to the next."""
    model = physics.model
    car = _wheelbase(model)
    controls = np.empty((_CONTROL_EVERY, model.nu + tread.size))
    share = (np.arange(_CONTROL_EVERY)[:, None] + 1.0) / _CONTROL_EVERY
    last = physics.data.ctrl.copy()
    for wanted in course:
        p, q, v, omega = physics.body
        nose = Frame.of(*q).x
        command = np.array(steer(car, p[0], p[1], atan2(nose[1], nose[0]), wanted))
        controls[:, : model.nu] = last + share * (command - last)
        controls[:, model.nu :] = tread.under(p, q, v, omega)
        last = command
        physics.advance(controls)


def _wheelbase(model: mujoco.MjModel) -> Wheelbase:
    front, rear = model.body("hub0").pos, model.body("hub2").pos
    radius = float(model.geom("wheel0").size[0])
    return Wheelbase(float(front[0] - rear[0]), float(2.0 * rear[1]), radius, _SHARPEST)

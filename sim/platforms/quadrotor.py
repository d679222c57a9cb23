"""A quadrotor in MuJoCo that flies random waypoints through a room."""

from dataclasses import dataclass, field
from pathlib import Path as FilePath

import mujoco
import numpy as np

from navcore import so3
from navcore.arrays import Floats
from navcore.imu import GRAVITY
from sim.errors import ConfigError
from sim.motion import Motion
from sim.platforms.controller import Frame, GeometricController
from sim.platforms.physics import Physics
from sim.platforms.rotors import ROTORS, Rotors
from sim.platforms.waypoints import Box, Path, Reference, random_path

MODEL = FilePath(__file__).with_name("quadrotor.xml")

_CONTROL_EVERY = 5  # physics steps
_SETTLE_S = 0.5  # the feet come to rest on the floor before time begins
_MOVING_START_S = 8.0  # of flight that is thrown away for a start in motion


@dataclass(frozen=True)
class QuadrotorFlight:
    """How the quadrotor flies."""

    speed: float = 1.3  # m/s, mean after take-off
    acceleration: float = 7.0  # m/s^2, never more is asked for
    yaw_rate: float = 0.35  # rad/s, sd between waypoints
    rest_s: float = 2.0  # standing on the floor before take-off
    box: Box = field(default_factory=lambda: Box((-3.8, -2.8, 1.1), (3.8, 2.8, 3.0)))  # m in W

    def __post_init__(self) -> None:
        if not 0.0 < self.speed <= 4.0:
            raise ConfigError(f"speed is {self.speed} m/s, expected above 0 and at most 4")
        if self.rest_s < 0.0:
            raise ConfigError(f"rest_s is {self.rest_s}, expected 0 or more")


FLIGHTS = {
    "easy": QuadrotorFlight(speed=0.7, yaw_rate=0.2),
    "medium": QuadrotorFlight(),
    "difficult": QuadrotorFlight(speed=1.8, yaw_rate=0.8),
}
"""Flights by difficulty."""


def fly(seconds: float, rng: np.random.Generator, flight: QuadrotorFlight, moving_start: bool = False) -> Motion:
    """The motion of `seconds` of flight; the same generator state flies the same path.

    With `moving_start` it begins in full flight instead of on the floor.
    """
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    start = np.array([*rng.uniform(flight.box.low[:2], flight.box.high[:2]), data.qpos[2]])
    skip_s = flight.rest_s + _MOVING_START_S if moving_start else 0.0
    total_s = seconds + skip_s
    path = random_path(
        flight.box, start, total_s, flight.speed, flight.yaw_rate, rng, flight.rest_s, flight.acceleration
    )
    _stand(model, data, path)
    physics = Physics(model, data, total_s)
    rotors = Rotors(model, model.body_mass[1] * GRAVITY / ROTORS, _CONTROL_EVERY, rng)
    physics.advance(np.zeros((round(flight.rest_s / physics.step_s), model.nu)))
    _follow(physics, rotors, path.sample(flight.rest_s + np.arange(0.0, physics.left, _CONTROL_EVERY) * physics.step_s))
    motion = physics.motion()
    return motion.after(skip_s) if skip_s else motion


def _stand(model: mujoco.MjModel, data: mujoco.MjData, path: Path) -> None:
    """Put the feet on the floor at the beginning of the path."""
    data.qpos[:2] = path.position(0.0)[:2]
    data.qpos[3:7] = np.roll(so3.to_quaternion(so3.exp(np.array([0.0, 0.0, float(path.yaw(0.0))]))), 1)
    mujoco.mj_step(model, data, round(_SETTLE_S / model.opt.timestep))


def _follow(physics: Physics, rotors: Rotors, reference: Reference) -> None:
    """Fly through what is wanted at each control."""
    model = physics.model
    controller = GeometricController(
        float(model.body_mass[1]), tuple(model.body_inertia[1].tolist()), _CONTROL_EVERY * physics.step_s
    )
    mix = np.linalg.inv(_allocation(model))
    limit = model.actuator_ctrlrange[:ROTORS, 1]
    controls = np.zeros((_CONTROL_EVERY, model.nu))
    driven = controls[:, : ROTORS * 4]
    heading = np.column_stack([np.cos(reference.yaw), np.sin(reference.yaw), np.zeros(len(reference.yaw))])
    wanted = (reference.p, reference.v, reference.a, heading)
    for target in zip(*(x.tolist() for x in wanted), strict=True):
        p, q, v, omega = physics.body
        wrench = controller.command(Frame.of(*q), p, v, omega, *target)
        thrust = np.minimum(np.maximum(mix @ wrench, 0.0), limit)
        driven[:] = rotors.controls(physics.act, thrust)
        physics.advance(controls)


def _allocation(model: mujoco.MjModel) -> Floats:
    """(4, 4): thrust and moment about the centre of mass, by rotor command."""
    arm = model.site_pos[[model.site(f"rotor{i}").id for i in range(ROTORS)]] - model.body_ipos[1]
    spin = model.actuator_gear[:ROTORS, 5]
    return np.stack([np.ones(ROTORS), arm[:, 1], -arm[:, 0], spin])

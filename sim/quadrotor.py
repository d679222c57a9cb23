"""A quadrotor in MuJoCo that flies random waypoints through a room."""

from dataclasses import dataclass, field
from pathlib import Path as FilePath

import mujoco
import numpy as np

from navcore import so3
from navcore.arrays import Floats
from sim.controller import GeometricController
from sim.errors import ConfigError
from sim.motion import Motion
from sim.waypoints import Box, Path, random_path

MODEL = FilePath(__file__).with_name("quadrotor.xml")
ROTORS = 4

_CONTROL_EVERY = 4  # physics steps
_SETTLE_S = 0.5  # the feet come to rest on the floor before time begins
_MOVING_START_S = 8.0  # of flight that is thrown away for a start in motion


@dataclass(frozen=True)
class QuadrotorFlight:
    """How the quadrotor flies."""

    speed: float = 1.3  # m/s, mean after take-off
    yaw_rate: float = 0.35  # rad/s, sd between waypoints
    rest_s: float = 2.0  # standing on the floor before take-off
    moving_start: bool = False  # the recording begins in full flight
    box: Box = field(default_factory=lambda: Box((-3.8, -2.8, 1.1), (3.8, 2.8, 3.0)))  # m in W

    def __post_init__(self) -> None:
        if not 0.0 < self.speed <= 4.0:
            raise ConfigError(f"speed is {self.speed} m/s, expected above 0 and at most 4")
        if self.rest_s < 0.0:
            raise ConfigError(f"rest_s is {self.rest_s}, expected 0 or more")


def fly(seconds: float, rng: np.random.Generator, flight: QuadrotorFlight | None = None) -> Motion:
    """The motion of `seconds` of flight; the same generator state flies the same path.

    Raises:
        ConfigError: `seconds` is not above zero.
    """
    if not seconds > 0.0:
        raise ConfigError(f"a flight of {seconds} s was asked for; expected more than 0")
    flight = flight or QuadrotorFlight()
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    start = np.array([*rng.uniform(flight.box.low[:2], flight.box.high[:2]), data.qpos[2]])
    skip_s = flight.rest_s + _MOVING_START_S if flight.moving_start else 0.0
    total_s = seconds + skip_s
    path = random_path(flight.box, start, total_s, flight.speed, flight.yaw_rate, rng, flight.rest_s)
    data.qpos[:2] = start[:2]
    data.qpos[3:7] = np.roll(so3.to_quaternion(so3.exp(np.array([0.0, 0.0, float(path.yaw(0.0))]))), 1)
    mujoco.mj_step(model, data, round(_SETTLE_S / model.opt.timestep))
    states = _simulate(model, data, path, round(total_s / model.opt.timestep), flight.rest_s)
    q_WB = np.roll(states[:, 3:7], -1, axis=1)
    motion = Motion.from_states(model.opt.timestep, so3.from_quaternion(q_WB), states[:, :3], states[:, 7:10])
    return motion.after(skip_s) if skip_s else motion


def _simulate(model: mujoco.MjModel, data: mujoco.MjData, path: Path, steps: int, rest_s: float) -> Floats:
    """(steps + 1, 13) qpos and qvel; rotors stand still before `rest_s`."""
    h = model.opt.timestep
    reference = path.sample(np.arange(0, steps + 1, _CONTROL_EVERY) * h)
    controller = GeometricController(model.body_mass[1], model.body_inertia[1], _CONTROL_EVERY * h)
    mix = np.linalg.inv(_allocation(model))
    limit = model.actuator_ctrlrange[:ROTORS, 1]
    states = np.empty((steps + 1, 13))
    R_WB = np.empty((3, 3))
    for k in range(steps + 1):
        states[k, :7], states[k, 7:] = data.qpos, data.qvel
        if k % _CONTROL_EVERY == 0 and k * h >= rest_s:
            i = k // _CONTROL_EVERY
            mujoco.mju_quat2Mat(R_WB.reshape(-1), data.qpos[3:7])
            wrench = controller.command(
                R_WB,
                data.qpos[:3],
                data.qvel[:3],
                data.qvel[3:],
                reference.p[i],
                reference.v[i],
                reference.a[i],
                reference.yaw[i],
            )
            data.ctrl[:ROTORS] = np.clip(mix @ wrench, 0.0, limit)
        mujoco.mj_step(model, data)
    return states


def _allocation(model: mujoco.MjModel) -> Floats:
    """(4, 4): thrust and moment about the centre of mass, by rotor command."""
    arm = model.site_pos[[model.site(f"rotor{i}").id for i in range(ROTORS)]] - model.body_ipos[1]
    spin = model.actuator_gear[:ROTORS, 5]
    return np.stack([np.ones(ROTORS), arm[:, 1], -arm[:, 0], spin])

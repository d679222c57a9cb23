from collections.abc import Callable
from copy import copy
from types import ModuleType

import mujoco
import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation, RotationSpline

from navcore.imu import GRAVITY
from sim.errors import ConfigError
from sim.motion import EPOCH_NS, Motion
from sim.platforms import handheld, quadrotor, rover
from sim.platforms.physics import Physics

Begin = Callable[[mujoco.MjModel, mujoco.MjData], None]
DRIVEN = int(mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT)

_BODY = """<mujoco><option gravity="0 0 -9.81"/><worldbody><body><freejoint/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody></mujoco>"""


def spline_motion(h: float, seconds: float) -> tuple[Motion, RotationSpline, object]:
    """A motion sampled from splines, which know their own derivatives."""
    rng = np.random.default_rng(5)
    knots = np.arange(-2.0, seconds + 3.0)
    position = make_interp_spline(knots, rng.uniform(-1.0, 1.0, (len(knots), 3)), k=5)
    attitude = RotationSpline(knots, Rotation.from_rotvec(np.cumsum(rng.normal(0.0, 0.4, (len(knots), 3)), axis=0)))
    t = np.arange(round(seconds / h) + 1) * h
    return Motion.from_states(h, attitude(t).as_matrix(), position(t), position(t, 1)), attitude, position


def test_specific_force_and_rate_agree_with_mujoco_inverse_dynamics() -> None:
    h, seconds = 2.5e-4, 3.0
    motion, attitude, position = spline_motion(h, seconds)
    model = mujoco.MjModel.from_xml_string(_BODY)
    data = mujoco.MjData(model)
    for k in range(0, round(seconds / h), 301):
        t = (k + 0.5) * h
        data.qpos[:3], data.qpos[3:] = position(t), np.roll(attitude(t).as_quat(), 1)
        data.qvel[:3], data.qacc[:3] = position(t, 1), position(t, 2)
        R_WB = attitude(t).as_matrix()
        data.qvel[3:], data.qacc[3:] = attitude(t, 1), attitude(t, 2)  # both in the body frame
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(motion.specific_force_B[k], R_WB.T @ data.qfrc_inverse[:3], atol=1e-6)
        np.testing.assert_allclose(motion.omega_B[k], data.qvel[3:], atol=1e-6)


def quadrotor_in_flight(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    data.qpos[2], data.qvel[:] = 5.0, (1.0, -0.5, 0.2, 0.5, -0.7, 0.3)
    data.ctrl[:16] = (3.1, 2.9, 3.0, 2.95, *np.linspace(-0.8, 0.8, 12))
    data.act[:] = 2.9


def handheld_pulled_aside(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    data.qvel[:] = 0.1, -0.2, 0.1, 0.2, -0.3, 0.1
    data.mocap_pos[0] += 0.004, -0.002, 0.006
    data.mocap_quat[0] = 1.0, 0.004, -0.006, 0.01


def rover_setting_off_on_slopes(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    mujoco.mj_forward(model, data)
    for i in range(model.nmocap):
        data.mocap_pos[i, :2] = data.body(f"wheel{i}").xpos[:2]
        data.mocap_quat[i] = 1.0, 0.01 * i, 0.02 - 0.01 * i, 0.0
    data.ctrl[:] = 0.4, 0.5, 8.0, 10.0


@pytest.mark.parametrize(
    ("platform", "begin"),
    [
        pytest.param(quadrotor, quadrotor_in_flight, id="quadrotor"),
        pytest.param(handheld, handheld_pulled_aside, id="handheld"),
        pytest.param(rover, rover_setting_off_on_slopes, id="rover"),
    ],
)
def test_specific_force_and_rate_agree_with_mujoco_sensors(platform: ModuleType, begin: Begin) -> None:
    model = mujoco.MjModel.from_xml_path(str(platform.MODEL))
    data = mujoco.MjData(model)
    begin(model, data)
    driven = np.empty(mujoco.mj_stateSize(model, DRIVEN))
    mujoco.mj_getState(model, data, driven, DRIVEN)
    physics = Physics(model, copy(data), 0.4, DRIVEN)
    physics.advance(np.tile(driven, (400, 1)))
    motion, sensed = physics.motion(), []
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    for _ in range(401):
        mujoco.mj_forward(model, data)
        sensed.append(data.sensordata.copy())
        mujoco.mj_step(model, data)
    accelerometer, gyro = np.hsplit(np.array(sensed), 2)
    half_way = Rotation.from_rotvec(0.5 * motion.step_s * motion.omega_B)  # the force is constant in the turning body
    np.testing.assert_allclose(half_way.apply(motion.specific_force_B.copy()), accelerometer[:-1], atol=1e-6)
    np.testing.assert_allclose(motion.omega_B, gyro[1:], atol=1e-9)  # Euler turns with the rate at the end of a step


def test_states_between_knots_are_those_of_the_constant_rate_and_force() -> None:
    motion, _, _ = spline_motion(1e-3, 1.0)
    k, parts = 400, 50
    tau = np.arange(parts + 1) / parts * 1e-3
    fine = motion.at(EPOCH_NS + np.rint((k * 1e-3 + tau) * 1e9).astype(np.int64))
    assert fine.v_WB is not None
    R_mid = Rotation.from_matrix(motion.R_WB[k]) * Rotation.from_rotvec(
        np.outer(tau[:-1] + tau[1] / 2, motion.omega_B[k])
    )
    steps = (R_mid.apply(motion.specific_force_B[k].copy()) + np.array([0.0, 0.0, -GRAVITY])) * tau[1]
    np.testing.assert_allclose(np.diff(fine.v_WB, axis=0), steps, atol=1e-9)
    np.testing.assert_allclose(fine.R_WB[-1], motion.R_WB[k + 1], atol=1e-12)
    np.testing.assert_allclose(fine.v_WB[-1], motion.v_WB[k + 1], atol=1e-12)
    np.testing.assert_allclose(fine.p_WB[-1], motion.p_WB[k + 1], atol=1e-7)


def test_a_time_outside_the_motion_is_refused(flight: Motion) -> None:
    with pytest.raises(ConfigError, match="lasts 20"):
        flight.at(np.array([EPOCH_NS + 20_100_000_000]))


def test_a_motion_cut_at_its_start_goes_on_as_before(flight: Motion) -> None:
    later = flight.after(5.0)
    assert later.duration_s == pytest.approx(15.0)
    np.testing.assert_array_equal(later.p_WB[0], flight.p_WB[5000])
    np.testing.assert_array_equal(later.specific_force_B[-1], flight.specific_force_B[-1])

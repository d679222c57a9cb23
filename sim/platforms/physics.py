"""Stepping a MuJoCo model from control to control, and the motion of its body that comes out."""

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from navcore import so3
from navcore.arrays import Floats
from sim.motion import Motion

_FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS  # time, qpos, qvel, act
_DRIVEN = int(mujoco.mjtState.mjSTATE_CTRL)


class Physics:
    """A run of a model whose first joint is the free joint of B; the integrator must be MuJoCo's Euler.

    Attributes:
        model, data: of MuJoCo; `data` is where the run begins.
        step_s: of the physics.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, seconds: float, driven: int = _DRIVEN) -> None:
        """For `seconds` from the state in `data`; `driven` says what the rows of controls are (an mjtState)."""
        self.model, self.data = model, data
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
        self.step_s = float(model.opt.timestep)
        self._steps = round(seconds / self.step_s)
        self._states = np.empty((1, self._steps + 1, mujoco.mj_stateSize(model, _FULL)))
        mujoco.mj_getState(model, data, self._states[0, 0], _FULL)
        self._done = 0
        self._driven = driven
        self._rollout = Rollout(nthread=0)
        velocity = 1 + model.nq
        self._act = slice(velocity + model.nv, velocity + model.nv + model.na)
        self._p, self._q = slice(1, 4), slice(4, 8)
        self._v, self._omega = slice(velocity, velocity + 3), slice(velocity + 3, velocity + 6)

    @property
    def left(self) -> int:
        """Steps that are still to be done."""
        return self._steps - self._done

    @property
    def body(self) -> tuple[list[float], list[float], list[float], list[float]]:
        """B now: p_WB [m], q_WB (wxyz), v_WB [m/s], omega_B [rad/s]."""
        row = self._states[0, self._done].tolist()
        return row[self._p], row[self._q], row[self._v], row[self._omega]

    @property
    def act(self) -> Floats:
        """(na,): the actuators' own state now."""
        row: Floats = self._states[0, self._done, self._act]
        return row

    def advance(self, controls: Floats) -> None:
        """One step for each row of controls (n, nu), as far as the run goes."""
        n = min(len(controls), self.left)
        if n == 0:
            return
        k, states = self._done, self._states
        self._rollout.rollout(
            [self.model],
            [self.data],
            states[:, k],
            controls[None, :n],
            control_spec=self._driven,
            skip_checks=True,
            nstep=n,
            state=states[:, k + 1 : k + 1 + n],
        )
        self._done += n

    def motion(self) -> Motion:
        """What B did in all the steps.

        Euler's velocities and attitudes obey the forces of each step exactly. Its position moves with the
        velocity at the end of a step; half a step of velocity less, it is the trapezoid of them.
        """
        states = self._states[0]
        R_WB = so3.from_quaternion(np.roll(states[:, self._q], -1, axis=1))
        v_WB = states[:, self._v]
        return Motion.from_states(self.step_s, R_WB, states[:, self._p] - 0.5 * self.step_s * v_WB, v_WB)

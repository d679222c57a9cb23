"""Rotors that shake the body they carry."""

import mujoco
import numpy as np

from navcore.arrays import Floats

ROTORS = 4
AXES = ("x", "y", "z")

_HOVER_HZ = 88.0  # turns a second in hover: 5300 rpm of ten-inch propellers
_UNBALANCE = 0.08  # of thrust: 0.8 g mm, as if a rotor of 10 g sat 0.08 mm off its axis
_UNEVEN = 0.33  # of thrust: unequal blades pass the arm, once a turn
_SPIN = np.array([1.0, -1.0, 1.0, -1.0])  # neighbours turn against each other
_SPREAD = (0.6, 1.4)  # no two rotors are alike


class Rotors:
    """Thrusts with a lag, and the forces of unbalanced, uneven rotors that turn as fast as their thrust asks.

    Thrust and unbalance both grow with the square of the speed, so the shaking is a share of the thrust. Unbalance
    pulls outwards in the rotor's plane, unequal blades along its axis; sizes are such that the specific force of
    EuRoC's flights between 40 and 100 Hz comes out (1.1 m/s^2 rms along thrust, 0.3 across, as the IMU samples it).
    """

    def __init__(self, model: mujoco.MjModel, hover_thrust: float, steps: int, rng: np.random.Generator) -> None:
        """For the rotors of a model, `hover_thrust` [N] each, called every `steps`; draws their flaws and phases."""
        step_s = float(model.opt.timestep)
        in_the_middle = (np.arange(steps) + 0.5) * step_s
        self._decay = np.exp(-in_the_middle / model.actuator_dynprm[0, 0])[:, None]
        self._turn = 2.0j * np.pi * _HOVER_HZ / np.sqrt(hover_thrust) * step_s * _SPIN
        unbalance, uneven = rng.uniform(*_SPREAD, (2, ROTORS))
        lead = np.exp(1j * rng.uniform(-np.pi, np.pi, ROTORS))
        self._share = np.stack([_UNBALANCE * unbalance, -1j * _UNBALANCE * unbalance, _UNEVEN * uneven * lead])
        self._phase = 1j * rng.uniform(-np.pi, np.pi, ROTORS)
        self._out = np.empty((steps, ROTORS * (1 + len(AXES))))
        self._shaking = self._out[:, ROTORS:].reshape(steps, len(AXES), ROTORS)

    def controls(self, thrust: Floats, wanted: Floats) -> Floats:
        """(steps, 4 + 12): the thrusts wanted, and each rotor's shaking along x, y and z of B [N].

        Args:
            thrust: (4,) N, of the rotors now.
            wanted: (4,) N, held over the steps.
        """
        real = wanted + (thrust - wanted) * self._decay
        phase = self._phase + np.cumsum(self._turn * np.sqrt(real), axis=0)
        self._phase = phase[-1]
        spin = real * np.exp(phase)
        self._out[:, :ROTORS] = wanted
        self._shaking[:] = (spin[:, None] * self._share).real
        return self._out

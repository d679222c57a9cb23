"""Where wheels stand: the planes that touch the ground under them."""

import mujoco
import numpy as np

from navcore import so3
from navcore.arrays import Floats
from sim.platforms.controller import Frame, Vector
from sim.platforms.ground import Ground


class Tread:
    """The tangent planes of smooth ground under the wheels of a body, from step to step.

    The middle of a wheel goes one radius above the ground's heights; the plane that it touches is parallel to the
    way of that middle. So a plane that is moved to where the wheel has come to acts on it as the still ground would.

    Attributes:
        size: numbers a step: a place (3) for each plane, then an attitude (4) for each.
    """

    def __init__(self, model: mujoco.MjModel, ground: Ground, steps: int) -> None:
        """For the wheels of a model, asked for every `steps`."""
        self._ground = ground
        self._tau = np.arange(steps)[:, None] * float(model.opt.timestep)
        self._wheels = np.stack([model.body(f"hub{i}").pos for i in range(model.nmocap)])
        self._lever = -so3.hat(self._wheels)
        self._radius = float(model.geom("wheel0").size[0])
        self.size = 7 * model.nmocap
        self._rows = np.zeros((steps, self.size))
        self._place = self._rows[:, : 3 * model.nmocap].reshape(steps, model.nmocap, 3)
        self._quat_wxyz = self._rows[:, 3 * model.nmocap :].reshape(steps, model.nmocap, 4)

    def under(self, p: Vector, q_wxyz: Vector, v: Vector, omega: Vector) -> Floats:
        """(steps, size): places [m] and attitudes (wxyz, of any length) of the planes, as MuJoCo lays them out.

        Args:
            p, v: m and m/s in W, of B now.
            q_wxyz, omega: attitude of B now, and its rate [rad/s] in B.
        """
        axes = np.array(Frame.of(*q_wxyz))
        centre = np.array(p) + self._wheels @ axes
        speed = np.array(v) + (self._lever @ np.array(omega)) @ axes
        x = centre[:, 0] + self._tau * speed[:, 0]
        y = centre[:, 1] + self._tau * speed[:, 1]
        ground = self._ground.at(x, y)
        height, by_x, by_y = ground[..., 0], ground[..., 1], ground[..., 2]
        steep = np.sqrt(1.0 + by_x * by_x + by_y * by_y)
        place, quat = self._place, self._quat_wxyz
        place[..., 0], place[..., 1] = x, y
        place[..., 2] = height - self._radius * (steep - 1.0)
        quat[..., 0], quat[..., 1], quat[..., 2] = 1.0 + steep, by_y, -by_x
        return self._rows

"""The IMU's part of a start in motion: the window, its path, and what the IMU says between the poses."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from msckf.blocks import POSITION, THETA, VELOCITY
from msckf.propagation import G_W, Increment, integrate, predict
from msckf.static_start import gravity_aligned
from msckf.views import Views
from navcore import so3
from navcore.arrays import Floats, Rotations, Vectors
from navcore.imu import ImuNoise
from navcore.imu_buffer import Cells
from navcore.prior import BiasPrior

_JITTER = 1e-9  # of a correlation matrix, so that it has a Cholesky factor


@dataclass(frozen=True)
class Window:
    """What a start in motion looks at.

    Attributes:
        cells: IMU between consecutive poses, K - 1 of them.
        views: features over the K poses.
        noise: of the IMU.
        device: what is known of the biases beforehand.
    """

    cells: list[Cells]
    views: Views
    noise: ImuNoise
    device: BiasPrior

    @property
    def seconds(self) -> float:
        """Length of the window [s]."""
        return float(sum(cells.dt.sum() for cells in self.cells))

    @cached_property
    def increments(self) -> list[Increment]:
        """The increments between the poses, at the biases that the device is expected to have."""
        return [integrate(cells, self.device.b_g, self.device.b_a, self.noise) for cells in self.cells]

    def increments_at(self, b_g: Vectors, b_a: Vectors) -> list[Increment]:
        """The same at other biases, by their derivatives: exact enough for poses that are tenths of a second apart."""
        db = np.concatenate([b_g - self.device.b_g, b_a - self.device.b_a])
        return [_shifted(increment, increment.J @ db) for increment in self.increments]


def _shifted(increment: Increment, d: Floats) -> Increment:
    """An increment after changes (9,) of its rotation (on the right), position and velocity."""
    return replace(
        increment,
        delta_R=increment.delta_R @ so3.exp(d[THETA]),
        delta_p=increment.delta_p + d[POSITION],
        delta_v=increment.delta_v + d[VELOCITY],
    )


@dataclass(frozen=True)
class Path:
    """Poses and velocities of a window, and its biases, which are constant over it.

    Attributes:
        R: (K, 3, 3) R_WB; p: (K, 3) m; v: (K, 3) m/s.
        b_g, b_a: (3,) rad/s and m/s^2.
    """

    R: Rotations
    p: Vectors
    v: Vectors
    b_g: Vectors
    b_a: Vectors

    @staticmethod
    def of(increments: list[Increment], v_B: Vectors, g_B: Vectors, b_g: Vectors, b_a: Vectors) -> "Path":
        """The path that follows from velocity and gravity at the first pose."""
        R = gravity_aligned(-g_B)
        poses = [(R, np.zeros(3), R @ v_B)]
        for increment in increments:
            poses.append(predict(*poses[-1], increment))
        R_all, p_all, v_all = (np.stack([pose[i] for pose in poses]) for i in range(3))
        return Path(R_all, p_all, v_all, b_g, b_a)

    def moved(self, d: Floats) -> "Path":
        """After a step (9 K + 6,): dtheta, dp, dv of every pose, then db_g, db_a."""
        x = d[:-6].reshape(-1, 9)
        R = so3.normalise(self.R @ so3.exp(x[:, THETA]))
        return Path(R, self.p + x[:, POSITION], self.v + x[:, VELOCITY], self.b_g + d[-6:-3], self.b_a + d[-3:])


@dataclass(frozen=True)
class Inertia:
    """What the IMU says between the poses of a window.

    Attributes:
        b_g, b_a: (3,) biases at which it was integrated.
        dt: (K - 1,) s; delta_R, delta_v, delta_p: increments, as in `Increment`; J: (K - 1, 9, 6) by the biases.
        W: (K - 1, 9, 9) whitens their errors.
    """

    b_g: Vectors
    b_a: Vectors
    dt: Floats
    delta_R: Rotations
    delta_v: Vectors
    delta_p: Vectors
    J: Floats
    W: Floats

    @staticmethod
    def of(window: Window) -> "Inertia":
        """Of a window, integrated once."""
        parts = window.increments
        Q = np.stack([i.Q[:9, :9] for i in parts])
        sigma = np.sqrt(np.diagonal(Q, axis1=1, axis2=2)) + 1e-12
        correlation = Q / (sigma[:, :, None] * sigma[:, None, :]) + _JITTER * np.eye(9)
        return Inertia(
            window.device.b_g,
            window.device.b_a,
            np.array([i.dt for i in parts]),
            np.stack([i.delta_R for i in parts]),
            np.stack([i.delta_v for i in parts]),
            np.stack([i.delta_p for i in parts]),
            np.stack([i.J for i in parts]),
            np.linalg.inv(np.linalg.cholesky(correlation)) / sigma[:, None, :],
        )

    def residuals(self, path: Path) -> tuple[Floats, Floats]:
        """Whitened, with derivatives of the predictions.

        Returns:
            r (K - 1, 9): rotation, position and velocity, and H (K - 1, 9, 24) by dtheta, dp, dv of the pose before,
            of the pose after, and by db_g, db_a. Exact where r vanishes.
        """
        by_bias = self.J @ np.concatenate([path.b_g - self.b_g, path.b_a - self.b_a])
        R_BW, dt = np.swapaxes(path.R[:-1], -1, -2), self.dt[:, None]
        expected = self.delta_R @ so3.exp(by_bias[:, THETA])
        turn = so3.log(np.swapaxes(expected, -1, -2) @ R_BW @ path.R[1:])
        fall = path.p[1:] - path.p[:-1] - path.v[:-1] * dt - 0.5 * G_W * dt * dt
        gain = path.v[1:] - path.v[:-1] - G_W * dt
        s_p, s_v = (R_BW @ fall[..., None])[..., 0], (R_BW @ gain[..., None])[..., 0]
        moved = s_p - self.delta_p - by_bias[:, POSITION]
        gained = s_v - self.delta_v - by_bias[:, VELOCITY]

        H = np.zeros((len(self.dt), 9, 24))
        before, after, bias = H[:, :, :9], H[:, :, 9:18], H[:, :, 18:]
        J_inverse = so3.right_jacobian_inverse(turn)
        before[:, THETA, THETA] = -J_inverse @ np.swapaxes(path.R[1:], -1, -2) @ path.R[:-1]
        after[:, THETA, THETA] = J_inverse
        before[:, POSITION, THETA] = so3.hat(s_p)
        before[:, POSITION, POSITION] = -R_BW
        before[:, POSITION, VELOCITY] = -R_BW * dt[..., None]
        after[:, POSITION, POSITION] = R_BW
        before[:, VELOCITY, THETA] = so3.hat(s_v)
        before[:, VELOCITY, VELOCITY] = -R_BW
        after[:, VELOCITY, VELOCITY] = R_BW
        bias[:] = -self.J
        bias[:, THETA] = -so3.right_jacobian(by_bias[:, THETA]) @ self.J[:, THETA]
        r = -np.concatenate([turn, moved, gained], axis=1)
        return (self.W @ r[..., None])[..., 0], self.W @ H

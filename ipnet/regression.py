"""Where the motion model of a network begins: linear relations in recordings whose velocities and biases are known."""

from dataclasses import dataclass

import numpy as np

from ipnet.dataset import Windows
from ipnet.presets import BLOCK
from navcore.arrays import Floats

DOF = 4.0
"""Of Student's distribution."""
ITERATIONS = 30
RIDGE = 1e-3
"""Of the regressors' mean square: what hardly varies explains nothing."""


@dataclass(frozen=True)
class Relations:
    """r = A v_B + B f_B + C omega_B + n, nearly zero.

    Attributes:
        A, B, C: (6, 3): three rows explain the specific force, three the velocity.
        n: (6,).
        weight: (6,) 1 / sd of a block's residual, less where residuals of successive blocks are alike.
    """

    A: Floats
    B: Floats
    C: Floats
    n: Floats
    weight: Floats


def relations(windows: Windows) -> Relations | None:
    """Found in windows as the network sees them; None where too few have known velocities.

    Means over the network's blocks: the force is explained by velocity and rate, the velocity by the rate.
    """
    blocks = [_blocks(windows.motion(k)) for k in range(len(windows))]  # (blocks, 9) each: omega, f, v
    known = [b for b in blocks if np.isfinite(b).all()]
    if len(known) < 10:
        return None
    X = np.stack(known)
    omega, f, v = X[..., :3], X[..., 3:6], X[..., 6:]
    by_v_omega, n_f, w_f = _regress(np.concatenate([v, omega], axis=2), f)
    by_omega, n_v, w_v = _regress(omega, v)
    zero, eye = np.zeros((3, 3)), np.eye(3)
    return Relations(
        np.vstack([-by_v_omega[:, :3], eye]),
        np.vstack([eye, zero]),
        np.vstack([-by_v_omega[:, 3:], -by_omega]),
        np.concatenate([-n_f, -n_v]),
        np.concatenate([w_f, w_v]),
    )


def _blocks(motion: Floats) -> Floats:
    """(blocks, 9) means of (samples, 9)."""
    mean: Floats = motion.reshape(-1, BLOCK, motion.shape[1]).mean(axis=1)
    return mean


def _regress(x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """y = M x + n over windows (W, blocks, k): M (3, k), n (3,), and the weight of each row of residuals (3,)."""
    rows = [_row(x, y[..., axis]) for axis in range(3)]
    M, n, weight = (np.array(part) for part in zip(*rows, strict=True))
    return M, n, weight


def _row(x: Floats, y: Floats) -> tuple[Floats, float, float]:
    """y = m x + n over windows, y (W, blocks): m (k,), n, and the weight of the residuals.

    Their distribution is Student's: most of a recording is one kind of motion, but not all.
    """
    flat_x, flat_y = x.reshape(-1, x.shape[2]), y.reshape(-1)
    q = np.ones(len(flat_y))
    for _ in range(ITERATIONS):
        mean_x, mean_y = np.average(flat_x, axis=0, weights=q), np.average(flat_y, weights=q)
        dx = flat_x - mean_x
        second = (q[:, None] * dx).T @ dx
        ridge = RIDGE * np.trace(second) / len(second) * np.eye(len(second))
        m = np.linalg.solve(second + ridge, (q[:, None] * dx).T @ (flat_y - mean_y))
        n = mean_y - m @ mean_x
        r = flat_y - flat_x @ m - n
        variance = float((q * r**2).mean())
        q = (DOF + 1.0) / (DOF + r**2 / variance)
    r = (np.sqrt(q) * r).reshape(y.shape)
    alike = np.clip((r[:, 1:] * r[:, :-1]).mean() / variance, 0.0, 0.98)
    return m, float(n), float(np.sqrt((1.0 - alike) / (1.0 + alike) / variance))

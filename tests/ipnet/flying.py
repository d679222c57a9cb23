"""A toy that moves as a quadrotor does: specific force across its thrust is drag, along it there is some motion."""

import numpy as np

from ipnet.dataset import Track
from ipnet.presets import NetworkConfig
from navcore import so3
from navcore.imu import GRAVITY, ImuSamples

SMALL = NetworkConfig(192, 24.0, channels=(4, 4, 4, 8), kernel=3, hidden=8, heads=2, predictions=5, pieces=(2, 1, 1))
"""Windows of 8 s."""
DRAG = 0.2  # 1/s


def flight(seed, seconds=30.0, bias=None, rate=96.0):
    """A track: turning at random, its velocity what drag and specific force along z make of it."""
    rng = np.random.default_rng(seed)
    n, dt = round(seconds * rate), 1.0 / rate
    bias = rng.normal(size=6) * np.repeat([0.01, 0.05], 3) if bias is None else np.asarray(bias)
    t = (np.arange(n) + 0.5) * dt
    waves = rng.normal(size=(3, 4)), rng.uniform(0.3, 1.5, (3, 4)), rng.uniform(0.0, 6.0, (3, 4))
    angles = 0.12 * (waves[0][:, None] * np.sin(waves[1][:, None] * t[None, :, None] + waves[2][:, None])).sum(-1).T
    R = so3.exp(angles)
    omega = so3.log(np.swapaxes(R[:-1], 1, 2) @ R[1:]) / dt
    omega = np.vstack([omega, omega[-1:]])
    g_W, v, force, velocity = np.array([0.0, 0.0, -GRAVITY]), np.zeros(3), np.zeros((n, 3)), np.zeros((n, 3))
    for k in range(n):
        v_B = R[k].T @ v
        lift = R[k].T @ -g_W
        force[k] = [-DRAG * v_B[0], -DRAG * v_B[1], lift[2] - 0.5 * v_B[2]]
        velocity[k] = v_B
        v = v + dt * (R[k] @ force[k] + g_W)
    noisy = np.hstack([omega, force]) + bias + 1e-3 * rng.normal(size=(n, 6))
    t_ns = np.round(t * 1e9).astype(np.int64)
    return Track(f"flight-{seed}", ImuSamples(t_ns, noisy[:, :3], noisy[:, 3:]), np.tile(bias, (n, 1)), velocity)

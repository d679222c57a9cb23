"""A body that moves as a quadrotor does, integrated cell by cell: across its thrust there is drag and nothing else."""

import numpy as np

from ipnet.recordings import labelled
from navcore import so3
from navcore.calibration import Calibration
from navcore.imu import GRAVITY, ImuNoise, ImuSamples
from navcore.sequence import Sequence
from navcore.trajectory import Trajectory

RATE = 100.0
DRAG = 0.3  # 1/s
NOISE = ImuNoise(2e-4, 1e-6, 2e-3, 1e-5, RATE)
G_W = np.array([0.0, 0.0, -GRAVITY])


def drone(seed, seconds=40.0, bias=(0.0,) * 6, noisy=True, rest_s=0.0):
    """A recording: it tilts towards places drawn at random, and turns on and off its heading."""
    rng = np.random.default_rng(seed)
    n, dt = round(seconds * RATE), 1.0 / RATE
    R, v, p = so3.exp(np.array([0.0, 0.0, rng.uniform(-3.0, 3.0)])), np.zeros(3), np.array([0.0, 0.0, 1.0])
    phases = rng.uniform(0.0, 6.0, (2, 3, 3))
    speeds = rng.uniform(0.3, 1.2, (2, 3, 3))
    states, said = [], []
    for k in range(n):
        t = k * dt
        states.append((R, v, p))
        if t < rest_s:
            said.append(np.concatenate([np.zeros(3), -R.T @ G_W]))
            continue
        goal = np.array([1.5, 1.5, 0.5]) * np.sin(speeds[0] * t + phases[0]).sum(axis=1) + [0.0, 0.0, 1.0]
        wanted = 1.5 * (goal - p) - 2.0 * v - G_W
        up = wanted / np.linalg.norm(wanted)
        tilt = R.T @ np.cross(R[:, 2], up)
        omega = np.array([4.0 * tilt[0], 4.0 * tilt[1], 0.6 * np.sin(speeds[1, 0] * t + phases[1, 0]).sum()])
        v_B = R.T @ v
        force = np.array([-DRAG * v_B[0], -DRAG * v_B[1], wanted @ R[:, 2]])
        said.append(np.concatenate([omega, force]))
        v_next = v + (R @ so3.exp(0.5 * omega * dt) @ force + G_W) * dt
        p, v, R = p + 0.5 * (v + v_next) * dt, v_next, R @ so3.exp(omega * dt)
    t_ns = np.round((np.arange(n) + 0.5) * 1e9 * dt).astype(np.int64)
    values = np.array(said) + bias
    if noisy:
        density = np.repeat([NOISE.gyroscope_noise_density, NOISE.accelerometer_noise_density], 3)
        values = values + density * np.sqrt(RATE) * rng.standard_normal((n, 6))
        values[t_ns * 1e-9 > rest_s, 5] += 0.8 * rng.standard_normal(int((t_ns * 1e-9 > rest_s).sum()))  # rotors shake
    q = so3.to_quaternion(np.array([s[0] for s in states]))
    v_WB, p_WB = np.array([s[1] for s in states]), np.array([s[2] for s in states])
    known = np.tile(np.asarray(bias, dtype=np.float64), (n, 1))
    truth = Trajectory(t_ns - round(0.5e9 * dt), q, p_WB, v_WB, known[:, :3], known[:, 3:])
    imu = ImuSamples(t_ns, values[:, :3], values[:, 3:])
    return labelled(Sequence(f"drone-{seed}", Calibration(NOISE), imu, (), truth))

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from navcore.imu import GRAVITY, ImuSamples
from navcore.trajectory import Trajectory
from sim import simulate_motion
from sim.imu import ideal_samples
from sim.motion import EPOCH_NS, Motion

HALF_NS = 2_500_000


def integrate(samples: ImuSamples, start: Trajectory) -> tuple[Rotation, np.ndarray, np.ndarray]:
    """Rate and force constant over each interval, the force integrated at three Gauss points."""
    dt = 2e-9 * HALF_NS
    nodes = 0.5 + 0.5 * np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])
    weights = np.array([5.0, 8.0, 5.0]) / 18.0
    assert start.v_WB is not None
    R, p, v = Rotation.from_quat(start.q_WB[0]), start.p_WB[0], start.v_WB[0]
    g_W = np.array([0.0, 0.0, -GRAVITY])
    turns = Rotation.from_rotvec(samples.gyro * dt)
    at_nodes = [Rotation.from_rotvec(samples.gyro * dt * c).apply(samples.accel.copy()) for c in nodes]
    for k in range(len(samples)):
        a = [R.apply(f[k]) + g_W for f in at_nodes]
        p = p + v * dt + dt**2 * sum(w * (1.0 - c) * x for w, c, x in zip(weights, nodes, a, strict=True))
        v = v + dt * sum(w * x for w, x in zip(weights, a, strict=True))
        R = R * turns[k]
    return R, p, v


def test_noise_free_samples_integrate_back_to_truth_over_a_minute() -> None:
    motion = simulate_motion("quadrotor", 60.0, seed=2)
    samples = ideal_samples(motion, 200.0)
    ends = motion.at(np.array([samples.t_ns[0] - HALF_NS, samples.t_ns[-1] + HALF_NS]))
    R, p, v = integrate(samples, ends[:1])
    assert ends.v_WB is not None
    assert np.linalg.norm(p - ends.p_WB[1]) < 1e-4
    assert np.linalg.norm(v - ends.v_WB[1]) < 1e-7
    assert (R.inv() * Rotation.from_quat(ends.q_WB[1])).magnitude() < 1e-9


def test_samples_are_interval_means_of_the_fine_signal(flight: Motion) -> None:
    samples = ideal_samples(flight, 200.0)
    means = flight.omega_B[: 5 * len(samples)].reshape(-1, 5, 3).mean(axis=1)
    forces = flight.specific_force_B[: 5 * len(samples)].reshape(-1, 5, 3).mean(axis=1)
    np.testing.assert_allclose(samples.gyro, means, atol=2e-4)  # coning is compensated in samples, not in means
    np.testing.assert_allclose(samples.accel, forces, atol=5e-3)
    assert samples.t_ns[0] == EPOCH_NS + HALF_NS


@pytest.mark.parametrize("rate_hz", [100.0, 333.0])
def test_other_rates_cover_the_motion(flight: Motion, rate_hz: float) -> None:
    samples = ideal_samples(flight, rate_hz)
    assert len(samples) == int(20.0 * rate_hz)
    turned = Rotation.identity()
    for step in Rotation.from_rotvec(samples.gyro / rate_hz):
        turned = turned * step
    end = flight.at(np.array([samples.t_ns[-1] + round(0.5e9 / rate_hz)])).R_WB[0]
    assert (turned.inv() * Rotation.from_matrix(flight.R_WB[0].T @ end)).magnitude() < 1e-6

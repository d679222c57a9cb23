import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from navcore.imu import GRAVITY, ImuSamples
from navcore.trajectory import Trajectory
from sim import simulate_motion
from sim.errors import ConfigError
from sim.imu import GRADES, grade, ideal_samples, simulate_imu
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
    np.testing.assert_allclose(samples.gyro, means, atol=2e-5)
    np.testing.assert_allclose(samples.accel, forces, atol=2e-3)
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


def test_noise_and_biases_have_the_stated_sizes() -> None:
    """At rest, where every error shows; bounds are four standard errors of the estimate."""
    n = 100_001
    still = Motion.from_states(5e-3, np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), np.zeros((n, 3)))
    imu = GRADES["adis16448"]
    samples, truth = simulate_imu(still, imu, np.random.default_rng(4))
    noise, count = imu.noise, 3 * (n - 1)
    assert truth.b_g is not None and truth.b_a is not None
    for measured, clean, bias, density, walk in (
        (samples.gyro, 0.0, truth.b_g, noise.gyroscope_noise_density, noise.gyroscope_random_walk),
        (
            samples.accel,
            [0, 0, GRAVITY],
            truth.b_a,
            noise.accelerometer_noise_density,
            noise.accelerometer_random_walk,
        ),
    ):
        white = measured - clean - bias
        assert np.std(white) == pytest.approx(density * np.sqrt(200.0), rel=4.0 / np.sqrt(2 * count))
        assert np.std(np.diff(bias, axis=0)) == pytest.approx(walk * np.sqrt(5e-3), rel=4.0 / np.sqrt(2 * count))
        assert abs(np.corrcoef(white[1:, 0], white[:-1, 0])[0, 1]) < 4.0 / np.sqrt(n)


def test_turn_on_biases_spread_over_seeds(flight: Motion) -> None:
    short = flight.after(19.9)
    truths = [simulate_imu(short, GRADES["adis16448"], np.random.default_rng(k))[1] for k in range(300)]
    assert np.std([t.b_g[0] for t in truths]) == pytest.approx(0.03, rel=0.1)
    assert np.std([t.b_a[0] for t in truths]) == pytest.approx(0.1, rel=0.1)


def test_an_unknown_grade_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"known are .*adis16448"):
        grade("toy")

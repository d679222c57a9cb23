"""What samples tell of vibration, and what it does to a filter that knows of it or does not."""

from dataclasses import replace

import numpy as np
import pytest

from eval.consistency import judge, nees
from navcore.imu import ImuNoise, ImuSamples
from navcore.sequence import Sequence
from navcore.vibration import noise_under_vibration
from sim.points import simulate_points
from tests.msckf.flights import fly

RATE = 200.0
NOISE = ImuNoise(1.7e-4, 1.9e-5, 2.0e-3, 3.0e-3, RATE, vibration_share=0.1)
AT_REST = np.array([NOISE.gyroscope_noise_density, NOISE.accelerometer_noise_density])


def densities(gyro, accel, noise=NOISE, t_ns=None):
    t_ns = np.arange(len(gyro)) * 5_000_000 if t_ns is None else t_ns
    told = noise_under_vibration(noise, t_ns, gyro, accel)
    return np.array([told.gyroscope_noise_density, told.accelerometer_noise_density])


def white(n, sigmas, seed=1):
    rng = np.random.default_rng(seed)
    return [sigma * rng.standard_normal((n, 3)) for sigma in sigmas]


def test_at_rest_the_noise_is_the_calibrations():
    assert densities(*white(4000, AT_REST * np.sqrt(RATE))) == pytest.approx(AT_REST, rel=1e-3)


def test_hard_motion_is_no_vibration():
    t = np.arange(80)[:, None] / RATE
    gyro, accel = white(80, AT_REST * np.sqrt(RATE))
    swing = np.sin(2.0 * np.pi * 4.0 * t + np.array([0.0, 1.0, 2.0]))
    assert densities(gyro + 3.0 * swing, accel + 15.0 * swing) == pytest.approx(AT_REST, rel=0.02)


def test_the_share_of_what_is_beyond_the_noise_at_rest_is_added_in_power():
    shaking = np.array([0.05, 1.4])
    added = 0.1 * shaking / np.sqrt(RATE)
    assert densities(*white(4000, np.hypot(shaking, AT_REST * np.sqrt(RATE)))) == pytest.approx(
        np.hypot(AT_REST, added), rel=0.03
    )


def test_without_a_share_nothing_is_added():
    still = replace(NOISE, vibration_share=0.0)
    assert noise_under_vibration(still, np.arange(80) * 5_000_000, *white(80, (0.05, 1.4))) is still


def test_a_jump_over_a_gap_is_no_vibration():
    gyro, accel = white(80, AT_REST * np.sqrt(RATE))
    t_ns = np.arange(80) * 5_000_000
    t_ns[40:] += 1_000_000_000
    accel[40:] += 20.0
    assert densities(gyro, accel, t_ns=t_ns) == pytest.approx(AT_REST, rel=0.02)


@pytest.mark.parametrize("n", [0, 4])
def test_too_few_samples_show_nothing(n):
    assert noise_under_vibration(NOISE, np.arange(n) * 5_000_000, *white(n, (1.0, 1.0))) is NOISE


def shaken(sequence: Sequence, share: float, seed: int) -> Sequence:
    """A flight whose IMU shakes by 0.05 rad/s and 1.4 m/s^2, a tenth of it white; its calibration says `share`."""
    imu, rng = sequence.imu, np.random.default_rng([seed, 3])

    def shaking(amplitude):
        fast = np.diff(rng.standard_normal((len(imu) + 4, 3)), n=4, axis=0) / np.sqrt(70.0)
        return amplitude * (fast + 0.1 * rng.standard_normal((len(imu), 3)))

    samples = ImuSamples(imu.t_ns, imu.gyro + shaking(0.05), imu.accel + shaking(1.4))
    noise = replace(sequence.calibration.imu, vibration_share=share)
    return replace(sequence, imu=samples, calibration=replace(sequence.calibration, imu=noise))


def test_a_filter_that_knows_of_vibration_is_as_sure_as_it_may_be():
    flight = simulate_points("handheld", seed=1, seconds=15.0)

    def of_velocity(share):
        sequence = shaken(flight, share, 1)
        return judge([nees(fly(sequence), sequence.truth, skip_s=4.0)]).mean_per_dof[2]

    assert of_velocity(0.0) > 4.0
    assert of_velocity(0.1) < 2.0

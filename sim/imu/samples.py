"""Samples of a motion: centred interval means, white noise, biases that walk, and what the device does to them."""

from dataclasses import replace

import numpy as np

from navcore.arrays import Floats, Stamps, Vectors
from navcore.imu import ImuSamples
from navcore.trajectory import Trajectory
from sim.imu.grades import ImuGrade, Triad
from sim.motion import Motion


def stamps(motion: Motion, rate_hz: float) -> Stamps:
    """(N,) ns: the centres of all whole sampling intervals of a motion."""
    n = int(motion.duration_s * rate_hz + 1e-6)
    centres: Stamps = motion.start_ns + np.rint((np.arange(n) + 0.5) * 1e9 / rate_hz).astype(np.int64)
    return centres


def ideal_samples(motion: Motion, rate_hz: float) -> ImuSamples:
    """Samples without any error: each holds over [t - dt/2, t + dt/2], and the intervals join without gaps.

    A sample is the constant rate and specific force that take the true attitude and velocity from one end of
    its interval to the other: the mean over the interval with its coning and sculling compensated, as good
    IMUs do. So piecewise-constant integration over the intervals gives the true attitude and velocity at
    every edge exactly, and position to micrometres a minute. Plain means of the rate would miss 3e-6 rad a
    minute of flight by coning, which gravity turns into centimetres.
    """
    dt_s = 1.0 / rate_hz
    t_ns = stamps(motion, rate_hz)
    half_ns = round(0.5e9 * dt_s)
    cells = motion.resampled(np.append(t_ns - half_ns, t_ns[-1] + half_ns), dt_s)
    return ImuSamples(t_ns, cells.omega_B, cells.specific_force_B)


def exact_imu(motion: Motion, rate_hz: float) -> tuple[ImuSamples, Trajectory]:
    """Samples without any error, and the truth at their stamps with biases of zero."""
    samples = ideal_samples(motion, rate_hz)
    zero = np.zeros((len(samples), 3))
    return samples, replace(motion.at(samples.t_ns), b_g=zero, b_a=zero)


def simulate_imu(motion: Motion, imu: ImuGrade, rng: np.random.Generator) -> tuple[ImuSamples, Trajectory]:
    """Noisy samples, and the truth at their stamps with the biases that are in them.

    White noise of density s has sd s sqrt(rate) in a mean over one interval. Biases start at the turn-on
    spread and take steps of random_walk sqrt(dt) (Kalibr's noise model). A device that is not calibrated
    sees the true signal through `I + E`, E drawn once; the sum is rounded to the device's step and held
    within its range.
    """
    noise = imu.noise
    clean = ideal_samples(motion, noise.rate_hz)
    size = (len(clean), 3)
    b_g = _bias(imu.gyroscope.turn_on, noise.gyroscope_random_walk, noise.rate_hz, size, rng)
    b_a = _bias(imu.accelerometer.turn_on, noise.accelerometer_random_walk, noise.rate_hz, size, rng)
    white = np.sqrt(noise.rate_hz)
    n_g = noise.gyroscope_noise_density * white * rng.standard_normal(size)
    n_a = noise.accelerometer_noise_density * white * rng.standard_normal(size)
    true_gyro, true_accel = clean.gyro, clean.accel
    if not imu.calibrated:
        true_gyro = true_gyro @ _deformation(imu.gyroscope, rng).T
        true_accel = true_accel @ _deformation(imu.accelerometer, rng).T
    gyro = _digitised(true_gyro + b_g + n_g, imu.gyroscope)
    accel = _digitised(true_accel + b_a + n_a, imu.accelerometer)
    return ImuSamples(clean.t_ns, gyro, accel), replace(motion.at(clean.t_ns), b_g=b_g, b_a=b_a)


def _bias(turn_on: float, walk: float, rate_hz: float, size: tuple[int, int], rng: np.random.Generator) -> Vectors:
    steps = walk / np.sqrt(rate_hz) * rng.standard_normal(size)
    steps[0] = turn_on * rng.standard_normal(size[1])
    bias: Vectors = np.cumsum(steps, axis=0)
    return bias


def _deformation(triad: Triad, rng: np.random.Generator) -> Floats:
    """(3, 3): what the axes of one device make of a true vector."""
    spread = np.where(np.eye(3, dtype=bool), triad.scale, triad.misalignment)
    deformed: Floats = np.eye(3) + spread * rng.standard_normal((3, 3))
    return deformed


def _digitised(values: Vectors, triad: Triad) -> Vectors:
    return np.clip(triad.lsb * np.rint(values / triad.lsb), -triad.limit, triad.limit)

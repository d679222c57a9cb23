"""A simulated hour: the filter needs no more in its last minutes than in its first. Run with `tox -e bench`."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from msckf import Filter
from navcore.imu import ImuSamples
from navcore.odometry import Estimate
from navcore.sequence import Frame, Tracks
from sim.motion import Motion
from sim.points import simulate_points

pytestmark = pytest.mark.bench

LAP_S, RATE_HZ = 60, 20
MINUTES = 60


def lap() -> Motion:
    """A closed way through a room, and a second more of it."""
    t = np.arange(1000 * (LAP_S + 1) + 1) * 1e-3
    w = 2.0 * np.pi / LAP_S * np.array([7.0, 9.0, 11.0])  # rad/s
    size = np.array([1.5, 1.2, 0.4])  # m
    angle = w * t[:, None] + [0.0, 1.0, 2.0]
    R_WB = Rotation.from_euler("ZYX", [0.8, 0.15, 0.15] * np.sin(angle[:, ::-1])).as_matrix()
    return Motion.from_states(1e-3, R_WB, size * np.sin(angle), size * w * np.cos(angle))


def laps(sequence, rng: np.random.Generator) -> Iterator[ImuSamples | Frame]:
    """A recording of a lap as many, with noise that never repeats; features begin anew with each."""
    imu, noise = sequence.imu, sequence.calibration.imu
    n = round(LAP_S * noise.rate_hz)
    lap_of_imu = slice(round(0.2 * noise.rate_hz), round(0.2 * noise.rate_hz) + n)  # goes on past the last frame
    t_ns, exact = imu.t_ns[lap_of_imu], np.hstack([imu.gyro, imu.accel])[lap_of_imu]
    white, walk = (
        np.repeat([gyro * s, accel * s], 3)
        for gyro, accel, s in (
            (noise.gyroscope_noise_density, noise.accelerometer_noise_density, noise.rate_hz**0.5),
            (noise.gyroscope_random_walk, noise.accelerometer_random_walk, noise.rate_hz**-0.5),
        )
    )
    bias = np.repeat([0.01, 0.1], 3)
    for k in range(MINUTES):
        shift = k * LAP_S * 1_000_000_000
        biases = bias + np.cumsum(walk * rng.standard_normal((n, 6)), axis=0)
        bias = biases[-1]
        said = exact + biases + white * rng.standard_normal((n, 6))
        samples = ImuSamples(t_ns + shift, said[:, :3], said[:, 3:])
        frames = []
        for frame in sequence.frames[: LAP_S * RATE_HZ]:
            ids, uv = frame.tracks[0].ids + k * 1_000_000, frame.tracks[0].uv
            frames.append(Frame(frame.t_ns + shift, tracks={0: Tracks(ids, uv + rng.standard_normal(uv.shape))}))
        yield from dataclasses.replace(sequence, imu=samples, frames=frames).events()


def resident_mb() -> float:
    """Memory that this process holds."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20


def fed(vio: Filter, event: ImuSamples | Frame) -> list[Estimate]:
    """What a filter answers."""
    return vio.add_frame(event) if isinstance(event, Frame) else vio.add_imu(event)


def cpu_ms(estimates: list[Estimate]) -> list[float]:
    """Of each."""
    return [1e3 * sum(estimate.stages.values()) for estimate in estimates]


def test_an_hour_costs_what_a_minute_costs():
    """In its last minutes a filter runs beside a new one, on the same input: so nothing else tells them apart."""
    motion = lap()
    sequence = simulate_points(motion=motion, noisy_imu=False, pixel_noise=0.0)
    old, new = Filter(sequence.calibration), Filter(sequence.calibration)
    memory, where, health, minute = [], [], set(), LAP_S * RATE_HZ
    old_ms, new_ms = [], []
    with threadpool_limits(1):
        for event in laps(sequence, np.random.default_rng(0)):
            both = len(old_ms) > (MINUTES - 3) * minute
            new_first = both and len(old_ms) % 2 == 1  # the second one finds the processor's caches warm
            if new_first:
                new_ms += cpu_ms(fed(new, event))
            estimates = fed(old, event)
            old_ms += cpu_ms(estimates)
            health |= {estimate.health.name for estimate in estimates}
            if estimates and len(old_ms) % minute == 0:
                memory.append(resident_mb())
                where.append(estimates[-1].state.p_WB)
            if both and not new_first:
                new_ms += cpu_ms(fed(new, event))
    print(f"\n{MINUTES} minutes of points: memory in MB; CPU ms a frame (mean, median, most)")
    for k in [*range(4), *range(MINUTES - 4, MINUTES)]:
        costs = old_ms[k * minute : (k + 1) * minute]
        print(
            f"  minute {k + 1:2d} {memory[k]:7.2f} {np.mean(costs):7.2f} {np.median(costs):7.2f} {np.max(costs):7.2f}"
        )
    old_mean, new_mean = np.mean(old_ms[-2 * minute :]), np.mean(new_ms[-2 * minute :])
    print(f"  last two minutes {old_mean:.2f} ms a frame, a new filter in the same minutes {new_mean:.2f}")
    drift, way = np.linalg.norm(where[-1] - where[0]), (MINUTES - 1) * motion.length * LAP_S / motion.duration_s
    print(f"  {drift:.2f} m from where it was after the first lap, {way:.0f} m ago; health {', '.join(sorted(health))}")
    assert health == {"INITIALISING", "TRACKING"}
    assert np.mean(memory[-8:-3]) < 1.02 * np.mean(memory[1:6])  # before there were two
    assert old_mean < 1.1 * new_mean

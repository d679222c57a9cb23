"""Samples of a device at rest, where every error shows, against AllanTools and the data sheets."""

import hashlib
import os
from dataclasses import replace
from pathlib import Path

import allantools
import numpy as np
import pytest

from navcore import so3
from navcore.calibration import imu_from_yaml
from navcore.imu import GRAVITY, ImuSamples
from navcore.trajectory import Trajectory
from sim.errors import ConfigError
from sim.imu import GRADES, ImuGrade, allan_floor, grade, grade_table, simulate_imu
from sim.motion import Motion

RATE_HZ = 200.0
SECONDS = 250
GROUP = 10  # samples that the Allan deviation averages: .05 s, where neither rounding nor the walk is seen


def still(seconds: float) -> Motion:
    n = round(seconds * RATE_HZ) + 1
    return Motion.from_states(1.0 / RATE_HZ, np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), np.zeros((n, 3)))


def spinning(rate: np.ndarray, seconds: float) -> Motion:
    """A body that turns at a constant rate (3,) rad/s about a fixed axis in W, its origin at rest."""
    n = round(seconds * 1000.0) + 1
    R = so3.exp(np.arange(n)[:, None] * 1e-3 * rate)
    return Motion.from_states(1e-3, R, np.zeros((n, 3)), np.zeros((n, 3)))


def allan_deviation(values: np.ndarray) -> float:
    """At tau = GROUP samples, over the three axes."""
    axes = [allantools.oadev(v, rate=RATE_HZ, data_type="freq", taus=[GROUP / RATE_HZ])[1][0] for v in values.T]
    return float(np.sqrt(np.mean(np.square(axes))))


@pytest.fixture(scope="module", params=list(GRADES))
def rested(request: pytest.FixtureRequest) -> tuple[ImuGrade, ImuSamples, Trajectory]:
    imu = grade(request.param)
    return imu, *simulate_imu(still(SECONDS), imu, np.random.default_rng(4))


def test_allan_deviation_gives_the_noise_density_back(rested: tuple[ImuGrade, ImuSamples, Trajectory]) -> None:
    imu, samples, _ = rested
    root_tau = np.sqrt(GROUP / RATE_HZ)
    assert allan_deviation(samples.gyro) * root_tau == pytest.approx(imu.noise.gyroscope_noise_density, rel=0.05)
    assert allan_deviation(samples.accel) * root_tau == pytest.approx(imu.noise.accelerometer_noise_density, rel=0.05)


def test_returned_biases_walk_as_stated(rested: tuple[ImuGrade, ImuSamples, Trajectory]) -> None:
    """Increments at four standard errors; and by Allan deviation, which is walk sqrt(tau / 3)."""
    imu, samples, truth = rested
    assert truth.b_g is not None and truth.b_a is not None
    within = 4.0 / np.sqrt(6.0 * len(samples))
    for bias, walk in (
        (truth.b_g, imu.noise.gyroscope_random_walk),
        (truth.b_a, imu.noise.accelerometer_random_walk),
    ):
        steps = np.diff(bias, axis=0)
        assert np.sqrt(np.mean(steps**2)) == pytest.approx(walk / np.sqrt(RATE_HZ), rel=within)
        assert allan_deviation(bias) == pytest.approx(walk * np.sqrt(GROUP / RATE_HZ / 3.0), rel=0.05)


def test_what_is_left_is_white(rested: tuple[ImuGrade, ImuSamples, Trajectory]) -> None:
    _, samples, truth = rested
    assert truth.b_g is not None and truth.b_a is not None
    for left in (samples.gyro - truth.b_g, samples.accel - truth.b_a - [0.0, 0.0, GRAVITY]):
        assert np.abs(left.mean(axis=0)).max() < 4.5 * left.std() / np.sqrt(len(left))
        correlations = [np.corrcoef(left[lag:, k], left[:-lag, k])[0, 1] for lag in (1, 7) for k in range(3)]
        assert np.abs(correlations).max() < 4.5 / np.sqrt(len(left))


def test_samples_lie_on_the_steps_of_the_device(rested: tuple[ImuGrade, ImuSamples, Trajectory]) -> None:
    imu, samples, _ = rested
    for values, triad in ((samples.gyro, imu.gyroscope), (samples.accel, imu.accelerometer)):
        steps = values / triad.lsb
        np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
        assert len(np.unique(np.rint(steps))) > 10


@pytest.mark.parametrize("name", list(GRADES))
def test_rounding_adds_less_than_a_hundredth_to_the_noise(name: str) -> None:
    imu = GRADES[name]
    white = np.array([imu.noise.gyroscope_noise_density, imu.noise.accelerometer_noise_density]) * np.sqrt(RATE_HZ)
    rounding = np.array([imu.gyroscope.lsb, imu.accelerometer.lsb]) / np.sqrt(12.0)
    assert np.all(np.hypot(white, rounding) < 1.01 * white)


def test_samples_stay_within_the_range() -> None:
    imu = grade("cheap")  # 500 deg/s, 8 g
    fast = spinning(np.array([0.0, 0.0, 12.0]), 1.0)
    samples, _ = simulate_imu(fast, imu, np.random.default_rng(1))
    np.testing.assert_array_equal(samples.gyro[:, 2], np.deg2rad(500.0))
    assert np.abs(samples.gyro[:, :2]).max() < 1.0
    heavy = replace(imu, accelerometer=replace(imu.accelerometer, limit=5.0))
    samples, _ = simulate_imu(still(1.0), heavy, np.random.default_rng(1))
    np.testing.assert_array_equal(samples.accel[:, 2], 5.0)


def test_an_uncalibrated_device_is_skewed_by_the_same_matrix_throughout() -> None:
    """Sensed rates of turns about three axes give the matrix; over devices it has the stated spread."""
    imu = grade("cheap-uncalibrated")
    quiet = replace(imu, noise=replace(imu.noise, gyroscope_noise_density=0.0, gyroscope_random_walk=0.0))
    exact = replace(quiet, gyroscope=replace(quiet.gyroscope, turn_on=0.0, lsb=1e-9))
    turns = [spinning(axis, 0.05) for axis in np.eye(3)]
    errors = []
    for device in range(120):
        sensed = [simulate_imu(turn, exact, np.random.default_rng(device))[0].gyro for turn in turns]
        assert max(np.ptp(s, axis=0).max() for s in sensed) < 1e-8
        errors.append(np.array([s[0] for s in sensed]).T - np.eye(3))
    on_axis = np.array([np.diag(e) for e in errors])
    across = np.array([e[~np.eye(3, dtype=bool)] for e in errors])
    assert np.std(on_axis) == pytest.approx(imu.gyroscope.scale, rel=4.0 / np.sqrt(2 * on_axis.size))
    assert np.std(across) == pytest.approx(imu.gyroscope.misalignment, rel=4.0 / np.sqrt(2 * across.size))


def test_calibration_changes_nothing_else() -> None:
    a, b = (simulate_imu(still(1.0), grade(f"consumer{c}"), np.random.default_rng(3)) for c in ("", "-uncalibrated"))
    assert a[1].b_g is not None and b[1].b_g is not None
    np.testing.assert_array_equal(a[1].b_g, b[1].b_g)
    np.testing.assert_array_equal(a[0].gyro, b[0].gyro)  # at rest there is no rate to skew
    lean = (b[0].accel - a[0].accel).mean(axis=0)
    assert 1e-3 < np.abs(lean).max() < 5.0 * 0.005 * GRAVITY


def test_turn_on_biases_spread_over_devices() -> None:
    imu = grade("consumer")
    truths = [simulate_imu(still(0.05), imu, np.random.default_rng(k))[1] for k in range(400)]
    within = 4.0 / np.sqrt(2 * 3 * 400)
    assert np.std([t.b_g[0] for t in truths if t.b_g is not None]) == pytest.approx(imu.gyroscope.turn_on, rel=within)
    assert np.std([t.b_a[0] for t in truths if t.b_a is not None]) == pytest.approx(
        imu.accelerometer.turn_on, rel=within
    )


@pytest.mark.parametrize(
    ("name", "gyroscope_deg_h", "accelerometer_mg"),
    [("tactical", 0.5, 0.05), ("n100", 20.0, 0.35), ("cheap", 30.0, 0.5)],
)
def test_random_walks_have_the_floors_they_are_said_to_have(
    name: str, gyroscope_deg_h: float, accelerometer_mg: float
) -> None:
    noise = GRADES[name].noise
    floor_g = allan_floor(noise.gyroscope_noise_density, noise.gyroscope_random_walk)
    floor_a = allan_floor(noise.accelerometer_noise_density, noise.accelerometer_random_walk)
    assert np.rad2deg(floor_g) * 3600.0 == pytest.approx(gyroscope_deg_h, rel=0.01)
    assert floor_a / 9.80665e-3 == pytest.approx(accelerometer_mg, rel=0.01)


def test_the_floor_is_the_least_allan_deviation() -> None:
    """A second of white noise and walk of equal weight: the floor is at sqrt(3) s."""
    rng = np.random.default_rng(2)
    values = np.sqrt(RATE_HZ) * rng.standard_normal(400_000) + np.cumsum(rng.standard_normal(400_000)) / np.sqrt(
        RATE_HZ
    )
    deviations = allantools.oadev(values, rate=RATE_HZ, data_type="freq", taus=[0.5, 1.0, 1.73, 3.0, 6.0])[1]
    assert int(np.argmin(deviations)) == 2
    assert deviations.min() == pytest.approx(allan_floor(1.0, 1.0), rel=0.05)


@pytest.mark.skipif("VIO_DATA" not in os.environ, reason="needs the recordings folder in VIO_DATA")
def test_the_table_says_what_the_recordings_say() -> None:
    data = Path(os.environ["VIO_DATA"])
    for file, name in (("euroc/V1_01_easy/mav0/imu0/sensor.yaml", "adis16448"), ("tumvi/imu.yaml", "consumer")):
        real = imu_from_yaml(data / file)
        assert real.vibration_share > 0.0
        assert replace(real, vibration_share=0.0) == GRADES[name].noise  # what is simulated does not vibrate
    rows = np.loadtxt(data / "euroc/V1_01_easy/mav0/imu0/data.csv", delimiter=",", skiprows=1, max_rows=2000)
    gyro, accel = rows[:, 1:4], rows[:, 4:7]
    for values, triad in ((gyro, GRADES["adis16448"].gyroscope), (accel, GRADES["adis16448"].accelerometer)):
        steps = values / triad.lsb
        np.testing.assert_allclose(steps, np.rint(steps), atol=1e-3)


def test_grades_get_worse_down_the_table() -> None:
    floors = [allan_floor(g.noise.gyroscope_noise_density, g.noise.gyroscope_random_walk) for g in GRADES.values()]
    assert sorted(floors) == floors
    assert list(GRADES) == ["tactical", "adis16448", "consumer", "n100", "cheap"]


def test_the_numbers_are_frozen_with_the_benchmark() -> None:
    """A change here makes results incomparable with those before it: it needs a new version of the benchmark."""
    numbers = [(name, g.noise, g.gyroscope, g.accelerometer) for name, g in GRADES.items()]
    frozen = repr(numbers).replace(", vibration_share=0.0", "")  # a field that is younger; none of them vibrates
    assert hashlib.sha256(frozen.encode()).hexdigest()[:16] == "103f9876485b356d"


def test_the_documented_table_names_every_grade_and_its_source() -> None:
    table = grade_table()
    for name, imu in GRADES.items():
        assert f"| `{name}` | gyroscope | {imu.noise.gyroscope_noise_density:.3g} |" in table
        assert all(source in table for source in imu.sources)


def test_an_unknown_grade_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"known are .*adis16448"):
        grade("toy")

"""IMU grades: how noisy, how biased, how coarse; one table, with where each number comes from.

The numbers are frozen with the benchmark: results are comparable as long as none of them changes.
"""

import math
from dataclasses import dataclass, replace

from navcore.imu import ImuNoise
from sim.errors import ConfigError

DEG = math.pi / 180.0  # rad
MG = 9.80665e-3  # m/s^2
_UNCALIBRATED = "-uncalibrated"


@dataclass(frozen=True)
class Triad:
    """Errors of three gyroscopes [rad/s] or three accelerometers [m/s^2], beyond their noise.

    Attributes:
        turn_on: sd per axis of the bias at the first sample.
        limit: largest magnitude that can be said.
        lsb: step between two values that can be said.
        scale: sd per axis of the scale error, 1.
        misalignment: sd of the angle by which an axis leans towards each of the others, rad.
    """

    turn_on: float
    limit: float
    lsb: float
    scale: float
    misalignment: float


@dataclass(frozen=True)
class ImuGrade:
    """A kind of IMU.

    Attributes:
        noise: density, random walk, rate, in Kalibr's names and units. Rounding to `lsb` adds white noise of
            lsb / sqrt(12) a sample, less than 1 % of the density's in every grade, so these are what an
            estimator should know.
        gyroscope, accelerometer: the other errors.
        sources: where the numbers come from, a line each.
        calibrated: scale and misalignment are compensated, as is usual before a flight: samples have none.
    """

    noise: ImuNoise
    gyroscope: Triad
    accelerometer: Triad
    sources: tuple[str, ...]
    calibrated: bool = True


def allan_floor(density: float, walk: float) -> float:
    """The lowest Allan deviation of white noise and a random walk, which data sheets call bias instability.

    sigma^2(tau) = density^2 / tau + walk^2 tau / 3 (IEEE Std 952) is least at tau = sqrt(3) density / walk.
    """
    return math.sqrt(2.0 / math.sqrt(3.0) * density * walk)


GRADES: dict[str, ImuGrade] = {
    "tactical": ImuGrade(
        ImuNoise(4.363e-5, 1.166e-7, 1.0e-3, 2.08e-4, 200.0),
        Triad(10.0 / 3600.0 * DEG, 400.0 * DEG, 0.22 / 3600.0 * DEG, 5e-4, 1e-3),
        Triad(0.75 * MG, 10e3 * MG, 1e3 * MG / 2**19, 3e-4, 1e-3),
        (
            "Safran STIM300, data sheet TS1524: .15 deg/sqrt(h), .06 m/s/sqrt(h); 400 deg/s, 10 g, 24 bits; "
            "500 and 300 ppm, 1 mrad",
            "random walks: those whose Allan floor is the data sheet's, .5 deg/h and .05 mg",
            "turn-on: the data sheet's 10 deg/h over temperature and .75 mg from start to start",
        ),
    ),
    "adis16448": ImuGrade(
        ImuNoise(1.6968e-4, 1.9393e-5, 2.0e-3, 3.0e-3, 200.0),
        Triad(0.03, 1000.0 * DEG, 0.04 * DEG, 2e-3, 1e-3),
        Triad(0.1, 18e3 * MG, 1e3 * MG / 1200.0, 2e-3, 1e-3),
        (
            "Analog Devices ADIS16448; noise and random walks: EuRoC's imu0/sensor.yaml",
            "steps: as in EuRoC's samples; ranges: the data sheet's, 1000 deg/s and 18 g",
            "turn-on: chosen near the biases in EuRoC's truth, whose rms is .047 rad/s and .085 m/s^2",
            "scale and misalignment: chosen",
        ),
    ),
    "consumer": ImuGrade(
        ImuNoise(1.6e-4, 2.2e-5, 2.8e-3, 8.6e-4, 200.0),
        Triad(3.0 * DEG, 1000.0 * DEG, 2000.0 / 2**16 * DEG, 5e-3, 5e-3),
        Triad(40.0 * MG, 8e3 * MG, 16e3 * MG / 2**16, 5e-3, 5e-3),
        (
            "Bosch BMI160; noise and random walks: TUM-VI's imu.yaml",
            "turn-on: the data sheet's typical 3 deg/s and 40 mg; 16 bits over two of its ranges, 1000 deg/s and 8 g",
            "scale and misalignment: chosen",
        ),
    ),
    "n100": ImuGrade(
        ImuNoise(1.745e-4, 4.67e-5, 2.94e-3, 3.47e-3, 200.0),
        Triad(0.02, 2000.0 * DEG, 4000.0 / 2**16 * DEG, 5e-3, 3e-3),
        Triad(20.0 * MG, 16e3 * MG, 32e3 * MG / 2**16, 5e-3, 3e-3),
        (
            "WHEELTEC N100; Yi et al. give its name, 200 Hz and 'low-cost', and no noise: all other numbers are chosen",
            "noise: .01 deg/s/sqrt(Hz) and 300 ug/sqrt(Hz); random walks: Allan floors of 20 deg/h and .35 mg",
        ),
    ),
    "cheap": ImuGrade(
        ImuNoise(1.92e-4, 9.54e-5, 3.92e-3, 5.31e-3, 200.0),
        Triad(20.0 / 3.0 * DEG, 500.0 * DEG, 1000.0 / 2**16 * DEG, 0.01, 0.0067),
        Triad(50.0 * MG, 8e3 * MG, 16e3 * MG / 2**16, 0.01, 0.0067),
        (
            "InvenSense MPU-6050, data sheet PS-MPU-6000A: accelerometer 400 ug/sqrt(Hz); gyroscope .033 deg/s rms "
            "from 1 to 10 Hz, which is .011 deg/s/sqrt(Hz)",
            "turn-on: 50 mg; tolerances taken for three sd: 20 deg/s, 3 % scale, 2 % across axes",
            "16 bits over two of its ranges, 500 deg/s and 8 g",
            "random walks: chosen, Allan floors of 30 deg/h and .5 mg",
        ),
    ),
}
"""IMU grades by name, from the best to the worst."""


def grade(name: str) -> ImuGrade:
    """The grade of that name; with `-uncalibrated` behind it, one with scale and misalignment errors.

    Raises:
        ConfigError: there is none; the message lists the names.
    """
    kind = name.removesuffix(_UNCALIBRATED)
    if kind not in GRADES:
        raise ConfigError(
            f"IMU grade {name!r} is unknown; known are {', '.join(GRADES)}, each also with {_UNCALIBRATED}"
        )
    return replace(GRADES[kind], calibrated=kind == name)

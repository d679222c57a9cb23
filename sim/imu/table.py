"""The table of IMU grades as Markdown, for the documentation."""

from sim.imu.grades import DEG, GRADES, MG, Triad, allan_floor

_HEADER = (
    "| grade | | noise density | random walk | Allan floor | turn-on (sd) | range | step | scale, misalignment (sd) |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


def grade_table() -> str:
    """A line for the gyroscope and one for the accelerometer of each grade, and the sources below.

    Densities and random walks are in Kalibr's units: rad/s/sqrt(Hz), rad/s^2/sqrt(Hz), m/s^2/sqrt(Hz),
    m/s^3/sqrt(Hz).
    """
    rows, sources = [], []
    for name, imu in GRADES.items():
        noise, gyro, accel = imu.noise, imu.gyroscope, imu.accelerometer
        density, walk = noise.gyroscope_noise_density, noise.gyroscope_random_walk
        floor = f"{allan_floor(density, walk) * 3600.0 / DEG:.2g} °/h"
        said = f"{gyro.turn_on:.2g} rad/s | {gyro.limit / DEG:.0f} °/s | {gyro.lsb / DEG:.2g} °/s"
        rows.append(f"| `{name}` | gyroscope | {density:.3g} | {walk:.3g} | {floor} | {said} | {_deformation(gyro)} |")
        density, walk = noise.accelerometer_noise_density, noise.accelerometer_random_walk
        floor = f"{allan_floor(density, walk) / MG:.2g} mg"
        said = f"{accel.turn_on:.2g} m/s² | {accel.limit / MG / 1e3:.0f} g | {accel.lsb / MG:.2g} mg"
        rows.append(f"| | accelerometer | {density:.3g} | {walk:.3g} | {floor} | {said} | {_deformation(accel)} |")
        sources.append(f"- `{name}`: {'; '.join(imu.sources)}.")
    return "\n".join([_HEADER, *rows, "", *sources]) + "\n"


def _deformation(triad: Triad) -> str:
    return f"{100.0 * triad.scale:.2g} %, {1e3 * triad.misalignment:.2g} mrad"

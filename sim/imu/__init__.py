"""What an IMU of a grade says of a motion."""

from sim.imu.grades import GRADES, ImuGrade, Triad, allan_floor, grade
from sim.imu.samples import exact_imu, ideal_samples, simulate_imu, stamps
from sim.imu.table import grade_table

__all__ = [
    "GRADES",
    "ImuGrade",
    "Triad",
    "allan_floor",
    "exact_imu",
    "grade",
    "grade_table",
    "ideal_samples",
    "simulate_imu",
    "stamps",
]

import numpy as np
import pytest

from navcore.errors import DataError
from navcore.imu import ImuNoise, ImuSamples


def samples(t_ns):
    values = np.arange(3.0 * len(t_ns)).reshape(-1, 3)
    return ImuSamples(np.array(t_ns), values, values + 0.5)


def test_between_is_half_open():
    part = samples([10, 20, 30, 40]).between(20, 40)
    assert part.t_ns.tolist() == [20, 30]
    np.testing.assert_array_equal(part.gyro[0], [3.0, 4.0, 5.0])
    assert len(samples([10]).between(11, 12)) == 0


def test_samples_are_copies_and_read_only():
    t_ns = np.array([1, 2])
    imu = ImuSamples(t_ns, np.zeros((2, 3)), np.zeros((2, 3)))
    t_ns[0] = 5
    assert imu.t_ns[0] == 1
    for array in (imu.t_ns, imu.gyro, imu.accel):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


@pytest.mark.parametrize(
    ("t_ns", "gyro", "says"),
    [
        ([1, 1], np.zeros((2, 3)), "IMU stamp 1 ns is repeated after 1 ns"),
        ([2, 1], np.zeros((2, 3)), "IMU stamp 1 ns is out of order after 2 ns"),
        ([1, 2], np.zeros((3, 3)), r"gyro has shape \(3, 3\), expected \(2, 3\)"),
        ([1, 2], np.array([[0.0] * 3, [0.0, np.nan, 0.0]]), "IMU sample at 2 ns is not finite"),
        ([1, 2], np.array([[0.0, np.inf, 0.0], [0.0] * 3]), "IMU sample at 1 ns is not finite"),
    ],
)
def test_wrong_samples_are_refused(t_ns, gyro, says):
    with pytest.raises(DataError, match=says):
        ImuSamples(np.array(t_ns), gyro, np.zeros((2, 3)))


@pytest.mark.parametrize("values", [(-1e-4, 0, 0, 0), (np.nan, 0, 0, 0), (0, 0, 0, np.inf), (0, 0, 0, 0, 0.0)])
def test_impossible_noise_is_refused(values):
    with pytest.raises(DataError, match="expected a finite value, not negative"):
        ImuNoise(*values)

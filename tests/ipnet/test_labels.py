"""Labels of recordings whose biases are known, under all that real truths do."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from ipnet.errors import ConfigError, LabelError
from ipnet.labels import LabelConfig, label
from ipnet.labels.label import Measured
from navcore import so3
from navcore.imu import ImuSamples
from navcore.readers import open_sequence
from navcore.trajectory import Trajectory
from tests.ipnet.swinging import BIAS, NOISE, pose, recording, samples, truth


def test_positions_and_attitudes_are_enough():
    found = label(recording())
    np.testing.assert_allclose(found.label.bias[:3], BIAS[:3], atol=1e-6)
    np.testing.assert_allclose(found.label.bias[3:], BIAS[3:], atol=2e-4)
    assert (found.segments, found.left_out) == (39, 0)
    assert found.offset is not None and abs(found.offset.value[0]) < 1e-4
    assert found.turn < 1e-4


def noisy(seed, seconds=40.0):
    rng = np.random.default_rng(seed)
    imu = samples(seconds, noise=NOISE, rng=rng)
    return recording(imu=imu, path=truth(seconds, rng=rng, angle=2e-3, distance=1e-3))


def test_adam_ends_where_gauss_newton_does():
    sequence = noisy(1)
    one, other = (label(sequence, LabelConfig(solver=x)).label for x in ("gauss-newton", "adam"))
    np.testing.assert_allclose(other.bias[:3], one.bias[:3], atol=2e-6)
    np.testing.assert_allclose(other.bias[3:], one.bias[3:], atol=2e-5)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=0.02, atol=1e-9)


def test_the_mean_over_moments_is_near():
    found = label(noisy(2), LabelConfig(solver="per-moment"))
    np.testing.assert_allclose(found.label.bias[:3], BIAS[:3], atol=2e-3)
    np.testing.assert_allclose(found.label.bias[3:], BIAS[3:], atol=2e-2)
    assert found.tilt is None and found.offset is None


def test_errors_are_as_large_as_the_covariance_says():
    nees = []
    for seed in range(16):
        found = label(noisy(100 + seed)).label
        error = found.bias - BIAS
        nees.append([error[k] @ np.linalg.solve(found.covariance[k, k], error[k]) for k in (slice(3), slice(3, 6))])
    low, high = stats.chi2.ppf([0.0005, 0.9995], 3 * 16) / (3 * 16)
    assert low < np.mean(nees, axis=0)[0] / 3.0 < high
    assert low < np.mean(nees, axis=0)[1] / 3.0 < high


def tilted(path, turn):
    R = so3.exp(np.asarray(turn))  # of the truth's world
    return Trajectory(path.t_ns, so3.to_quaternion(R.T @ path.R_WB), path.p_WB @ R)


def test_a_tilted_world_is_found_and_does_not_move_the_label():
    turn = np.deg2rad([1.5, -2.0, 0.0])
    sequence = recording(path=tilted(truth(40.0), turn))
    found, upright = label(sequence), label(sequence, LabelConfig(tilt=False))
    assert isinstance(found.tilt, Measured)
    np.testing.assert_allclose(found.tilt.value, turn[:2], atol=1e-4)
    np.testing.assert_allclose(found.label.bias[3:], BIAS[3:], atol=5e-4)
    assert np.abs(upright.label.bias[3:] - BIAS[3:]).max() > 0.05
    assert upright.tilt is None


def test_a_late_truth_is_found():
    path = truth(40.0)
    late = replace(path, p_WB=pose(path.seconds - 0.006)[1])
    found = label(recording(path=late))
    assert found.offset is not None
    assert found.offset.value[0] == pytest.approx(-0.006, abs=5e-4)
    np.testing.assert_allclose(found.label.bias[3:], BIAS[3:], atol=5e-4)


def test_a_body_that_is_turned_against_the_imu_makes_the_label_less_sure():
    path = truth(40.0)
    turned = replace(path, q_WB=so3.to_quaternion(path.R_WB @ so3.exp(np.deg2rad([0.3, 0.3, 0.3]))))
    found = label(recording(path=turned))
    assert np.rad2deg(found.turn) == pytest.approx(0.3, rel=0.1)
    error = found.label.bias[3:] - BIAS[3:]
    assert np.abs(error).max() > 0.02
    assert np.all(np.abs(error) < 3.0 * np.sqrt(np.diag(found.label.covariance)[3:]))


def test_a_body_that_never_turns_is_not_sure_of_its_level():
    t_ns = np.arange(4000) * 5_000_000
    still = ImuSamples(t_ns, np.tile(BIAS[:3], (4000, 1)), np.tile(np.add(BIAS[3:], [0.0, 0.0, 9.81]), (4000, 1)))
    at = t_ns[:-4:4] + 10_000_000
    path = Trajectory(at, np.tile([0.0, 0.0, 0.0, 1.0], (len(at), 1)), np.zeros((len(at), 3)))
    found = label(recording(imu=still, path=path)).label
    np.testing.assert_allclose(found.bias[[0, 1, 2, 5]], BIAS[[0, 1, 2, 5]], atol=1e-3)
    sigma = np.sqrt(np.diag(found.covariance))
    assert np.all(sigma[3:5] > 0.5) and sigma[5] < 0.01
    assert np.all(np.abs(found.bias - BIAS)[3:5] < sigma[3:5])


def test_wrong_poses_count_less():
    path = truth(40.0)
    p = np.array(path.p_WB)
    p[[500, 1150]] += [0.5, -0.3, 0.4]
    R = np.array(path.R_WB)
    R[800] = R[800] @ so3.exp(np.array([0.2, 0.0, -0.1]))
    found = label(recording(path=Trajectory(path.t_ns, so3.to_quaternion(R), p))).label
    np.testing.assert_allclose(found.bias[:3], BIAS[:3], atol=1e-4)
    np.testing.assert_allclose(found.bias[3:], BIAS[3:], atol=5e-3)


def test_segments_in_gaps_are_left_out():
    path, imu = truth(40.0), samples(40.0)
    t = path.seconds
    holed = path[(t < 10.0) | (t > 12.7)]
    at = imu.t_ns * 1e-9
    kept = (at < 25.2) | (at > 25.6)
    found = label(recording(path=holed, imu=ImuSamples(imu.t_ns[kept], imu.gyro[kept], imu.accel[kept])))
    assert (found.segments, found.left_out) == (35, 4)
    np.testing.assert_allclose(found.label.bias[:3], BIAS[:3], atol=1e-5)
    np.testing.assert_allclose(found.label.bias[3:], BIAS[3:], atol=1e-3)


@pytest.mark.parametrize(
    ("sequence", "message"),
    [
        (replace(recording(12.0), truth=None), "swinging: has no truth"),
        (recording(path=truth(5.0)), "swinging: .* segments of 1 s .* at least 8 nodes"),
        (recording(path=replace(truth(40.0), t_ns=truth(40.0).t_ns + 10**12)), "do not overlap"),
    ],
)
def test_too_little_truth_is_refused(sequence, message):
    with pytest.raises(LabelError, match=message):
        label(sequence)


def test_settings_are_checked():
    with pytest.raises(ConfigError, match=r"expected 0\.1 to 10"):
        LabelConfig(segment_s=0.0)
    with pytest.raises(ConfigError, match="known are gauss-newton, adam, per-moment"):
        LabelConfig(solver="newton")  # type: ignore[arg-type]


def test_a_real_flight_meets_its_own_truth(vio_data):
    sequence = open_sequence(vio_data / "euroc" / "MH_04_difficult")
    found = label(sequence).label
    assert sequence.truth is not None
    np.testing.assert_allclose(found.bias[:3], sequence.truth.b_g.mean(axis=0), atol=2e-5)
    np.testing.assert_allclose(found.bias[3:], sequence.truth.b_a.mean(axis=0), atol=3e-3)

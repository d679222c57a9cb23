"""`window-mean`: what a window says on average."""

import json

import numpy as np
import pytest

from ipnet.calibration import ErrorModel
from ipnet.errors import ConfigError
from ipnet.recordings import Label, Recording
from ipnet.rivals.window_mean import Calibration, WindowMean, calibrate
from navcore.imu import GRAVITY, ImuNoise, ImuSamples
from navcore.prior import load_prior

ERRORS = ErrorModel(np.diag(np.repeat([1e-4, 1e-2], 3)), np.repeat([0.02, 0.2], 3), np.zeros(6))
FORCE = np.array([1.0, 2.0, 9.5])


def still(bias, seconds=30.0, up=(0.0, 0.6, 0.8), rng=None):
    t_ns = np.arange(round(seconds * 100)) * 10_000_000
    noise = np.zeros((len(t_ns), 6)) if rng is None else rng.normal(size=(len(t_ns), 6))
    values = np.concatenate([bias[:3], bias[3:] + GRAVITY * np.array(up)]) + noise
    return ImuSamples(t_ns, values[:, :3], values[:, 3:])


def said(source, samples):
    source.add_imu(samples)
    return source.poll(int(samples.t_ns[-1]))


def test_only_the_excess_along_the_force_is_known():
    """A body at rest under a bias of half a m/s^2 along the force and one across."""
    up, across = np.array([0.0, 0.6, 0.8]), np.array([0.0, 0.8, -0.6])
    b = np.concatenate([[0.01, -0.02, 0.03], 0.5 * up + 0.01 * across])
    z = said(WindowMean(Calibration(5.0, None, ERRORS, ())), still(b))
    assert [m.t_ns for m in z[:2]] == [2_495_000_000, 3_495_000_000]
    np.testing.assert_allclose(z[0].b_g, b[:3], atol=1e-9)
    assert z[0].b_a @ up == pytest.approx(0.5, abs=1e-3)
    assert up @ z[0].covariance[3:, 3:] @ up == pytest.approx(0.2**2, rel=1e-2)
    assert across @ z[0].covariance[3:, 3:] @ across > 8.0


def test_a_mounted_imu_knows_all_three_axes():
    b = np.array([0.01, -0.02, 0.03, 0.1, 0.2, 0.3])
    samples = still(b)
    moved = ImuSamples(samples.t_ns, samples.gyro, samples.accel - GRAVITY * np.array([0.0, 0.6, 0.8]) + FORCE)
    z = said(WindowMean(Calibration(5.0, FORCE, ERRORS, ())), moved)
    np.testing.assert_allclose(z[0].vector, b, atol=1e-9)
    np.testing.assert_allclose(np.diagonal(z[0].covariance), np.repeat([0.02, 0.2], 3) ** 2)


def test_chunks_do_not_matter():
    samples, source = still(np.zeros(6), rng=np.random.default_rng(1)), WindowMean(Calibration(5.0, None, ERRORS, ()))
    whole = said(WindowMean(Calibration(5.0, None, ERRORS, ())), samples)
    pieces = [z for k in range(0, len(samples), 33) for z in said(source, samples[k : k + 33])]
    assert len(whole) == len(pieces) == 25
    for a, b in zip(whole, pieces, strict=True):
        np.testing.assert_allclose(a.vector, b.vector, atol=1e-9)


def test_calibration_finds_force_and_errors():
    rng = np.random.default_rng(2)
    noise, recordings = ImuNoise(1e-4, 0.0, 1e-3, 0.0), []
    for k in range(20):
        b, c = rng.normal(size=6) * 0.1, rng.normal(size=6) * 0.05
        imu = still(b + c, up=FORCE / GRAVITY)
        recordings.append(Recording(f"r{k}", imu, noise, None, Label(f"r{k}", b, 1e-12 * np.eye(6))))
    found = calibrate(recordings, 5.0, mounted=True)
    np.testing.assert_allclose(found.force, FORCE, atol=0.05)
    np.testing.assert_allclose(np.sqrt(np.diagonal(found.constant_covariance)), 0.05, rtol=0.5)
    again = Calibration.from_dict(json.loads(json.dumps(found.as_dict())))
    np.testing.assert_array_equal(again.errors.constant, found.errors.constant)
    assert again.recordings == tuple(f"r{k}" for k in range(20))
    loose = calibrate(recordings, 5.0, mounted=False)
    assert loose.force is None
    assert np.ptp(np.diagonal(loose.constant_covariance)[3:]) == 0.0


def test_a_mean_force_is_no_surer_than_it_is_on_recordings_it_has_not_seen():
    """Two platforms' forces differ by 1 m/s^2: to the mean of both each is at 0.5, to the other's at 1."""
    noise, rng = ImuNoise(1e-4, 0.0, 1e-3, 0.0), np.random.default_rng(4)
    imus = [still(np.array([0.0, 0.0, 0.0, x, 0.0, 0.0]), rng=rng) for x in (0.0, 1.0)]
    recordings = [
        Recording(f"r{k}", x, noise, None, Label(f"r{k}", np.zeros(6), np.eye(6))) for k, x in enumerate(imus)
    ]
    found = calibrate(recordings, 5.0, mounted=True)
    assert found.force[0] == pytest.approx(0.5, abs=0.05)
    assert found.constant_covariance[3, 3] == pytest.approx(1.0 * (2 + 2) / 2, rel=0.2)  # enlarged by (n + 2) / n


def test_one_recording_gives_no_errors():
    imu = still(np.zeros(6))
    recording = Recording("r", imu, ImuNoise(1e-4, 0.0, 1e-3, 0.0), None, Label("r", np.zeros(6), np.eye(6)))
    for mounted in (False, True):
        with pytest.raises(ConfigError, match="1 recordings have a window of 5 s; expected two or more"):
            calibrate([recording], 5.0, mounted)


def test_a_calibration_is_found_by_its_file(tmp_path):
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(Calibration(7.0, FORCE, ERRORS, ("r",)).as_dict()))
    assert load_prior(f"window-mean:{path}").window_s == 7.0
    path.write_text("{}")
    with pytest.raises(ConfigError, match=r"mine\.json: KeyError.*expected what `python -m ipnet window-mean` writes"):
        load_prior(f"window-mean:{path}")


def test_an_unknown_name_is_answered_with_the_list():
    with pytest.raises(ConfigError, match=r"known are .*generic-5"):
        load_prior("window-mean:balloon")
    assert load_prior("window-mean").window_s == 5.0

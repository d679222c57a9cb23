"""The first state: at rest by gravity, in motion by a window of features and IMU."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jacobians import assert_jacobian
from scipy.spatial.transform import Rotation

from msckf.config import FilterConfig, StartConfig, VisionConfig
from msckf.features import FeatureTable
from msckf.filter import Filter
from msckf.frontend import Frontend
from msckf.imu_buffer import ImuBuffer
from msckf.moving_start import closed_form, moving_start, rotation_bias
from msckf.propagation import G_W
from msckf.start_refinement import Path, Window, _imu_rows, path_from
from msckf.static_start import gravity_aligned, static_start
from msckf.views import Rig, Views
from navcore.imu import GRAVITY, ImuNoise, ImuSamples
from navcore.odometry import Health, run
from navcore.prior import BiasPrior
from navcore.tracker import TrackerConfig
from sim.points import simulate_points

WIDE = BiasPrior(0, np.zeros(3), np.zeros(3), np.diag(np.repeat([0.1**2, 0.2**2], 3)))
directions = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda f: np.linalg.norm(f) > 1e-3)


@given(force=directions, near_down=st.sampled_from([None, 0.0, 1e-12, 1e-8, 1e-4]))
def test_gravity_is_straightened_without_turning(force, near_down):
    force = np.array(force) if near_down is None else np.array([near_down * force[0], near_down * force[1], -9.8])
    R_WB = gravity_aligned(force)
    np.testing.assert_allclose(R_WB @ force / np.linalg.norm(force), [0.0, 0.0, 1.0], atol=1e-8)
    np.testing.assert_allclose(R_WB @ R_WB.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R_WB) == pytest.approx(1.0)
    assert abs(Rotation.from_matrix(R_WB).as_rotvec()[2]) < 1e-6  # the axis is level


def test_a_static_start_is_as_good_as_its_covariance_says():
    """Tilt, gyro and accelerometer biases of many rigs at rest, drawn from what is known of the device: NEES of eight
    degrees of freedom. Yaw is the gauge: the world is turned so that the error has none."""
    noise = ImuNoise(5e-3, 1e-5, 3e-2, 1e-3, 200.0)
    device = BiasPrior(0, np.array([0.01, -0.02, 0.03]), np.array([0.1, 0.0, -0.1]), WIDE.covariance / 100.0)
    rng = np.random.default_rng(0)
    L, runs, values = np.linalg.cholesky(device.covariance), 400, []
    for _ in range(runs):
        bias = device.vector + L @ rng.standard_normal(6)
        R_true = Rotation.random(rng=rng).as_matrix()
        white = np.sqrt(noise.rate_hz) * rng.standard_normal((160, 6))
        gyro = bias[:3] + noise.gyroscope_noise_density * white[:, :3]
        accel = bias[3:] - R_true.T @ G_W + noise.accelerometer_noise_density * white[:, 3:]
        s = static_start(gyro, accel, noise, device)
        off_W = Rotation.from_matrix(R_true @ s.R_WB.T)
        *_, z, w = off_W.as_quat()
        yaw = Rotation.from_rotvec([0.0, 0.0, 2.0 * np.arctan2(z, w)])
        dtheta = Rotation.from_matrix(s.R_WB.T @ yaw.as_matrix().T @ R_true).as_rotvec()
        T = np.zeros((8, 15))
        T[0:2, 0:3] = s.R_WB[:2]  # tilt about W's x and y
        T[2:, 9:15] = np.eye(6)
        e = np.concatenate([(s.R_WB @ dtheta)[:2], bias[:3] - s.b_g, bias[3:] - s.b_a])
        values.append(e @ np.linalg.solve(T @ s.covariance @ T.T, e))
    assert np.mean(values) / 8.0 == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / (8.0 * runs)))


def test_a_static_start_fixes_the_gauge_and_takes_the_gyros_mean():
    rng = np.random.default_rng(1)
    noise = ImuNoise(1.7e-4, 1e-5, 2e-3, 1e-3, 200.0)
    b_g = np.array([0.02, -0.05, 0.04])
    gyro = b_g + 2.4e-3 * rng.standard_normal((160, 3))
    s = static_start(gyro, np.tile([0.0, 0.0, GRAVITY], (160, 1)), noise, WIDE)
    assert not s.covariance[3:6].any()  # position
    np.testing.assert_allclose(s.R_WB @ s.covariance[:3, :3] @ s.R_WB.T @ [0, 0, 1], 0.0, atol=1e-12)  # yaw
    sigma = np.sqrt(np.diagonal(s.covariance)[9:12])
    np.testing.assert_allclose(sigma, 1.7e-4 / np.sqrt(0.8), rtol=0.01)
    assert np.abs((s.b_g - b_g) / sigma).max() < 3.5
    np.testing.assert_array_equal(s.p_WB, np.zeros(3))


def window_of(sequence, seconds=1.5, every=2, device=WIDE):
    """The window that a start in motion would see at the beginning of a recording, and its stamps."""
    frames = [f for f in sequence.frames if f.t_ns <= sequence.frames[0].t_ns + round(seconds * 1e9)][::every]
    rig = Rig(sequence.calibration.cameras)
    table, buffer = FeatureTable(len(rig)), ImuBuffer(sequence.calibration.imu.rate_hz)
    front = Frontend(rig, TrackerConfig())
    buffer.append(sequence.imu)
    for frame in frames:
        table.add_clone(front.observe(frame, None, {}))
    long = table.views >= 4
    views = table.views_of(rig, long)
    t_ns = [f.t_ns for f in frames]
    cells = [buffer.cells(a, b) for a, b in pairwise(t_ns)]
    return Window(cells, views, sequence.calibration.imu, device), t_ns


def errors(state, truth):
    """Velocity [m/s] and tilt [rad] errors, seen from the body."""
    v_B = truth.R_WB[0].T @ truth.v_WB[0] - state.R_WB.T @ state.v_WB
    down = np.cross(truth.R_WB[0].T @ [0, 0, 1], state.R_WB.T @ [0, 0, 1])
    return np.linalg.norm(v_B), np.linalg.norm(down)


@pytest.fixture(scope="module", params=[1, 2, 3])
def moving(request):
    return simulate_points(seed=request.param, seconds=4.0, moving_start=True)


def test_a_moving_start_finds_velocity_and_tilt(moving):
    window, t_ns = window_of(moving)
    result = moving_start(window, StartConfig(), VisionConfig())
    assert result.state is not None, result.reason
    truth = moving.truth.at(np.array([t_ns[-1]]))
    speed, tilt = errors(result.state, truth)
    sigma = np.sqrt(np.diagonal(result.state.covariance))
    assert speed < min(0.1, 4.0 * np.linalg.norm(sigma[6:9]))
    assert tilt < 4.0 * np.linalg.norm(sigma[0:3]) < 0.15
    assert np.abs((truth.b_g[0] - result.state.b_g) / sigma[9:12]).max() < 4.0


def test_the_filter_starts_in_motion_with_it(moving):
    result = run(Filter(moving.calibration, FilterConfig().with_overrides({"start.mode": "moving"})), moving)
    first = next(e for e in result.estimates if e.state is not None)
    assert (first.t_ns - moving.frames[0].t_ns) * 1e-9 < 2.5
    assert errors(first.state, moving.truth.at(np.array([first.t_ns])))[0] < 0.1
    assert {e.health for e in result.estimates} == {Health.INITIALISING, Health.TRACKING}


@pytest.fixture(scope="module")
def exact():
    return simulate_points(seed=1, seconds=2.0, moving_start=True, pixel_noise=0.0, noisy_imu=False)


@given(b_g=st.tuples(*[st.floats(-0.1, 0.1)] * 3))
@settings(max_examples=10)
def test_rotations_of_bearings_give_the_gyros_bias(exact, b_g):
    biased = replace(exact, imu=ImuSamples(exact.imu.t_ns, exact.imu.gyro + b_g, exact.imu.accel))
    window, _ = window_of(biased)
    np.testing.assert_allclose(rotation_bias(window), b_g, atol=2e-4)


def test_noise_leaves_the_gyros_bias_better_known_than_before(moving):
    """One pixel of noise; what is left is the refinement's to find."""
    window, t_ns = window_of(moving)
    b_g = moving.truth.at(np.array(t_ns)).b_g.mean(axis=0)
    assert np.abs(rotation_bias(window) - b_g).max() < 0.03


def test_the_closed_form_is_exact_without_noise(exact):
    window, t_ns = window_of(exact)
    v_B, g_B = closed_form(window, window.integrate(np.zeros(3), np.zeros(3)))
    truth = exact.truth.at(np.array([t_ns[0]]))
    np.testing.assert_allclose(v_B, truth.R_WB[0].T @ truth.v_WB[0], atol=0.02)
    np.testing.assert_allclose(g_B, truth.R_WB[0].T @ G_W, atol=0.02)
    assert np.linalg.norm(g_B) == pytest.approx(GRAVITY)


def test_what_the_imu_says_of_two_poses_by_all_thirty_columns(moving):
    """At a path that fits the IMU exactly, where the weights' own change counts nothing."""
    window, _ = window_of(moving)
    device = window.device
    increments = window.integrate(device.b_g, device.b_a)
    path = path_from(increments, np.array([1.0, -0.5, 0.2]), np.array([0.3, -0.4, -9.79]), device.b_g, device.b_a)

    def moved(path, d):
        R, rest = path.R.copy(), [x.copy() for x in (path.p, path.v, path.b_g, path.b_a)]
        for k, e in ((3, d[:15]), (4, d[15:])):
            R[k] = R[k] @ Rotation.from_rotvec(e[:3]).as_matrix()
            for x, part in zip(rest, e[3:].reshape(4, 3), strict=True):
                x[k] += part
        return Path(R, *rest)

    A, b = _imu_rows(window, path, 3)
    np.testing.assert_allclose(b, 0.0, atol=1e-6)
    assert not A[:, :45].any()
    assert not A[:, 75:].any()
    assert_jacobian(lambda x: -_imu_rows(window, x, 3)[1], path, A[:, 45:75], moved, rtol=1e-5)


def test_reasons_instead_of_a_wrong_start(moving):
    window, _ = window_of(moving)
    few = Window(window.cells, window.views.rows(np.arange(len(window.views.uv)) < 5), window.noise, window.device)
    assert "few features" in moving_start(few, StartConfig(), VisionConfig()).reason
    shuffled = np.random.default_rng(0).permutation(len(window.views.uv))
    uv = np.where(np.arange(window.views.uv.shape[1])[:, None] % 2 == 0, window.views.uv, window.views.uv[shuffled])
    seen = window.views.seen & window.views.seen[shuffled]
    nonsense = Window(window.cells, Views(window.views.rig, uv, seen), window.noise, WIDE)
    result = moving_start(nonsense, StartConfig(), VisionConfig())
    assert result.state is None
    assert result.reason

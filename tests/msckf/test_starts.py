"""The first state: at rest by gravity, in motion by a window of features and IMU."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jacobians import assert_jacobian
from scipy.spatial.transform import Rotation

from msckf.config import FilterConfig, StartConfig
from msckf.features import FeatureTable
from msckf.filter import Filter
from msckf.moving_start import in_motion, moving_start
from msckf.propagation import G_W
from msckf.start_guess import closed_form, rotation_bias
from msckf.start_inertia import Inertia, Path, Window
from msckf.start_points import Points, Sight
from msckf.start_refinement import Refined, refine
from msckf.static_start import force_surprise, gravity_aligned, static_start
from msckf.views import Rig
from navcore import so3
from navcore.frontend import Frontend
from navcore.imu import GRAVITY, ImuNoise, ImuSamples
from navcore.imu_buffer import ImuBuffer
from navcore.odometry import Health, run
from navcore.prior import BiasPrior
from navcore.sequence import Frame
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
    """Tilt, gyro and accelerometer biases of many rigs nearly at rest, anywhere on Earth, drawn from what is known of
    the device: NEES of eight degrees of freedom. Yaw is the gauge: the world is turned so that the error has none."""
    noise = ImuNoise(5e-3, 1e-5, 3e-2, 1e-3, 200.0)
    device = BiasPrior(0, np.array([0.01, -0.02, 0.03]), np.array([0.1, 0.0, -0.1]), WIDE.covariance / 100.0)
    rng = np.random.default_rng(0)
    L, runs, values = np.linalg.cholesky(device.covariance), 400, []
    for _ in range(runs):
        bias = device.vector + L @ rng.standard_normal(6)
        R_true = Rotation.random(rng=rng).as_matrix()
        white = np.sqrt(noise.rate_hz) * rng.standard_normal((160, 6))
        gyro = bias[:3] + 1e-3 * rng.standard_normal(3) + noise.gyroscope_noise_density * white[:, :3]
        gravity = (1.0 + 0.02 / GRAVITY * rng.standard_normal()) * G_W
        shaken = 0.01 * rng.standard_normal(3)
        accel = bias[3:] + shaken - R_true.T @ gravity + noise.accelerometer_noise_density * white[:, 3:]
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
    np.testing.assert_allclose(sigma, np.hypot(1.7e-4 / np.sqrt(0.8), 1e-3), rtol=0.01)
    assert np.abs((s.b_g - b_g) / sigma).max() < 3.5
    np.testing.assert_array_equal(s.p_WB, np.zeros(3))


def test_at_rest_the_force_measures_the_bias_along_gravity():
    noise = ImuNoise(1.7e-4, 1e-5, 2e-3, 1e-3, 200.0)
    up = np.array([0.6, 0.0, 0.8])
    s = static_start(np.zeros((160, 3)), np.tile((GRAVITY + 0.15) * up, (160, 1)), noise, WIDE)
    np.testing.assert_allclose(s.b_a, 0.15 * up, atol=0.002)
    P = s.covariance[12:, 12:]
    assert np.sqrt(up @ P @ up) == pytest.approx(np.hypot(0.02, 0.01), rel=0.02)
    across = np.array([0.0, 1.0, 0.0])
    assert np.sqrt(across @ P @ across) == pytest.approx(0.2)
    np.testing.assert_allclose(s.R_WB @ up, [0.0, 0.0, 1.0], atol=1e-9)


def test_a_force_at_rest_that_is_not_gravity_is_told():
    assert force_surprise(np.tile([0.0, 0.0, GRAVITY + 0.1], (5, 1)), WIDE) < 1.0
    assert force_surprise(np.tile([0.0, 0.0, GRAVITY + 1.0], (5, 1)), WIDE) > 4.0


def window_of(sequence, seconds=1.5, every=2, device=WIDE, cameras=1):
    """The window that a start in motion would see at the beginning of a recording, and its stamps."""
    frames = [f for f in sequence.frames if f.t_ns <= sequence.frames[0].t_ns + round(seconds * 1e9)][::every]
    table, buffer = FeatureTable(cameras), ImuBuffer(sequence.calibration.imu.rate_hz)
    buffer.append(sequence.imu)
    rig = Rig(sequence.calibration.cameras[:cameras])
    frontend = Frontend(rig.mounts, TrackerConfig())
    for frame in frames:
        table.add_clone(
            frontend.observe(Frame(frame.t_ns, tracks={c: frame.tracks[c] for c in range(cameras)}), None, {})
        )
    views = table.views_of(rig, table.views >= 4)
    t_ns = [f.t_ns for f in frames]
    cells = [buffer.cells(a, b) for a, b in pairwise(t_ns)]
    return Window(cells, views, sequence.calibration.imu, device), t_ns


def true_path(sequence, t_ns):
    """The path that the truth says, with the biases of its middle."""
    truth = sequence.truth.at(np.array(t_ns))
    return Path(truth.R_WB, truth.p_WB, truth.v_WB, truth.b_g.mean(axis=0), truth.b_a.mean(axis=0))


def errors(state, truth):
    """Velocity [m/s] and tilt [rad] errors, seen from the body."""
    v_B = truth.R_WB[0].T @ truth.v_WB[0] - state.R_WB.T @ state.v_WB
    down = np.cross(truth.R_WB[0].T @ [0, 0, 1], state.R_WB.T @ [0, 0, 1])
    return np.linalg.norm(v_B), np.linalg.norm(down)


@pytest.fixture(scope="module", params=[1, 2, 3])
def moving(request):
    return simulate_points(seed=request.param, seconds=4.0, moving_start=True)


@pytest.fixture(scope="module")
def exact():
    return simulate_points(seed=1, seconds=3.0, moving_start=True, pixel_noise=0.0, noisy_imu=False)


def test_a_moving_start_finds_velocity_and_tilt(moving):
    window, t_ns = window_of(moving, 2.7)
    result = moving_start(window, StartConfig(), 1.0)
    assert result.state is not None, result.reason
    truth = moving.truth.at(np.array([t_ns[-1]]))
    speed, tilt = errors(result.state, truth)
    sigma = np.sqrt(np.diagonal(result.state.covariance))
    assert speed < min(0.1, 4.0 * np.linalg.norm(sigma[6:9]))
    assert tilt < 4.0 * np.linalg.norm(sigma[0:3]) < 0.15
    assert np.abs((truth.b_g[0] - result.state.b_g) / sigma[9:12]).max() < 4.0
    np.testing.assert_array_equal(result.state.b_g, result.b_g)


def test_a_moving_start_begins_at_the_origin_with_yaw_zero(moving):
    state = moving_start(window_of(moving, 2.7)[0], StartConfig(), 1.0).state
    assert not state.p_WB.any()
    assert abs(np.arctan2(state.R_WB[1, 0], state.R_WB[0, 0])) < 1e-12
    assert not state.covariance[3:6].any()
    np.testing.assert_allclose(state.R_WB[2] @ state.covariance[:3, :3], 0.0, atol=1e-15)


def test_the_same_window_gives_the_same_bits(moving):
    states = [moving_start(window_of(moving, 2.7)[0], StartConfig(), 1.0).state for _ in range(2)]
    for a, b in zip(vars(states[0]).values(), vars(states[1]).values(), strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_filter_starts_in_motion_with_it(moving):
    result = run(Filter(moving.calibration, FilterConfig().with_overrides({"start.mode": "moving"})), moving)
    first = next(e for e in result.estimates if e.state is not None)
    assert (first.t_ns - moving.frames[0].t_ns) * 1e-9 < 3.0
    assert errors(first.state, moving.truth.at(np.array([first.t_ns])))[0] < 0.1
    assert {e.health for e in result.estimates} == {Health.INITIALISING, Health.TRACKING}


@given(b_g=st.tuples(*[st.floats(-0.1, 0.1)] * 3))
@settings(max_examples=10)
def test_rotations_of_bearings_give_the_gyros_bias(exact, b_g):
    biased = replace(exact, imu=ImuSamples(exact.imu.t_ns, exact.imu.gyro + b_g, exact.imu.accel))
    window, _ = window_of(biased)
    np.testing.assert_allclose(rotation_bias(window.views, window.increments, WIDE), b_g, atol=1e-3)


def test_noise_leaves_the_gyros_bias_better_known_than_before(moving):
    """One pixel of noise; what is left is the refinement's to find."""
    window, t_ns = window_of(moving)
    b_g = moving.truth.at(np.array(t_ns)).b_g.mean(axis=0)
    assert np.abs(rotation_bias(window.views, window.increments, WIDE) - b_g).max() < 0.06


def test_the_closed_form_is_exact_without_noise(exact):
    window, t_ns = window_of(exact)
    v_B, g_B = closed_form(window.views, window.increments)
    truth = exact.truth.at(np.array([t_ns[0]]))
    np.testing.assert_allclose(v_B, truth.R_WB[0].T @ truth.v_WB[0], atol=0.02)
    np.testing.assert_allclose(g_B, truth.R_WB[0].T @ G_W, atol=0.02)
    assert np.linalg.norm(g_B) == pytest.approx(GRAVITY)


@pytest.mark.parametrize("cameras", [1, 2])
@pytest.mark.parametrize("off", [0.0, 0.05])
def test_a_refinement_is_exact_without_noise(cameras, off):
    """From far off, with biases known to be none: what is left is the interpolation of the IMU."""
    exact = simulate_points(seed=1, seconds=3.0, moving_start=True, pixel_noise=0.0, noisy_imu=False, cameras=cameras)
    none = BiasPrior(0, np.zeros(3), np.zeros(3), np.diag(np.repeat([1e-5**2, 1e-4**2], 3)))
    window, t_ns = window_of(exact, 2.0, device=none, cameras=cameras)
    path = true_path(exact, t_ns)
    begin = Path(path.R @ so3.exp(np.array([0.0, off, 0.0])), path.p, (1.0 + off) * path.v, path.b_g, path.b_a)
    refined = refine(window, begin, 1.0)
    assert isinstance(refined, Refined), refined
    found, truth = refined.path, exact.truth.at(np.array(t_ns[-1:]))
    np.testing.assert_allclose(found.R[-1].T @ found.v[-1], truth.R_WB[0].T @ truth.v_WB[0], atol=4e-3)
    np.testing.assert_allclose(found.R[-1][2], truth.R_WB[0][2], atol=5e-4)
    assert refined.pixel_noise == 0.25


def moved(path, d):
    return path.moved(d)


def test_what_the_imu_says_of_two_poses_by_all_columns(moving):
    """At a path that fits the IMU exactly, where the derivatives by the pose before are exact."""
    window, _ = window_of(moving, 0.8)
    v_B, g_B, b_g, b_a = np.array([1.0, -0.5, 0.2]), np.array([0.3, -0.4, -9.79]), np.full(3, 0.01), np.full(3, 0.1)
    path = Path.of(window.increments_at(b_g, b_a), v_B, g_B, b_g, b_a)
    inertia, n, k = Inertia.of(window), 9 * len(path.R) + 6, 3
    r, H = inertia.residuals(path)
    np.testing.assert_allclose(r, 0.0, atol=1e-6)
    J = np.zeros((9, n))
    J[:, 9 * k : 9 * k + 18], J[:, -6:] = H[k, :, :18], H[k, :, 18:]
    assert_jacobian(lambda x: -inertia.residuals(x)[0][k], path, J, moved, rtol=1e-5)


@pytest.mark.parametrize("by", ["path", "points"])
def test_what_features_say_by_all_columns(moving, by):
    """Residuals of all views of some features by poses, and by a step of the points."""
    window, t_ns = window_of(moving, 0.8)
    views = window.views.rows(np.arange(6))
    path = true_path(moving, t_ns)
    points = Points.triangulated(views, path.R, path.p)
    sight = Sight.of(views, path.R, path.p, points)
    F, K = len(views.seen), len(path.R)
    assert views.seen.any(axis=1).all()
    if by == "path":
        J = np.zeros((F, K, 2, 9 * K + 6))
        for k in range(K):
            J[:, k, :, 9 * k : 9 * k + 6] = sight.H_x[:, k]
        J = J.reshape(F * K * 2, -1)
        assert_jacobian(lambda x: -Sight.of(views, x.R, x.p, points).r.ravel(), path, J, moved, rtol=1e-5)
        return
    J = np.zeros((F, K, 2, F, 3))
    for f in range(F):
        J[f, :, :, f] = sight.H_f[f]
    assert_jacobian(
        lambda x: -Sight.of(views, path.R, path.p, x).r.ravel(),
        points,
        J.reshape(F * K * 2, -1),
        lambda x, d: x.moved(d.reshape(F, 3), x.origin),
        rtol=1e-5,
    )


def test_a_point_stays_where_it_is_when_it_is_seen_from_elsewhere(moving):
    window, t_ns = window_of(moving, 0.8)
    path = true_path(moving, t_ns)
    points = Points.triangulated(window.views, path.R, path.p)
    p_WF = points.origin + points.direction / points.inverse_range[:, None]
    again = points.moved(np.zeros((len(p_WF), 3)), points.origin + np.array([0.3, -0.2, 0.1]))
    np.testing.assert_allclose(again.origin + again.direction / again.inverse_range[:, None], p_WF, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(again.direction, axis=1), 1.0)


@pytest.mark.slow
def test_a_moving_start_is_as_good_as_its_covariance_says():
    """Over many flights whose IMU has the noise that its calibration says, and is trusted so: NEES by degree of freedom
    of tilt, velocity, both biases, and all of them together."""
    trusting = StartConfig(gyro_noise=1.0, accel_noise=1.0, patience_s=0.0, max_velocity_sigma=1.0, max_tilt_sigma=1.0)
    blocks = (slice(0, 2), slice(2, 5), slice(5, 8), slice(8, 11), slice(0, 11))
    nees = []
    for seed in range(60):
        flight = simulate_points(seed=100 + seed, seconds=2.5, moving_start=True)
        window, t_ns = window_of(flight, 2.0)
        state = moving_start(window, trusting, 1.0).state
        if state is None:
            continue
        truth = flight.truth.at(np.array(t_ns[-1:]))
        turned = truth.R_WB[0] @ state.R_WB.T
        yaw = np.arctan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1])
        R_WV = so3.exp(np.array([0.0, 0.0, yaw]))
        tilt = (state.R_WB @ so3.log(state.R_WB.T @ R_WV.T @ truth.R_WB[0]))[:2]
        speed = R_WV.T @ truth.v_WB[0] - state.v_WB
        e = np.concatenate([tilt, speed, truth.b_g[0] - state.b_g, truth.b_a[0] - state.b_a])
        T = np.zeros((11, 15))
        T[0:2, 0:3], T[2:, 6:] = state.R_WB[:2], np.eye(9)
        P = T @ state.covariance @ T.T
        nees.append([e[b] @ np.linalg.solve(P[b, b], e[b]) / (b.stop - b.start) for b in blocks])
    assert len(nees) > 54  # others begin in no valley, and begin again with the next window
    means = np.mean(nees, axis=0)
    assert means.min() > 0.6
    assert means.max() < 1.4


def test_an_imu_in_motion_is_trusted_less_than_its_calibration_says():
    noise, c = ImuNoise(1.7e-4, 1e-5, 2e-3, 1e-3, 200.0), StartConfig()
    wider = in_motion(noise, c)
    assert wider.gyroscope_noise_density == c.gyro_noise * 1.7e-4
    assert wider.accelerometer_noise_density == c.accel_noise * 2e-3
    assert wider.accelerometer_random_walk == 1e-3


def test_a_scale_that_is_not_known_is_waited_for(moving):
    """A short window does not tell the path's size; once patience is over, the velocity is enough."""
    window, _ = window_of(moving, 1.2)
    strict = StartConfig(max_velocity_sigma=10.0, max_tilt_sigma=10.0, max_scale_sigma=1e-3)
    assert "scale known to" in moving_start(window, strict, 1.0).reason
    assert moving_start(window, replace(strict, patience_s=1.0), 1.0).state is not None


def test_a_camera_that_misses_the_newest_image_leaves_the_start_to_the_other():
    window, _ = window_of(simulate_points(seed=1, seconds=4.0, moving_start=True, cameras=2), 2.0, cameras=2)
    seen = window.views.seen.copy()
    seen[:, -1] = False
    one_blind = replace(window, views=replace(window.views, seen=seen))
    assert "few features" not in moving_start(one_blind, StartConfig(), 1.0).reason
    seen[:, -2] = False
    none_sees = replace(window, views=replace(window.views, seen=seen))
    assert "few features" in moving_start(none_sees, StartConfig(), 1.0).reason


def test_reasons_instead_of_a_wrong_start(moving):
    window, _ = window_of(moving)
    few = replace(window, views=window.views.rows(np.arange(len(window.views.seen)) < 5))
    assert "few features" in moving_start(few, StartConfig(), 1.0).reason
    b = window.views
    shuffled, odd = np.random.default_rng(0).permutation(len(b.seen)), np.arange(b.seen.shape[1]) % 2 == 1
    rays = np.where(odd[:, None], b.rays[shuffled], b.rays)
    seen = b.seen & b.seen[shuffled]
    seen[:, -1] = True
    result = moving_start(replace(window, views=replace(b, bearings=rays, seen=seen)), StartConfig(), 1.0)
    assert result.state is None
    assert result.reason

"""Standing still: when it is believed, and what it then says."""

import numpy as np
import pytest
from jacobians import assert_jacobian
from scipy.spatial.transform import Rotation

from msckf.config import StandstillConfig
from msckf.propagation import G_W, integrate
from msckf.standstill import standstill_update, unmoved
from navcore.imu import ImuNoise, ImuSamples
from navcore.imu_buffer import Cells, ImuBuffer
from navcore.stillness import image_motion, imu_is_quiet
from tests.msckf.scenes import filter_state

CONFIG = StandstillConfig()
NOISE = ImuNoise(1.7e-4, 1.9e-5, 2.0e-3, 3.0e-3, 200.0)


def standing(velocity_sigma=1.0):
    """A state that has not moved since its newest clone, but believes so after some time of noise."""
    state = filter_state(sigmas=np.repeat([0.02, 0.05, velocity_sigma, 0.1, 0.1], 3))
    state.add_clone(0, np.zeros(3))
    rest = Cells(np.full(20, 0.005), np.full((20, 3), 0.1), np.tile(-state.R_WB.T @ G_W, (20, 1)), np.zeros(20))
    state.propagate(integrate(rest, state.b_g, state.b_a, NOISE))
    return state


def test_jacobian_and_residual():
    state = standing()
    state.R_WB = state.R_WB @ Rotation.from_rotvec([0.2, -0.1, 0.3]).as_matrix()
    H, columns, r, noise = unmoved(state, CONFIG)
    first = state.clone(0).start
    assert columns.tolist() == [*range(9), *range(first, first + 6)]

    def predicted(x):
        R, p, v, R_0, p_0 = x
        return np.concatenate([Rotation.from_matrix(R_0.T @ R).as_rotvec(), p - p_0, v])

    def moved(x, d):
        R, p, v, R_0, p_0 = x
        turned = [M @ Rotation.from_rotvec(w).as_matrix() for M, w in ((R, d[0:3]), (R_0, d[9:12]))]
        return turned[0], p + d[3:6], v + d[6:9], turned[1], p_0 + d[12:15]

    x = (state.R_WB, state.p_WB, state.v_WB, state.clones.R_WB[0], state.clones.p_WB[0])
    assert_jacobian(predicted, x, H, moved)
    np.testing.assert_allclose(r, -predicted(x), atol=1e-12)
    sigmas = [CONFIG.rotation_sigma, CONFIG.position_sigma, CONFIG.velocity_sigma]
    np.testing.assert_allclose(np.diag(noise), np.repeat(sigmas, 3) ** 2)


def test_the_body_is_where_it_was_and_stands():
    state = standing()
    assert np.linalg.norm(state.p_WB - state.clones.p_WB[0]) > 0.05
    assert standstill_update(state, CONFIG)
    assert np.linalg.norm(state.v_WB) < 0.02  # began at one metre a second
    assert np.linalg.norm(state.p_WB - state.clones.p_WB[0]) < 0.005
    assert np.linalg.norm(Rotation.from_matrix(state.R_WB.T @ state.clones.R_WB[0]).as_rotvec()) < 0.002
    assert np.sqrt(np.diagonal(state.covariance)[6:9]).max() < 1.01 * CONFIG.velocity_sigma


def test_a_body_that_is_known_to_move_does_not_stand():
    """It has just driven off: IMU and image do not show it yet, the state does."""
    state = standing(velocity_sigma=0.1)  # of one metre a second
    before = state.v_WB, np.array(state.covariance)
    assert not standstill_update(state, CONFIG)
    assert state.v_WB is before[0]
    np.testing.assert_array_equal(state.covariance, before[1])


def buffer_of(gyro_std, accel_std, n=200):
    rng = np.random.default_rng(0)
    t_ns = 5_000_000 * np.arange(n)
    buffer = ImuBuffer(200.0)
    gyro = gyro_std * rng.standard_normal((n, 3)) + [0.1, 0.2, -0.3]  # a bias is no motion
    buffer.append(ImuSamples(t_ns, gyro, [0.0, 1.0, 9.7] + accel_std * rng.standard_normal((n, 3))))
    return buffer


@pytest.mark.parametrize(
    ("gyro_std", "accel_std", "quiet"), [(0.01, 0.07, True), (0.05, 0.07, False), (0.01, 0.4, False)]
)
def test_quiet_is_what_is_steady(gyro_std, accel_std, quiet):
    buffer = buffer_of(gyro_std, accel_std)
    assert imu_is_quiet(buffer, 900_000_000, CONFIG) == quiet


def test_too_few_samples_are_not_quiet():
    assert not imu_is_quiet(buffer_of(0.001, 0.01), 40_000_000, CONFIG)
    assert not imu_is_quiet(ImuBuffer(200.0), 0, CONFIG)


def pixels(n=100):
    return np.random.default_rng(0).uniform([0, 0], [752, 480], (n, 2))


def test_noise_is_no_motion_but_any_turn_is():
    before, rng = pixels(), np.random.default_rng(1)
    noise = 0.7 * rng.standard_normal(before.shape)
    assert image_motion(before, before + noise) < 0.35
    assert image_motion(before, before + noise + [1.5, 0.0]) == pytest.approx(1.5, abs=0.3)
    roll = 0.01 * (before - [376, 240]) @ np.array([[0.0, -1.0], [1.0, 0.0]])
    expected = np.sqrt(np.mean(np.sum(roll**2, axis=1)))
    assert image_motion(before, before + noise + roll) == pytest.approx(expected, rel=0.15)


def test_what_noise_alone_would_move_is_taken_off():
    """However few features there are: it is the mean square that is right, not a limit that grows with them."""
    rng = np.random.default_rng(1)

    def mean_square(shift, n):
        moved = [image_motion(b := pixels(n), b + rng.standard_normal((n, 2)) * 2**0.5 + shift) for _ in range(200)]
        return np.mean(np.square(moved))

    for n in (30, 150):
        noise = 12.0 / n  # what 1 px in each picture would make of it
        assert mean_square([0.0, 0.0], n) < 0.6 * noise  # half of the draws fall below zero, and count as that
        assert mean_square([1.0, 0.5], n) == pytest.approx(1.25, abs=0.3 * noise)


def test_things_that_move_by_themselves_are_left_out():
    before = pixels()
    now = before + 0.1 * np.random.default_rng(1).standard_normal(before.shape)
    now[:25] += [40.0, -20.0]
    assert image_motion(before, now) < 0.1


def test_they_are_left_out_of_a_motion_too():
    """A roll whose flow at the edges is as large as that of a thing that slides: only the fit tells them apart."""
    before = pixels(200)
    roll = 0.01 * (before - [376, 240]) @ np.array([[0.0, -1.0], [1.0, 0.0]])
    now = before + roll + 0.1 * np.random.default_rng(1).standard_normal(before.shape)
    middle = np.abs(before - [376, 240]).max(axis=1) < 100.0
    assert 10 < middle.sum() < 60
    now[middle] += [3.0, 2.0]
    expected = np.sqrt(np.mean(np.sum(roll[~middle] ** 2, axis=1)))
    assert image_motion(before, now) == pytest.approx(expected, rel=0.02)


def test_a_few_features_cannot_tell():
    assert image_motion(pixels(11), pixels(11)) is None
    assert image_motion(pixels(12), pixels(12)) == pytest.approx(0.0, abs=1e-9)

"""Errors and covariances on their way between GTSAM's conventions and ours."""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X
from scipy.spatial.transform import Rotation

from factor.border import bias_of, error_from_gtsam, insert, state_of, swapped
from navcore.odometry import State

R_WB = Rotation.from_rotvec([0.3, -0.7, 1.1]).as_matrix()
STATE = State(
    R_WB, np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.2, -0.1]), np.full(3, 0.01), np.full(3, 0.2), np.eye(15)
)


def test_an_error_of_gtsam_is_the_same_change_of_the_state_in_ours():
    values, moved = gtsam.Values(), gtsam.Values()
    insert(values, 7, STATE)
    e = 1e-6 * np.random.default_rng(0).standard_normal(15)
    moved.insert(X(7), values.atPose3(X(7)).retract(e[:6]))
    moved.insert(V(7), values.atVector(V(7)) + e[6:9])
    moved.insert(B(7), values.atConstantBias(B(7)).retract(e[9:]))
    was, now = state_of(values, 7, np.eye(15)), state_of(moved, 7, np.eye(15))
    change = [
        Rotation.from_matrix(was.R_WB.T @ now.R_WB).as_rotvec(),
        now.p_WB - was.p_WB,
        now.v_WB - was.v_WB,
        now.b_g - was.b_g,
        now.b_a - was.b_a,
    ]
    np.testing.assert_allclose(error_from_gtsam(R_WB) @ e, np.concatenate(change), atol=1e-11)


def test_a_state_comes_back_and_its_covariance_goes_along():
    values = gtsam.Values()
    insert(values, 0, STATE)
    A = np.random.default_rng(1).standard_normal((15, 15))
    back = state_of(values, 0, A @ A.T)
    for name in ("R_WB", "p_WB", "v_WB", "b_g", "b_a"):
        np.testing.assert_allclose(getattr(back, name), getattr(STATE, name), atol=1e-12)
    np.testing.assert_allclose(back.covariance[3:6, 3:6], R_WB @ (A @ A.T)[3:6, 3:6] @ R_WB.T, atol=1e-12)
    np.testing.assert_allclose(back.covariance[9:12, 9:12], (A @ A.T)[12:15, 12:15], atol=1e-12)


def test_biases_are_swapped():
    b = np.arange(6.0)
    np.testing.assert_array_equal(bias_of(b[:3], b[3:]).vector(), swapped(b))
    np.testing.assert_array_equal(swapped(np.diag(b)), np.diag(swapped(b)))

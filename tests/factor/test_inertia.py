"""GTSAM's preintegration as it is used: against the filter's, which has no line in common with it."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, V, X
from scipy.spatial.transform import Rotation

from factor.border import error_from_gtsam, insert
from factor.inertia import Inertia
from msckf.propagation import integrate, noise_in_world, predict, transition
from navcore.imu import ImuNoise
from navcore.imu_buffer import Cells
from navcore.odometry import State

NOISE = ImuNoise(1.7e-3, 2e-4, 2.0e-2, 3.0e-3, 200.0)
START = State(
    Rotation.from_rotvec([0.2, -0.1, 0.5]).as_matrix(),
    np.array([1.0, 2.0, 3.0]),
    np.array([0.5, -0.4, 0.1]),
    np.array([0.01, -0.02, 0.03]),
    np.array([0.1, 0.2, -0.1]),
    np.eye(15),
)


def cells(n=100, bridged=0.0):
    t = np.arange(n) * 0.005
    gyro = np.column_stack([np.sin(3 * t), 0.5 * np.cos(2 * t), 0.3 + 0 * t])
    accel = np.column_stack([np.cos(t), np.sin(2 * t), 9.8 + 0.5 * np.sin(5 * t)])
    gap = np.zeros(n)
    gap[n // 2] = bridged
    return Cells(np.full(n, 0.005), gyro, accel, gap)


def test_the_prediction_is_that_of_the_filter():
    state = gtsam.NavState(gtsam.Rot3(START.R_WB), START.p_WB, START.v_WB)
    bias = gtsam.imuBias.ConstantBias(START.b_a, START.b_g)
    end = Inertia(NOISE).extend(cells(), NOISE, state, bias)
    R, p, v = predict(START.R_WB, START.p_WB, START.v_WB, integrate(cells(), START.b_g, START.b_a, NOISE))
    np.testing.assert_allclose(end.attitude().matrix(), R, atol=2e-5)  # GTSAM integrates to first order in a sample
    np.testing.assert_allclose(end.position(), p, atol=2e-5)
    np.testing.assert_allclose(end.velocity(), v, atol=1e-4)  # with the attitude held over a sample: 0.006


@pytest.mark.parametrize("bridged", [0.0, 0.004], ids=["covered", "with a gap"])
def test_the_factor_weighs_as_the_filter_does(bridged):
    """Its information on the end, start held fixed, is the inverse of the filter's noise."""
    inertia, values = Inertia(NOISE), gtsam.Values()
    insert(values, 0, START)
    bias = values.atConstantBias(B(0))
    inertia.begin(bias)
    end = inertia.extend(cells(bridged=bridged), NOISE, gtsam.NavState(values.atPose3(X(0)), START.v_WB), bias)
    values.insert(X(1), end.pose())
    values.insert(V(1), end.velocity())
    values.insert(B(1), bias)
    factor = inertia.factor(0, 1)
    assert factor.error(values) < 1e-10
    assert inertia.seconds == pytest.approx(0.5)
    A, _ = factor.linearize(values).jacobian()
    H = A.T @ A
    keys = factor.keys()
    at = {}
    for key in keys:
        at[key] = slice(sum(map(size, keys[: keys.index(key)])), sum(map(size, keys[: keys.index(key) + 1])))
    rows = np.concatenate([np.arange(at[key].start, at[key].stop) for key in (X(1), V(1), B(1))])
    T = error_from_gtsam(end.attitude().matrix())
    P = T @ np.linalg.inv(H[np.ix_(rows, rows)]) @ T.T
    increment = integrate(cells(bridged=bridged), START.b_g, START.b_a, NOISE)
    Q = noise_in_world(increment, START.R_WB)
    sigma = np.sqrt(np.diagonal(Q))
    np.testing.assert_allclose(P / np.outer(sigma, sigma), Q / np.outer(sigma, sigma), atol=0.03)


def size(key):
    return 3 if gtsam.Symbol(key).chr() == ord("v") else 6


def test_the_factor_follows_a_change_of_the_bias():
    inertia, values = Inertia(NOISE), gtsam.Values()
    insert(values, 0, START)
    bias = values.atConstantBias(B(0))
    inertia.begin(bias)
    inertia.extend(cells(), NOISE, gtsam.NavState(values.atPose3(X(0)), START.v_WB), bias)
    b_g, b_a = START.b_g + 0.01, START.b_a + 0.1
    increment = integrate(cells(), b_g, b_a, NOISE)
    R, p, v = predict(START.R_WB, START.p_WB, START.v_WB, increment)
    other = gtsam.Values()
    insert(other, 0, State(START.R_WB, START.p_WB, START.v_WB, b_g, b_a, np.eye(15)))
    insert(other, 1, State(R, p, v, b_g, b_a, np.eye(15)))
    assert inertia.factor(0, 1).error(other) < 0.1  # half its squared sigmas; without following: tens
    assert np.abs(transition(increment, (START.R_WB, START.p_WB, START.v_WB), (R, p, v))[:3, 9:12]).max() > 0.4

"""Where navcore's conventions meet GTSAM's.

GTSAM's error of a pose is (rotation, translation in B), that of a bias (accelerometer, gyro); ours is in the order of
`navcore.odometry.BLOCKS` with positions in W.
"""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from navcore.arrays import Floats, Rotations, Vectors
from navcore.odometry import State


def bias_of(b_g: Vectors, b_a: Vectors) -> gtsam.imuBias.ConstantBias:
    """GTSAM's bias of gyro and accelerometer biases (3,)."""
    return gtsam.imuBias.ConstantBias(b_a, b_g)


def swapped(b: Floats) -> Floats:
    """A vector (6,) or covariance (6, 6) of (b_g, b_a) in GTSAM's order, or back."""
    order = np.r_[3:6, 0:3]
    return b[order] if b.ndim == 1 else b[np.ix_(order, order)]


def error_from_gtsam(R_WB: Rotations) -> Floats:
    """(15, 15) that takes the error of GTSAM's (pose, velocity, bias) to ours."""
    T = np.zeros((15, 15))
    T[0:3, 0:3] = T[6:9, 6:9] = np.eye(3)
    T[3:6, 3:6] = R_WB
    T[9:12, 12:15] = T[12:15, 9:12] = np.eye(3)
    return T


def insert(values: gtsam.Values, k: int, state: State) -> None:
    """Put a state in as pose, velocity and bias `k`."""
    values.insert(X(k), gtsam.Pose3(gtsam.Rot3(state.R_WB), state.p_WB))
    values.insert(V(k), state.v_WB)
    values.insert(B(k), bias_of(state.b_g, state.b_a))


def state_of(values: gtsam.Values, k: int, covariance: Floats) -> State:
    """Pose, velocity and bias `k`; `covariance` (15, 15) is in GTSAM's order."""
    pose, bias = values.atPose3(X(k)), values.atConstantBias(B(k))
    R_WB = np.asarray(pose.rotation().matrix())
    T = error_from_gtsam(R_WB)
    P = T @ covariance @ T.T
    v_WB = np.asarray(values.atVector(V(k)))
    b_g, b_a = np.asarray(bias.gyroscope()), np.asarray(bias.accelerometer())
    return State(R_WB, np.asarray(pose.translation()), v_WB, b_g, b_a, 0.5 * (P + P.T))

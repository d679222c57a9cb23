"""Standing still: detected by IMU and images together, used as zero velocity and an unchanged pose."""

import numpy as np

from msckf.blocks import MOTION, POSITION, THETA, VELOCITY
from msckf.config import StandstillConfig
from msckf.state import FilterState
from navcore import so3
from navcore.arrays import Floats, Stamps
from navcore.chi_square import chi_square_quantile


def standstill_update(state: FilterState, config: StandstillConfig) -> bool:
    """Correct the state by standing still, unless a chi-square test finds that it has begun to move.

    Says whether it was corrected (docs/filter.md, section 5).
    """
    H, columns, r, R = unmoved(state, config)
    HP = H @ state.covariance[columns]
    S = HP[:, columns] @ H.T + R
    if r @ np.linalg.solve(S, r) > chi_square_quantile(config.gate_probability, float(len(r))):
        return False
    state.correct(HP, S, r)
    return True


def unmoved(state: FilterState, config: StandstillConfig) -> tuple[Floats, Stamps, Floats, Floats]:
    """The measurement that the pose is that of the newest clone and the velocity zero.

    Returns:
        H (9, 15) by the error states of the indices (15,), r (9,), R (9, 9).
    """
    clones = state.clones
    k = len(clones) - 1
    columns = np.r_[THETA, POSITION, VELOCITY, state.clone(k)]
    R_0, p_0 = clones.R_WB[k], clones.p_WB[k]
    turn = so3.log(R_0.T @ state.R_WB)  # z_hat = log(R_0^T R), z = 0
    H = np.zeros((9, len(columns)))
    H_clone = H[:, MOTION.stop :]  # by the clone's dtheta, dp
    J = so3.right_jacobian_inverse(turn)
    H[THETA, THETA] = J
    H_clone[THETA, THETA] = -J @ (state.R_WB.T @ R_0)
    H[POSITION, POSITION] = np.eye(3)
    H_clone[POSITION, POSITION] = -np.eye(3)
    H[VELOCITY, VELOCITY] = np.eye(3)
    r = np.concatenate([-turn, p_0 - state.p_WB, -state.v_WB])
    sigma = np.repeat([config.rotation_sigma, config.position_sigma, config.velocity_sigma], 3)
    return H, columns, r, np.diag(sigma**2)

"""After a blackout the window is far from where it was thought to be: updates are iterated until they settle."""

import numpy as np
from scipy.stats import chi2

from msckf.blocks import IMU_SIZE, THETA, VELOCITY
from msckf.config import FilterConfig
from msckf.filter import Filter
from msckf.state import FilterState
from msckf.views import Rig
from navcore import so3
from navcore.sequence import Frame
from sim.points import simulate_points
from tests.msckf.scenes import mount, start_state

BLACK_S = (10.0, 30.0)


def test_a_checkpoint_brings_everything_back():
    state = FilterState(start_state(), Rig((mount(),)))
    state.add_clone(5, np.zeros(3))
    kept = state.checkpoint()
    before = np.array(state.covariance), state.R_WB, state.clones.R_WB, state.clones.p_WB, state.b_a
    state.update(np.eye(6), np.r_[state.clone(0)], np.full(6, 0.1), 1e-4 * np.eye(6))
    assert np.abs(state.clones.p_WB - before[3]).max() > 0.01
    state.back_to(kept)
    now = np.array(state.covariance), state.R_WB, state.clones.R_WB, state.clones.p_WB, state.b_a
    for found, expected in zip(now, before, strict=True):
        np.testing.assert_array_equal(found, expected)


def velocity_nees(unsure_velocity):
    """Of the velocity in the body frame one and two seconds after twenty seconds of darkness."""
    sequence = simulate_points(seed=5, seconds=33.5, blackouts=(BLACK_S,))
    vio = Filter(sequence.calibration, FilterConfig().with_overrides({"vision.unsure_velocity": unsure_velocity}))
    start_ns, values = sequence.frames[0].t_ns, []
    wanted = [round(start_ns + (BLACK_S[1] + s) * 1e9) for s in (1.0, 2.0)]
    for event in sequence.events():
        for estimate in vio.add_frame(event) if isinstance(event, Frame) else vio.add_imu(event):
            if wanted and estimate.t_ns >= wanted[0]:
                wanted.pop(0)
                true, s = sequence.truth.at(np.array([estimate.t_ns])), estimate.state
                e = s.R_WB.T @ s.v_WB - true.R_WB[0].T @ true.v_WB[0]
                H = np.zeros((3, IMU_SIZE))
                H[:, THETA], H[:, VELOCITY] = so3.hat(s.R_WB.T @ s.v_WB), s.R_WB.T
                values.append(e @ np.linalg.solve(H @ s.covariance @ H.T, e))
    return values


def test_it_comes_back_from_darkness_without_being_sure_of_a_wrong_velocity():
    assert max(velocity_nees(FilterConfig().vision.unsure_velocity)) < chi2.ppf(0.9999, 3)


def test_without_iteration_it_does_not():
    assert max(velocity_nees(100.0)) > 10.0 * chi2.ppf(0.9999, 3)

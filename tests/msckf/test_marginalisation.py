"""Which pose leaves a full window."""

import numpy as np
import pytest

from msckf import Filter
from msckf.config import FilterConfig
from navcore.sequence import Frame
from sim.points import simulate_points


@pytest.fixture(scope="module")
def slow_flight():
    return simulate_points("quadrotor", seed=1, seconds=12.0, difficulty="easy")


def flown(sequence, order):
    """Median of the seconds that the window reaches back, and the error of the distance from the start at the end."""
    vio = Filter(sequence.calibration, FilterConfig().with_overrides({"vision.marginalise": order}))
    spans, last = [], None
    for event in sequence.events():
        for answer in vio.add_frame(event) if isinstance(event, Frame) else vio.add_imu(event):
            if vio.state is not None and len(vio.state.clones):
                spans.append(np.ptp(vio.state.clones.t_ns) * 1e-9)
                last = answer
    true = sequence.truth.at(np.array([sequence.frames[0].t_ns, last.t_ns])).p_WB
    return np.median(spans), abs(np.linalg.norm(last.state.p_WB) - np.linalg.norm(true[1] - true[0]))


def test_the_oldest_pose_leaves(slow_flight):
    span, error = flown(slow_flight, "oldest")
    assert span == pytest.approx(0.45)  # 10 poses remain of 20 a second
    assert error < 0.05


def test_in_slow_motion_keyframes_reach_farther_back(slow_flight):
    span, error = flown(slow_flight, "keyframes")
    assert span > 0.7
    assert error < 0.05

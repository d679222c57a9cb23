from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from navcore.trajectory import Trajectory
from sim.imu import grade
from sim.motion import Motion
from sim.replay import mounting as m
from sim.replay.chain import SIZE
from sim.replay.fixes import Fixes, attitudes, positions
from sim.replay.increments import _jacobians, residuals, whiten
from sim.replay.knots import Intervals, Knots
from sim.replay.mounting import Mounting
from tests.sim.replay.flights import P_BT, R_BT, R_VW, SHIFT_OFFSET_S, TURN_OFFSET_S, spoil

STEP = 1e-6


Setting = tuple[Trajectory, Knots, Intervals, Mounting]


@pytest.fixture(scope="module")
def exact(flight: Motion) -> Setting:
    spoilt = spoil(flight)
    imu = spoilt.recording.imu[400:440]
    intervals = Intervals.of(imu)
    states = flight.at(intervals.t_ns)
    b_g, b_a = (np.vstack([x[400:440], x[439:440]]) for x in (spoilt.ideal.b_g, spoilt.ideal.b_a))
    knots = Knots(states.R_WB, states.p_WB, states.v_WB, b_g, b_a)
    mounting = Mounting(TURN_OFFSET_S, SHIFT_OFFSET_S, R_VW, R_BT, P_BT)
    margin = 10_000_000
    truth = spoilt.recording.truth.between(int(intervals.t_ns[0]) + margin, int(intervals.t_ns[-1]) - margin)
    return truth, knots, intervals, mounting


def test_residuals_at_the_truth_are_noise(exact: Setting) -> None:
    truth, knots, intervals, mounting = exact
    noise = grade("adis16448").noise
    white = whiten(residuals(knots, intervals), intervals.h, noise)
    assert 0.8 < np.sqrt(np.mean(white[:, :3] ** 2)) < 1.2
    assert 0.8 < np.sqrt(np.mean(white[:, 6:9] ** 2)) < 1.2
    assert np.abs(attitudes(truth, knots, intervals, mounting).r).max() < 8e-3
    assert np.abs(positions(truth, knots, intervals, mounting).r).max() < 4e-3


@pytest.mark.parametrize("see", [attitudes, positions])
def test_jacobians_of_fixes(see: Callable[..., Fixes], exact: Setting) -> None:
    truth, knots, intervals, mounting = exact
    here = see(truth, knots, intervals, mounting)
    for c in range(m.SIZE):
        # Offsets act through whole nanoseconds, and a step must not carry a pose across a knot's kink.
        step = 1e-5 if c < 2 else STEP
        dx = np.zeros(m.SIZE)
        dx[c] = step
        there = see(truth, knots, intervals, mounting.moved(dx))
        np.testing.assert_allclose((there.r - here.r) / step, here.by_constants[..., c], atol=0.05)
    for c in range(9):  # biases act within the interval only, which the Jacobian leaves out
        dx = np.zeros((len(knots.p_WB), SIZE))
        dx[:, c] = STEP
        there = see(truth, knots.moved(dx), intervals, mounting)
        np.testing.assert_allclose((there.r - here.r) / STEP, here.by_knot[..., c], atol=0.02)


def test_jacobians_of_increments(exact: Setting) -> None:
    _, knots, intervals, _ = exact
    before, after = _jacobians(knots, intervals)
    here = residuals(knots, intervals)
    for c in range(SIZE):
        for jacobian, which in ((before, slice(0, None, 2)), (after, slice(1, None, 2))):
            dx = np.zeros((len(knots.p_WB), SIZE))
            dx[which, c] = STEP
            change = (residuals(knots.moved(dx), intervals) - here) / STEP
            rows = np.arange(len(here))[0::2]  # the intervals whose knot before, or after, has moved
            np.testing.assert_allclose(change[rows], jacobian[rows][..., c], atol=2e-3)


def test_a_far_pose_counts_for_little() -> None:
    none = np.zeros((1, 3, 1))
    far = Fixes(np.zeros(2, dtype=np.int64), np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), none, none)
    near, away = far.weights(1e-3)
    assert near == pytest.approx(1.75)
    assert away < 1e-5
    assert replace(far, r=far.r * 0.0).refit(1.0) == 1e-3

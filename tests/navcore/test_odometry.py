from dataclasses import replace

import numpy as np

from navcore.odometry import BLOCKS, Estimate, Health, RunRecorder, State, run
from navcore.sequence import Frame
from tests.navcore.recordings import sequence


def state(k, seed=0):
    A = np.random.default_rng(seed + k).normal(size=(15, 15))
    return State(np.eye(3), np.full(3, float(k)), np.ones(3), np.full(3, 0.1), np.full(3, 0.2), A @ A.T)


class Echo:
    """Answers each frame when the first sample after it has come."""

    def __init__(self):
        self.waiting = []
        self.log = []

    def add_imu(self, samples):
        self.log.append(("imu", len(samples)))
        done, self.waiting = self.waiting, []
        return [Estimate(t, Health.TRACKING, state=state(0)) for t in done]

    def add_frame(self, frame: Frame):
        self.log.append(("frame", frame.t_ns))
        self.waiting.append(frame.t_ns)
        return []

    def finish(self):
        return [Estimate(t, Health.LOST) for t in self.waiting]


def test_a_run_has_an_estimate_for_every_frame():
    echo, done = Echo(), []
    result = run(echo, sequence(), done.append)
    assert [e.t_ns for e in result.estimates] == [f.t_ns for f in sequence().frames]
    assert done == list(range(1, 11))
    assert sum(n for kind, n in echo.log if kind == "imu") == 201
    assert result.completeness == 1.0


def test_a_frame_that_no_sample_follows_is_answered_at_the_end():
    whole = sequence()
    imu = whole.imu.between(0, whole.frames[-1].t_ns)
    result = run(Echo(), replace(whole, imu=imu))
    assert [e.health for e in result.estimates] == [Health.TRACKING] * 9 + [Health.LOST]
    assert result.completeness == 0.9


def test_the_recorder_keeps_diagonal_blocks_in_order():
    recorder = RunRecorder()
    recorder.add([Estimate(1, Health.INITIALISING)])
    recorder.add([Estimate(2, Health.TRACKING, state=state(1)), Estimate(3, Health.TRACKING, state=state(2))])
    result = recorder.result()
    np.testing.assert_array_equal(result.has_state, [False, True, True])
    assert result.completeness == 2 / 3
    for k, name in enumerate(BLOCKS):
        block = slice(3 * k, 3 * k + 3)
        np.testing.assert_array_equal(result.covariances[1, k], state(2).covariance[block, block], err_msg=name)
    variances = np.diag(state(1).covariance).reshape(5, 3)
    np.testing.assert_allclose(result.sigmas[0], np.sqrt(variances))
    assert result.estimates[1].state.covariance.size == 0  # memory stays flat


def test_the_trajectory_of_a_run_has_velocity_and_biases():
    recorder = RunRecorder()
    recorder.add([Estimate(1, Health.INITIALISING), Estimate(2, Health.TRACKING, state=state(7))])
    trajectory = recorder.result().trajectory
    assert trajectory.t_ns.tolist() == [2]
    np.testing.assert_array_equal(trajectory.p_WB, [[7.0] * 3])
    np.testing.assert_array_equal(trajectory.b_a, [[0.2] * 3])
    np.testing.assert_array_equal(trajectory.b_g, [[0.1] * 3])


def test_an_empty_run():
    empty = RunRecorder().result()
    assert empty.completeness == 0.0
    assert len(empty.trajectory) == 0
    assert empty.sigmas.shape == (0, 5, 3)

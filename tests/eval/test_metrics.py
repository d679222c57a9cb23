import json

import numpy as np
import pytest
from evo.core import metrics as evo_metrics
from evo.core.trajectory import PoseTrajectory3D
from scipy.spatial.transform import Rotation

from eval.errors import ScoreError
from eval.metrics import associate, has_diverged, relative_errors, score, segments, still_drift
from navcore.trajectory import Trajectory
from tests.eval.paths import drifting, flight


def evo_path(path):
    return PoseTrajectory3D(path.p_WB.copy(), path.q_WB[:, [3, 0, 1, 2]].copy(), path.t_ns * 1e-9)


def evo_ape(truth, estimate, relation):
    reference, aligned = evo_path(truth), evo_path(estimate)
    aligned.align(reference)
    metric = evo_metrics.APE(relation)
    metric.process_data((reference, aligned))
    return metric.get_statistic(evo_metrics.StatisticsType.rmse)


def evo_rpe(truth, estimate, relation):
    metric = evo_metrics.RPE(relation, 1, evo_metrics.Unit.frames)
    metric.process_data((evo_path(truth), evo_path(estimate)))
    return metric.get_statistic(evo_metrics.StatisticsType.rmse)


@pytest.fixture
def pair():
    rng = np.random.default_rng(3)
    truth = flight(rng)
    return truth, drifting(truth, rng)


def test_ate_and_rpe_are_evos(pair):
    truth, estimate = pair
    found = score(estimate, truth, alignment="se3")
    relation = evo_metrics.PoseRelation
    assert found["ate_m"] == pytest.approx(evo_ape(truth, estimate, relation.translation_part), rel=1e-9)
    assert found["ate_deg"] == pytest.approx(evo_ape(truth, estimate, relation.rotation_angle_deg), rel=1e-6)
    assert found["rpe_m"] == pytest.approx(evo_rpe(truth, estimate, relation.translation_part), rel=1e-9)
    assert found["rpe_rad"] == pytest.approx(evo_rpe(truth, estimate, relation.rotation_angle_rad), rel=1e-6)
    assert found["path_m"] == pytest.approx(evo_path(truth).path_length)


def test_yaw_alignment_frees_less_than_se3(pair):
    truth, estimate = pair
    assert score(estimate, truth)["ate_m"] > score(estimate, truth, alignment="se3")["ate_m"]
    assert score(estimate, truth, alignment="none")["ate_m"] > 2.0


def test_a_known_error_comes_back_as_it_was_put_in():
    truth = flight(np.random.default_rng(4))
    tilt = Rotation.from_rotvec([np.radians(2.0), 0.0, 0.0])  # about B's x, the same in every pose
    swing = np.where(np.arange(len(truth)) % 2, 0.03, -0.03)
    p_WB = truth.p_WB + np.outer(swing, [0.0, 0.0, 1.0])
    estimate = Trajectory(truth.t_ns, (Rotation.from_quat(truth.q_WB) * tilt).as_quat(), p_WB)
    found = score(estimate, truth)
    assert found["ate_m"] == pytest.approx(0.03, rel=1e-2)
    assert found["ate_deg"] == pytest.approx(2.0, rel=1e-2)
    assert found["initial_ate_m"] == pytest.approx(0.03, rel=1e-2)
    assert "b_g_rmse" not in found


def test_initial_phase_sees_only_the_first_ten_seconds(pair):
    truth, _ = pair
    late = truth.seconds > 10.0
    estimate = Trajectory(truth.t_ns, truth.q_WB, truth.p_WB + np.outer(late, [0.0, 0.0, 5.0]))
    found = score(estimate, truth)
    assert found["initial_ate_m"] == pytest.approx(0.0, abs=1e-9)
    assert found["ate_m"] > 1.0


def test_poses_outside_truth_or_in_its_gaps_do_not_count(pair):
    truth, estimate = pair
    known = (truth.seconds > 5.0) & ~((truth.seconds > 20.0) & (truth.seconds < 30.0))
    wild = Trajectory(estimate.t_ns, estimate.q_WB, np.where(known[:, None], estimate.p_WB, 1e3))
    found = score(wild, truth[known])
    assert found["poses"] == np.count_nonzero(known)
    assert found["ate_m"] < 0.5


def test_no_step_from_frame_to_frame_spans_a_gap_of_the_truth(pair):
    truth, _ = pair
    known = (truth.seconds < 20.0) | (truth.seconds > 30.0)
    jump = np.outer(truth.seconds > 25.0, [3.0, 0.0, 0.0])  # where nobody knows
    estimate = Trajectory(truth.t_ns, truth.q_WB, truth.p_WB + jump)
    assert score(estimate, truth[known])["rpe_m"] == pytest.approx(0.0, abs=1e-9)
    assert score(estimate, truth)["rpe_m"] > 0.05


def test_truth_is_interpolated_at_the_stamps_of_the_estimate(pair):
    truth, _ = pair
    middle = (truth.t_ns[:-1] + truth.t_ns[1:]) // 2
    estimate = truth.at(middle)
    found = associate(estimate, truth)
    assert len(found) == len(middle)
    np.testing.assert_allclose(found.truth.p_WB, 0.5 * (truth.p_WB[:-1] + truth.p_WB[1:]), atol=1e-9)


@pytest.mark.parametrize("length", [8.0, 40.0])
def test_segments_have_the_length_asked_for(pair, length):
    truth, _ = pair
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth.p_WB, axis=0), axis=1))])
    first, last = segments(truth, length)
    lengths = travelled[last] - travelled[first]
    assert len(first) > 50
    assert (lengths >= length).all() and (lengths <= 1.2 * length).all()
    assert (travelled[last - 1] - travelled[first] < length).all()


def test_a_leap_makes_no_segment(pair):
    truth, _ = pair
    steps = np.zeros((10, 3))
    steps[5:, 0] = 10.0
    standing = Trajectory(truth.t_ns[:10], truth.q_WB[:10], steps)  # ten metres in one step
    assert len(segments(standing, 8.0)[0]) == 0
    assert len(segments(standing, 9.0)[0]) == 5


def test_segment_errors_are_those_of_matrices(pair):
    truth, estimate = pair
    first, last = segments(truth, 16.0)
    angles, distances = relative_errors(associate(estimate, truth), first, last)

    def matrix(path, k):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = path.R_WB[k], path.p_WB[k]
        return T

    for k in range(0, len(first), 97):
        i, j = first[k], last[k]
        E = np.linalg.inv(np.linalg.inv(matrix(truth, i)) @ matrix(truth, j)) @ (
            np.linalg.inv(matrix(estimate, i)) @ matrix(estimate, j)
        )
        assert distances[k] == pytest.approx(np.linalg.norm(E[:3, 3]))
        assert angles[k] == pytest.approx(Rotation.from_matrix(E[:3, :3]).magnitude())
    found = score(estimate, truth)
    assert found["rpe_16m_m"] == pytest.approx(np.median(distances))


def test_bias_errors_ignore_what_truth_does_not_know(pair):
    truth, estimate = pair
    found = score(estimate, truth)
    assert found["b_a_rmse"] == pytest.approx(0.02 * np.sqrt(3.0))
    assert found["b_a_end"] == pytest.approx(0.02 * np.sqrt(3.0))
    assert found["b_g_rmse"] == pytest.approx(1e-3 * np.sqrt(3.0), rel=0.1)
    half = np.where(truth.seconds[:, None] < 30.0, truth.b_a, np.nan)
    known = score(estimate, Trajectory(truth.t_ns, truth.q_WB, truth.p_WB, b_g=truth.b_g * np.nan, b_a=half))
    assert known["b_a_rmse"] == pytest.approx(0.02 * np.sqrt(3.0))
    assert "b_g_rmse" not in known


def test_a_score_is_flat_json_without_nan(pair):
    truth, estimate = pair
    for path in (estimate, estimate[:1], estimate[:2], estimate[:0]):
        found = score(path, truth)
        assert json.loads(json.dumps(found, allow_nan=False)) == found


def test_a_run_without_a_pose_in_truth_has_diverged(pair):
    truth, estimate = pair
    assert score(estimate[:0], truth) == {"poses": 0.0, "diverged": 1.0}
    assert score(estimate[:100], truth[200:]) == {"poses": 0.0, "diverged": 1.0}


@pytest.mark.parametrize(
    ("ate_m", "path_m", "diverged"),
    [(0.4, 1.0, False), (0.6, 1.0, True), (9.0, 100.0, False), (11.0, 100.0, True)],
)
def test_divergence_needs_a_tenth_of_the_path_and_half_a_metre(ate_m, path_m, diverged):
    assert has_diverged(ate_m, path_m) is diverged


def test_still_drift_is_the_largest_distance_in_the_last_seconds(pair):
    truth, _ = pair
    p_WB = np.where(truth.seconds[:, None] < 48.0, truth.p_WB, [1.0, 2.0, 3.0])
    p_WB[-20] += [0.003, 0.0, 0.0]
    p_WB[-50] -= [0.002, 0.0, 0.0]
    assert still_drift(Trajectory(truth.t_ns, truth.q_WB, p_WB), 11.0) == pytest.approx(0.005)
    with pytest.raises(ScoreError, match="empty"):
        still_drift(truth[:0], 1.0)

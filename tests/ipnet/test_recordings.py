"""Which biases a recording is held against."""

import json

import numpy as np
import pytest

from ipnet.errors import LabelError
from ipnet.recordings import Label, find_all, kept_apart, labelled, open_recordings, read_labels
from navcore.calibration import Calibration
from navcore.imu import ImuNoise, ImuSamples
from navcore.sequence import Sequence
from navcore.trajectory import Trajectory

T_NS = np.arange(11, dtype=np.int64) * 100_000_000
TRUE = np.linspace(0.0, 1.0, 11)[:, None] + np.arange(6.0)
EYE = np.eye(6).tolist()
LABEL = Label("r", -np.ones(6), np.eye(6))


def sequence(b_g=None, b_a=None):
    imu = ImuSamples(T_NS, np.zeros((11, 3)), np.zeros((11, 3)))
    q = np.tile([0.0, 0.0, 0.0, 1.0], (11, 1))
    truth = Trajectory(T_NS, q, np.zeros((11, 3)), np.zeros((11, 3)), b_g, b_a)
    return Sequence("r", Calibration(ImuNoise(1e-4, 0.0, 1e-3, 0.0)), imu, (), truth)


@pytest.mark.parametrize("label", [None, LABEL])
def test_true_biases_are_the_reference_also_beside_a_label(label):
    found = labelled(sequence(TRUE[:, :3], TRUE[:, 3:]), label)
    np.testing.assert_allclose(found.bias_at(T_NS), TRUE)
    np.testing.assert_allclose(found.label.bias, TRUE.mean(axis=0))


def test_a_label_counts_where_truth_has_no_biases():
    nowhere = np.full((11, 3), np.nan)
    for bare in (sequence(), sequence(nowhere, nowhere)):
        found = labelled(bare, LABEL)
        np.testing.assert_array_equal(found.bias_at(T_NS), np.tile(LABEL.bias, (11, 1)))
        assert found.label is LABEL
        with pytest.raises(LabelError, match="r: its truth has no biases; expected a label"):
            labelled(bare)


def test_labels_can_be_asked_first():
    found = labelled(sequence(TRUE[:, :3], TRUE[:, 3:]), LABEL, labels_first=True)
    np.testing.assert_array_equal(found.bias_at(T_NS), np.tile(LABEL.bias, (11, 1)))
    assert found.label is LABEL
    assert found.truth is not None and len(found.truth) == 11
    without = labelled(sequence(TRUE[:, :3], TRUE[:, 3:]), None, labels_first=True)
    np.testing.assert_allclose(without.bias_at(T_NS), TRUE)
    with pytest.raises(LabelError, match="labels come first, but none are given"):
        open_recordings([], None, labels_first=True)


def folder(path):
    (path / "mav0/imu0").mkdir(parents=True)
    (path / "mav0/imu0/data.csv").touch()
    return path


def test_named_recordings_are_taken_and_a_missing_one_is_told(tmp_path):
    one, other = folder(tmp_path / "r1"), folder(tmp_path / "r2")
    assert find_all([tmp_path], ["r2"]) == [other]
    assert find_all([tmp_path], ["r2", "r1"]) == [one, other]
    with pytest.raises(LabelError, match="r3, r4: not among the recordings given, r1, r2"):
        find_all([tmp_path], ["r4", "r1", "r3"])


def test_a_folder_given_twice_is_one_recording_and_two_of_one_name_are_none(tmp_path):
    one, other = folder(tmp_path / "a/r1"), folder(tmp_path / "a/r2")
    assert find_all([tmp_path / "a", one, one / "mav0", one.parent / ".." / "a" / "r2"]) == [one, other]
    folder(tmp_path / "b/r1")
    with pytest.raises(LabelError, match=r"a/r1 and .*b/r1: two recordings of one name"):
        find_all([tmp_path])


def test_what_is_learned_from_does_not_judge():
    kept_apart(["a", "b"], ["c"])
    with pytest.raises(LabelError, match="b, c: learned from and validated on"):
        kept_apart(["a", "b", "c"], ["c", "b"])


def test_labels_are_finite(tmp_path):
    path = tmp_path / "labels.json"
    path.write_text(json.dumps([{"sequence": "r", "b_g": [0, 0, float("nan")], "b_a": [0] * 3, "covariance": EYE}]))
    with pytest.raises(LabelError, match=r"labels\.json.*r: bias .* or its covariance is not finite"):
        read_labels(path)

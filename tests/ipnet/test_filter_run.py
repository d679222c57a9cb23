"""Which poses of a filter's run may stand in for truth, and the labels that they give."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ipnet.errors import LabelError
from ipnet.labels import good_path, label
from navcore.results.folder import BIASES, FRAMES, RUN, TRAJECTORY
from tests.ipnet.swinging import BIAS, recording, truth

SIGMA = np.array([1e-4, 2e-4, 3e-4, 0.01, 0.02, 0.03])


def run_folder(folder, seconds=60.0, lost=(), few=()):
    """A run that begins at 1 s and follows the body exactly; `lost` and `few` are spans in seconds."""
    folder.mkdir()
    path = truth(seconds, rate_hz=20.0)
    path = path[path.seconds >= 1.0]
    at = path.t_ns * 1e-9
    path.to_tum(folder / TRAJECTORY)
    rows = [f"{t}," + ",".join(["0.0"] * 6 + [str(5.0 if t < 11e9 else x) for x in SIGMA]) for t in path.t_ns.tolist()]
    (folder / BIASES).write_text("t_ns" + ",x" * 12 + "\n" + "\n".join(rows) + "\n")
    lines = ["t_ns,health,reasons,tracked,used", "500000000,INITIALISING,,50,0"]
    for t, s in zip(path.t_ns.tolist(), at.tolist(), strict=True):
        health = "INERTIAL_ONLY" if any(a <= s < b for a, b in lost) else "TRACKING"
        lines.append(f"{t},{health},,{5 if any(a <= s < b for a, b in few) else 80},20")
    (folder / FRAMES).write_text("\n".join(lines) + "\n")
    (folder / RUN).write_text(json.dumps({"config": {}, "summary": {}}))
    return folder


def test_start_losses_and_poor_views_are_left_out(tmp_path):
    kept = good_path(run_folder(tmp_path / "run", lost=[(30.0, 32.0)], few=[(50.0, 51.0)]))
    t = kept.poses.t_ns * 1e-9
    assert t[0] == pytest.approx(11.0)
    gaps = np.flatnonzero(np.diff(t) > 0.06)
    spans = [(round(float(t[k]), 2), round(float(t[k + 1]), 2)) for k in gaps]
    assert spans == [(29.95, 36.95), (49.95, 51.0)]


def test_a_good_path_gives_the_label_of_the_truth(tmp_path):
    sequence = recording(60.0)
    found = label(sequence, path=good_path(run_folder(tmp_path / "run", lost=[(30.0, 32.0)])))
    np.testing.assert_allclose(found.label.bias[:3], BIAS[:3], atol=1e-5)
    np.testing.assert_allclose(found.label.bias[3:], BIAS[3:], atol=1e-3)
    assert found.left_out == 7


def test_a_label_is_no_surer_than_the_filter_was_meanwhile(tmp_path):
    sequence, path = recording(60.0), good_path(run_folder(tmp_path / "run"))
    np.testing.assert_allclose(path.sigma, SIGMA, rtol=1e-9)
    found, exact = label(sequence, path=path).label, label(sequence, path=replace(path, sigma=np.zeros(6))).label
    np.testing.assert_array_equal(found.bias, exact.bias)
    np.testing.assert_allclose(found.covariance - exact.covariance, np.diag(SIGMA**2), atol=1e-15)


def test_runs_without_a_good_pose_are_refused(tmp_path):
    with pytest.raises(LabelError, match=r"none of .* poses is good"):
        good_path(run_folder(tmp_path / "poor", few=[(0.0, 100.0)]))
    with pytest.raises(LabelError, match=r"none of .* poses is good"):
        good_path(run_folder(tmp_path / "lost", lost=[(0.0, 100.0)]))
    folder = run_folder(tmp_path / "odd")
    (folder / FRAMES).write_text("t_ns,health\n1,TRACKING\n")
    with pytest.raises(LabelError, match="expected columns"):
        good_path(folder)

"""Starts from many times: which, how they are scored, and that what was measured is kept."""

import json
from dataclasses import replace

import numpy as np
import pytest

from eval import starts
from eval.errors import StudyError
from eval.starts import Asked, StartScore, measure_start, measure_starts, scale_error, start_times, starts_table
from navcore.odometry import Estimate, Health
from navcore.trajectory import Trajectory
from sim.points import simulate_points


@pytest.fixture(scope="module")
def flight():
    return simulate_points(seed=1, seconds=12.0, moving_start=True)


def test_times_are_spread_evenly_and_leave_room_for_a_start(flight):
    found = start_times(flight, 4)
    last = (flight.frames[-1].t_ns - flight.frames[0].t_ns) * 1e-9
    np.testing.assert_allclose(np.diff(found), (last - 5.0) / 3.0, atol=2e-3)
    assert found[0] == 0.0
    with pytest.raises(StudyError, match=r"less than 5\.0 s"):
        start_times(flight.span(0.0, 4.0), 4)
    with pytest.raises(StudyError, match="truth with velocity"):
        start_times(replace(flight, truth=None), 4)


def test_a_start_is_measured(flight):
    score = measure_start(flight, "flight", 3.0, Asked(prior="truth"))
    assert score.good, score
    assert 0.5 < score.start_s < 3.0
    assert score.vision_s == pytest.approx(0.0, abs=0.1)
    assert score.velocity < 4.0 * score.velocity_sigma
    assert score.nees < 4.0
    assert score.attempt_ms > 0.0


def test_why_there_is_no_start(flight):
    score = measure_start(flight, "flight", 3.0, Asked(overrides={"start.mode": "static"}))
    assert (score.start_s, score.velocity, score.good) == (None, None, False)
    assert score.reason == "not standing still"


@pytest.mark.parametrize("stretch", [0.8, 1.0, 1.25])
def test_the_scale_is_that_of_the_path_whatever_its_heading(stretch):
    t = np.linspace(0.0, 2.0, 41)
    p = np.column_stack([np.sin(t), 0.5 * t**2, 0.1 * t])
    q = np.tile([0.0, 0.0, 0.0, 1.0], (41, 1))
    true = Trajectory(np.arange(41) * 50_000_000, q, p)
    turned = stretch * p @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) + 3.0
    assert scale_error(replace(true, p_WB=turned), true) == pytest.approx(stretch - 1.0)
    assert scale_error(true, replace(true, p_WB=0.01 * p)) is None


def test_vision_is_usable_when_it_has_lasted():
    tracked = [50] * 3 + [5] * 2 + [50] * 20
    estimates = [Estimate(k * 100_000_000, Health.INITIALISING, tracked=n) for k, n in enumerate(tracked)]
    assert starts._usable_vision(estimates, 0) == pytest.approx(0.5)
    assert starts._usable_vision(estimates[:8], 0) is None


def test_good_is_in_time_and_right():
    good = StartScore("a", 0.0, 1.0, 3.9, velocity=0.05, scale=0.02)
    assert good.good
    assert not replace(good, start_s=4.1).good
    assert not replace(good, velocity=0.2).good
    assert not replace(good, scale=-0.06).good
    assert replace(good, scale=None).good
    assert not replace(good, lost=True).good


def test_what_was_measured_is_kept(tmp_path, flight, monkeypatch):
    monkeypatch.setattr(starts, "open_sequence", lambda path: flight)
    calls = []
    real = starts.measure_start
    monkeypatch.setattr(starts, "measure_start", lambda *given: calls.append(given[2]) or real(*given))
    done = []
    first = measure_starts([tmp_path / "a"], Asked(2), tmp_path / "out", lambda n, total: done.append((n, total)))
    again = measure_starts([tmp_path / "a"], Asked(2), tmp_path / "out")
    assert (len(calls), done, again) == (2, [(1, 2), (2, 2)], first)
    assert all(json.loads(file.read_text()) for file in (tmp_path / "out").glob("*.json"))
    measure_starts([tmp_path / "a"], Asked(2, overrides={"vision.fej": False}), tmp_path / "out")
    assert len(calls) == 4


def test_the_table_has_a_row_for_each_recording_and_for_all():
    scores = [StartScore("a", 0.0, 0.0, 1.0, velocity=0.05, scale=0.02), StartScore("b", 0.0, reason="dark")]
    table = starts_table(scores)
    assert [row[0] for row in table.rows] == ["a", "b", "all"]
    assert [row[2] for row in table.rows] == ["100%", "0%", "50%"]
    assert all(len(row) == len(table.columns) for row in table.rows)

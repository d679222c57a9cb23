"""Trajectories of several systems side by side."""

import json

import numpy as np
import pytest
from evo.core import metrics as evo_metrics
from evo.core.trajectory import PoseTrajectory3D

from eval.__main__ import main
from eval.compare import Comparison, named
from eval.errors import ScoreError
from navcore.trajectory import Trajectory
from tests.eval.paths import drifting, flight

RNG = np.random.default_rng(7)
TRUTH = flight(RNG)
A, B = drifting(TRUTH, RNG), drifting(TRUTH, RNG, 0.03)[200:-100]


def test_all_are_scored_over_the_time_that_all_have():
    compared = Comparison.of({"a": A, "b": B}, TRUTH)
    scores = compared.scores()
    assert scores["a"]["poses"] == scores["b"]["poses"] == len(B)
    assert compared.begin_s == pytest.approx(10.0) and compared.end_s == pytest.approx(TRUTH.seconds[-1] - 5.0)
    assert scores["a"]["ate_m"] < scores["b"]["ate_m"]
    columns, rows = compared.table().columns, {row[0]: row[1:] for row in compared.table().rows}
    assert columns == ("measure", "a", "b")
    assert rows["ATE [m]"] == tuple(f"{s['ate_m']:.4f}" for s in scores.values())


def test_its_numbers_are_evos():
    """Under an alignment by a rotation about all axes, which evo has."""
    mine = Comparison.of({"a": A, "b": B}, TRUTH, "se3").scores()["a"]
    span = slice(200, -100)
    reference, estimate = (
        PoseTrajectory3D(x.p_WB[span], x.q_WB[span][:, [3, 0, 1, 2]], x.t_ns[span] * 1e-9) for x in (TRUTH, A)
    )
    estimate.align(reference)
    found = {}
    for name, relation in (
        ("ate_m", evo_metrics.PoseRelation.translation_part),
        ("ate_deg", evo_metrics.PoseRelation.rotation_angle_deg),
    ):
        metric = evo_metrics.APE(relation)
        metric.process_data((reference, estimate))
        found[name] = metric.get_statistic(evo_metrics.StatisticsType.rmse)
    assert {name: mine[name] for name in found} == pytest.approx(found, rel=1e-6)


def test_what_cannot_be_compared_is_named():
    late = Trajectory(TRUTH.t_ns + 10**12, TRUTH.q_WB, TRUTH.p_WB)
    with pytest.raises(ScoreError, match=r"no time that all of them have: .*late"):
        Comparison.of({"a": A, "late": late}, TRUTH)
    with pytest.raises(ScoreError, match="no pose in b"):
        Comparison.of({"a": A, "b": B[:0]}, TRUTH)
    with pytest.raises(ScoreError, match="nothing to compare"):
        Comparison.of({}, TRUTH)


def test_files_get_names_that_tell_them_apart(tmp_path):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        A.to_tum(tmp_path / folder / "path.tum")
    files = tuple(tmp_path / folder / "path.tum" for folder in ("one", "two"))
    assert list(named(files)) == ["one/path", "two/path"]
    assert list(named(files[:1])) == ["path"]
    with pytest.raises(ScoreError, match="named twice"):
        named((files[0], files[0]))


def test_the_command(tmp_path, monkeypatch, capsys):
    for name, path in (("a", A), ("b", B), ("truth", TRUTH)):
        path.to_tum(tmp_path / f"{name}.tum")
    a, b, truth = (str(tmp_path / f"{name}.tum") for name in ("a", "b", "truth"))
    picture = tmp_path / "paths.png"
    monkeypatch.setattr("sys.argv", ["eval", "compare", a, b, "--truth", truth, "--json", "--plot", str(picture)])
    assert main() == 0
    printed = json.loads(capsys.readouterr().out)
    assert list(printed) == ["a", "b"] and printed["a"]["ate_m"] < printed["b"]["ate_m"]
    assert picture.stat().st_size > 10_000
    monkeypatch.setattr("sys.argv", ["eval", "compare", a, "--truth", truth, "--plot", str(tmp_path / "no" / "x.png")])
    with pytest.raises(SystemExit):
        main()
    assert "cannot be written" in capsys.readouterr().err

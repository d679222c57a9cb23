import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eval import records
from eval.cells import Cell, Study, versions
from eval.errors import StudyError
from eval.outcome import load
from eval.records import Record
from eval.study import run_study
from eval.work import load_estimator, run_cell
from tests.eval.fakes import FakeFlight

FAKE = "tests.eval.fakes:make"
MADE_WITH = {"code": "1"}


def cell(seed=1, arm="none", **overrides):
    settings = tuple(sorted(overrides.items()))
    return Cell(FakeFlight(seed), "fake", "tests", "clean", seed, arm, estimator=FAKE, overrides=settings)


def test_a_result_is_named_by_everything_that_decides_it():
    one = cell()
    others = [cell(seed=2), cell(scale=2.0), replace(one, prior="truth"), replace(one, estimator="msckf")]
    keys = [c.key(MADE_WITH) for c in (one, *others)] + [one.key({"code": "2"})]
    assert len(set(keys)) == len(keys)
    assert cell().key(MADE_WITH) == one.key(MADE_WITH)
    assert replace(one, regime="other", condition="dark", level=2.0, axis="x").key(MADE_WITH) == one.key(MADE_WITH)
    with pytest.raises(StudyError, match="cannot be named"):
        cell(scale=np.zeros(3)).key(MADE_WITH)


def test_cells_that_ask_the_same_share_a_result_and_keep_their_names(tmp_path):
    cells = (cell(), replace(cell(), regime="other", condition="level 2", level=2.0, axis="x"), cell(2))
    seen = []
    outcome = run_study(Study("shared", cells), tmp_path, workers=1, progress=seen.append)
    assert len(list((tmp_path / "cells").iterdir())) == 2
    assert [r.config["regime"] for r in outcome.records] == ["tests", "other", "tests"]
    assert outcome.records[1].config["level"] == 2.0 and "level 2" in outcome.records[1].title
    assert outcome.records[0].key == outcome.records[1].key != outcome.records[2].key
    assert (seen[0].cells, seen[-1].cells, seen[-1].all_cells) == (0, 3, 3)
    assert seen[-1].cost_s == pytest.approx(seen[-1].all_cost_s) == pytest.approx(2 * 0.1 + 2 * 0.2)


def test_versions_change_with_the_code(tmp_path, monkeypatch):
    package = tmp_path / "strange_estimator"
    package.mkdir()
    (package / "__init__.py").write_text("a = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    before = versions(("strange_estimator:make",))
    assert before == versions(("strange_estimator:make",))
    (package / "__init__.py").write_text("a = 2\n")
    assert before["code"] != versions(("strange_estimator:make",))["code"]


def test_a_record_comes_back_as_it_was_written(tmp_path):
    key = run_cell(cell(), MADE_WITH, tmp_path)
    found = records.read(records.path_of(tmp_path, key))
    assert found.failure is None
    assert found.config == json.loads(json.dumps(cell().config))
    assert found.config["source"] == {"kind": "FakeFlight", "seed": 1, "seconds": 20.0}
    assert found.versions == MADE_WITH
    assert found.scores["completeness"] == 1.0
    assert found.scores["ate_m"] == pytest.approx(0.1 * np.sqrt(3.0), rel=0.1)
    series = found.series
    assert np.diff(series["t_s"]).mean() == pytest.approx(0.2)
    truth = FakeFlight(1).load(tmp_path).truth.at(series["t_ns"].to_numpy())
    np.testing.assert_allclose(found.column("true_p_WB"), truth.p_WB, atol=1e-5)
    np.testing.assert_allclose(found.column("sigma_db_a"), 0.02, rtol=1e-6)
    assert np.abs(found.column("p_WB") - truth.p_WB).max() < 0.6
    assert np.isnan(found.column("true_q_WB")).sum() == 0


def test_nees_of_the_series_belongs_to_its_frames(tmp_path):
    found = records.read(records.path_of(tmp_path, run_cell(cell(), MADE_WITH, tmp_path)))
    early = found.series["t_s"] < 0.99
    assert found.series.loc[early, "nees_db_g"].isna().all()
    e = found.column("true_b_g") - found.column("b_g")
    expected = np.sum((e / found.column("sigma_db_g")) ** 2, axis=1)
    np.testing.assert_allclose(found.series.loc[~early, "nees_db_g"], expected[~early], rtol=1e-3)


def test_a_cell_that_raises_is_a_record_with_its_message(tmp_path):
    found = records.read(records.path_of(tmp_path, run_cell(cell(fail="no luck"), MADE_WITH, tmp_path)))
    assert found.failure == "RuntimeError: no luck"
    assert found.series.empty
    unknown = replace(cell(), prior="nonsense")
    found = records.read(records.path_of(tmp_path, run_cell(unknown, MADE_WITH, tmp_path)))
    assert found.failure is not None and "'nonsense' is unknown" in found.failure


def test_a_cell_that_cannot_be_run_is_no_result(tmp_path):
    unknown = replace(cell(), estimator="nonsense")
    with pytest.raises(StudyError, match="unknown"):
        run_cell(unknown, MADE_WITH, tmp_path)
    assert not (tmp_path / "cells").exists()
    outcome = run_study(Study("unknown", (cell(), unknown)), tmp_path, workers=1)
    assert len(outcome.records) == 1 and outcome.missing == (unknown.title,)
    assert len(outcome.errors) == 1 and "'nonsense' is unknown" in outcome.errors[0]


def test_a_run_that_goes_blind_keeps_its_frames_and_says_so(tmp_path):
    found = records.read(records.path_of(tmp_path, run_cell(cell(blind_after=100), MADE_WITH, tmp_path)))
    frames = found.scores["frames"]
    assert found.scores["completeness"] == pytest.approx(100.0 / frames)
    assert found.scores["share_lost"] == pytest.approx(1.0 - 100.0 / frames)
    assert (found.series["health"] == "LOST").sum() == np.isnan(found.column("p_WB")[:, 0]).sum() > 0
    never = records.read(records.path_of(tmp_path, run_cell(cell(blind_after=0), MADE_WITH, tmp_path)))
    assert never.failure is None
    assert never.scores["diverged"] == 1.0 and "ate_m" not in never.scores


def test_a_write_that_breaks_off_leaves_nothing(tmp_path, monkeypatch):
    record = Record("abc", "title", {}, {})

    def broken(table, path, **options):
        Path(path).write_bytes(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(records.pq, "write_table", broken)
    with pytest.raises(OSError, match="disk full"):
        records.write(record, tmp_path)
    assert list((tmp_path / "cells").iterdir()) == []
    path = tmp_path / "cells" / "x.parquet"
    path.write_bytes(b"half")
    with pytest.raises(StudyError, match="not a record"):
        records.read(path)


def test_unknown_estimators_are_named():
    with pytest.raises(StudyError, match=r"'nonsense' is unknown; known are .*msckf"):
        load_estimator("nonsense")
    with pytest.raises(StudyError, match="cannot be loaded"):
        load_estimator("tests.eval.fakes:nothing")


def test_a_study_runs_once_and_only_once(tmp_path):
    study = Study("tiny", tuple(cell(seed, arm, draw=len(arm)) for seed in (1, 2) for arm in ("none", "other")))
    seen = []
    first = run_study(study, tmp_path, workers=1, progress=lambda now: seen.append((now.cells, now.all_cells)))
    assert len(first.records) == 4 and not first.missing and not first.failures and not first.errors
    assert seen[0] == (0, 4) and seen[-1] == (4, 4)
    stamps = {p: p.stat().st_mtime_ns for p in (tmp_path / "cells").iterdir()}
    seen.clear()
    again = run_study(study, tmp_path, workers=1, progress=lambda now: seen.append((now.cells, now.all_cells)))
    assert seen == [(4, 4)]
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "cells").iterdir()} == stamps
    assert [r.key for r in again.records] == [r.key for r in first.records]
    assert [r.key for r in load(tmp_path).records] == [r.key for r in first.records]
    with pytest.raises(StudyError, match="0 workers were asked for"):
        run_study(study, tmp_path, workers=0)
    with pytest.raises(StudyError, match="in the study twice"):
        run_study(Study("twice", (cell(), cell())), tmp_path)


def killed_study(folder):
    flag = str(folder / "killed")
    cells = [cell(seed) for seed in (1, 2, 3)] + [cell(4, kill_once=flag)]
    return Study("killed", tuple(cells))


def test_a_study_that_was_killed_goes_on(tmp_path):
    """A cell kills its process hard; the next start runs only what is missing."""
    made_with = {"code": "1"}
    cells = killed_study(tmp_path).cells
    script = (
        "import sys; from pathlib import Path; from eval.work import run_cells;"
        "from tests.eval.test_study import killed_study;"
        "run_cells(killed_study(Path(sys.argv[1])).cells, {'code': '1'}, Path(sys.argv[1]))"
    )
    command = [sys.executable, "-c", script, str(tmp_path)]
    killed = subprocess.run(command, env=dict(os.environ), check=False)
    assert killed.returncode == -9
    done = sorted(p.name for p in (tmp_path / "cells").iterdir())
    assert len(done) == 3 and all(name.endswith(".parquet") and name[0] != "." for name in done)
    stamps = {p: p.stat().st_mtime_ns for p in (tmp_path / "cells").iterdir()}
    subprocess.run(command, env=dict(os.environ), check=True)
    assert all(p.stat().st_mtime_ns == stamp for p, stamp in stamps.items())
    assert records.path_of(tmp_path, cells[3].key(made_with)).is_file()

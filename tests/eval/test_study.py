import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eval import records
from eval.cells import Cell, Study
from eval.errors import StudyError
from eval.outcome import load
from eval.records import Record
from eval.study import run_study
from eval.versions import versions
from eval.work import check_priors, load_estimator, resolved, run_cell, run_cells
from navcore.errors import NavcoreError
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


def test_cells_that_ask_the_same_share_a_result_and_keep_their_names(scheduler, tmp_path):
    cells = (cell(), replace(cell(), regime="other", condition="level 2", level=2.0, axis="x"), cell(2))
    seen = []
    outcome = run_study(Study("shared", cells), tmp_path, scheduler=scheduler, progress=seen.append)
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
    after = versions(("strange_estimator:make",))
    assert {name for name in before if before[name] != after[name]} == {"estimator strange_estimator:make"}


def test_the_code_of_an_estimator_counts_for_its_own_cells_only():
    """A filter's results outlive a change of the smoother; the smoother begins as the filter does."""
    made = versions(("msckf", "factor"))
    filters, smoothers = replace(cell(), estimator="msckf"), replace(cell(), estimator="factor")
    changed = made | {"estimator factor": "another"}
    assert filters.key(made) == filters.key(changed) == filters.key(versions(("msckf",)))
    assert smoothers.key(made) != smoothers.key(changed)


def prior_package(folder, name, **files):
    """A package of one's own with a source of bias priors, as pip would install it."""
    package, info = folder / f"{name}_source", folder / f"{name}_source-2.5.dist-info"
    for place in (package, info):
        place.mkdir(exist_ok=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}-source\nVersion: 2.5\n")
    (info / "entry_points.txt").write_text(f"[navcore.bias_priors]\n{name} = {name}_source:make\n")
    (package / "__init__.py").write_text("")
    for file, content in files.items():
        (package / file.replace("_", ".")).write_text(content)


def test_a_prior_of_another_package_counts_with_its_weights_for_its_own_cells_only(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    prior_package(tmp_path, "guess", weights_onnx="old", card_md="old")
    prior_package(tmp_path, "oracle")
    names = ("guess", "none", "oracle", "truth")
    none, guess, oracle = (replace(cell(), prior=f"{name}:x") for name in ("none", "guess", "oracle"))
    joined = replace(cell(), prior="constant:device.json,guess:x")
    assert joined.priors == ("constant", "guess")

    def made():
        found = versions((FAKE,), names)
        return found, [c.key(found) for c in (none, oracle, guess, joined)]

    before, keys = made()
    assert before["prior guess"].startswith("guess-source 2.5 ")
    assert {name for name in before if name.startswith("prior ")} == {"prior guess", "prior oracle"}
    prior_package(tmp_path, "guess", weights_onnx="old", card_md="new")
    assert made() == (before, keys)
    for change in ({"weights_onnx": "new"}, {"model_py": "x = 1"}):
        prior_package(tmp_path, "guess", **change)
        after, others = made()
        assert after["prior guess"] != before["prior guess"]
        assert [a == b for a, b in zip(keys, others, strict=True)] == [True, True, False, False]
        before, keys = after, others
    assert versions((FAKE,), ("nonsense",))["prior nonsense"] == "unknown"


def test_files_of_a_joined_prior_are_looked_for_in_the_studys_folder(tmp_path):
    (tmp_path / "device.json").write_text("{}")
    (tmp_path / "rows.csv").write_text("")
    whole = f"constant:{tmp_path}/device.json,file:{tmp_path}/rows.csv?window=8"
    assert resolved("constant:device.json,file:rows.csv?window=8", tmp_path) == whole
    assert resolved("constant:other.json,truth:1e-3,0.5", tmp_path) == "constant:other.json,truth:1e-3,0.5"


def test_a_prior_that_cannot_be_had_is_named_before_anything_runs(tmp_path):
    (tmp_path / "rows.csv").write_text("1,0,0,0,0,0,0,1,1,1,1,1,1")
    there = [replace(cell(), prior=prior) for prior in ("none", "truth", "file:rows.csv")]
    check_priors(there, tmp_path)
    for prior, says in (("nonsense", "'nonsense' is unknown"), ("file:gone.csv", r"gone\.csv: no such file")):
        with pytest.raises(NavcoreError, match=says):
            check_priors([*there, replace(cell(), prior=prior)], tmp_path)


def test_what_the_prior_said_is_kept_word_for_word(tmp_path):
    """Five statements; two of them fall together in what is kept, the last is never asked for."""
    t_s = [1.0, 2.0, 2.1, 3.0, 30.0]
    first = FakeFlight(1).load(tmp_path).frames[0].t_ns
    rows = [f"{first + round(t * 1e9)},1,2,3,4,5,{k},1,1,1,2,2,2" for k, t in enumerate(t_s)]
    (tmp_path / "rows.csv").write_text("\n".join(rows))
    spec = "file:rows.csv?window=0&constant_share=0.36"
    asking = replace(cell(), estimator="tests.eval.fakes:make_asking", prior=spec)
    found = records.read(records.path_of(tmp_path, run_cell(asking, MADE_WITH, tmp_path)))
    said = found.statements
    np.testing.assert_allclose(said["t_s"], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(said["t_ns"], first + np.array([1, 2, 3]) * 1_000_000_000)
    np.testing.assert_array_equal(said["b_a_z"], [0, 1, 3])
    np.testing.assert_allclose(said[["b_g_x", "b_a_y"]], [[1, 5]] * 3)
    np.testing.assert_allclose(said[["sigma_db_g_x", "sigma_db_a_z"]], [[1, 2]] * 3)  # the whole error
    silent = records.read(records.path_of(tmp_path, run_cell(cell(), MADE_WITH, tmp_path)))
    assert silent.statements.empty and list(silent.statements.columns) == list(said.columns)


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


def test_a_cell_that_cannot_be_run_is_no_result(scheduler, tmp_path):
    unknown = replace(cell(), estimator="nonsense")
    with pytest.raises(StudyError, match="unknown"):
        run_cell(unknown, MADE_WITH, tmp_path)
    assert not (tmp_path / "cells").exists()
    outcome = run_study(Study("unknown", (cell(), unknown)), tmp_path, scheduler=scheduler)
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
    """In a process of its own, as studies do without a scheduler."""
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
    """A cell kills its process hard; the next one runs only what is missing."""
    made_with = {"code": "1"}
    cells = killed_study(tmp_path).cells
    script = (
        "import sys; from pathlib import Path; from eval.work import run_cells;"
        "from tests.eval.test_study import killed_study;"
        "run_cells(killed_study(Path(sys.argv[1])).cells, {'code': '1'}, Path(sys.argv[1]))"
    )
    killed = subprocess.run([sys.executable, "-c", script, str(tmp_path)], env=dict(os.environ), check=False)
    assert killed.returncode == -9
    done = sorted(p.name for p in (tmp_path / "cells").iterdir())
    assert len(done) == 3 and all(name.endswith(".parquet") and name[0] != "." for name in done)
    stamps = {p: p.stat().st_mtime_ns for p in (tmp_path / "cells").iterdir()}
    run_cells(cells, made_with, tmp_path)
    assert all(p.stat().st_mtime_ns == stamp for p, stamp in stamps.items())
    assert records.path_of(tmp_path, cells[3].key(made_with)).is_file()

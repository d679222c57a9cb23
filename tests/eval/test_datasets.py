import json
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from eval.__main__ import main
from eval.cells import Study
from eval.datasets import DIVERGED, DONE, FAILED, MISSING, Dataset, differences, write_table
from eval.errors import StudyError
from eval.published import Published
from eval.sources import Recording
from eval.study import run_study
from eval.survey import NO_IMAGES, Survey
from msckf.config import FilterConfig, VisionConfig
from navcore.readers import open_sequence
from sim.output import write_recording
from tests.eval.fakes import FakeFlight
from tests.eval.recorded import write_flight

EUROC = Published.of("euroc")


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """A data set as people have it: nested and flat, with archives, a part, one without images, and a broken one."""
    root = tmp_path_factory.mktemp("downloads")
    write_flight(root / "machine_hall", "MH_01_easy", 1)
    (root / "machine_hall" / "MH_02_easy.zip").write_bytes(b"PK")
    write_flight(root, "V1_01_easy", 2)
    write_flight(root, "V2_03_difficult", 3)
    write_flight(root, "V1_02_medium.partial", 4)
    whole = FakeFlight(5, 10.0).load(root)
    write_recording(replace(whole, frames=()), root / "V2_01_easy")
    part = open_sequence(root / "V1_01_easy")
    write_recording(replace(part, frames=part.frames[: len(part.frames) // 2]), root / "V2_02_medium")
    shutil.copytree(root / "V1_01_easy", root / "broken")
    (root / "broken" / "mav0" / "imu0" / "data.csv").write_text("#no samples\n")
    return root


def run(dataset, folder, scheduler, estimator="tests.eval.fakes:make", **overrides):
    """The data set with the fake in the filter's place."""
    plan = dataset.study(folder)
    cells = tuple(replace(c, estimator=estimator, overrides=tuple(overrides.items())) for c in plan.cells)
    return run_study(Study(plan.name, cells, plan.base), folder, scheduler=scheduler)


def test_every_recording_below_a_folder_is_found(root):
    heard = []
    survey = Survey.of(root, heard.append)
    names = ["MH_01_easy", "V1_01_easy", "V2_01_easy", "V2_02_medium", "V2_03_difficult", "broken"]
    assert [x.name for x in survey.recordings] == names == heard
    found = {x.name: x for x in survey.recordings}
    assert found["MH_01_easy"].path == root / "machine_hall" / "MH_01_easy"
    assert [n for n, x in found.items() if x.source is None] == ["V2_01_easy", "broken"]
    assert found["V2_01_easy"].objection == NO_IMAGES and "broken" in found["broken"].objection
    assert [n for n, x in found.items() if not x.whole] == ["V2_02_medium"]
    assert len(survey.notes) == 2
    assert any("MH_02_easy.zip: an archive, passed over; unpack it" in note for note in survey.notes)
    assert any("V1_02_medium.partial: unfinished" in note for note in survey.notes)


def test_a_folder_may_be_the_recording_itself_and_links_are_followed(root, tmp_path):
    (only,) = Survey.of(root / "V1_01_easy" / "mav0").recordings
    assert only.name == only.source.name == "V1_01_easy"
    assert only.source.digest == Recording.of(root / "V1_01_easy", open_sequence(root / "V1_01_easy")).digest
    (tmp_path / "here").symlink_to(root / "V1_01_easy")
    (tmp_path / "round").symlink_to(tmp_path)
    (linked,) = Survey.of(tmp_path).recordings
    assert linked.source is not None


def test_two_of_one_name_keep_their_places(root, tmp_path):
    for place in ("real", "replays"):
        shutil.copytree(root / "V1_01_easy", tmp_path / place / "V1_01_easy")
    assert [x.name for x in Survey.of(tmp_path).recordings] == ["real/V1_01_easy", "replays/V1_01_easy"]


def test_a_bag_beside_its_folder_is_the_same_recording(root, tmp_path):
    """As the data set's own archives hold them."""
    shutil.copytree(root / "V1_01_easy", tmp_path / "V1_01_easy")
    for name in ("V1_01_easy.bag", "V1_02_medium.bag"):
        (tmp_path / "V1_01_easy" / name).write_bytes(b"#ROSBAG V2.0\n")
    (tmp_path / "notes.bag").write_bytes(b"paper")
    survey = Survey.of(tmp_path)
    assert [(x.name, x.source is None) for x in survey.recordings] == [("V1_01_easy", False), ("V1_02_medium", True)]
    assert "cannot be read as a bag" in survey.recordings[1].objection
    (note,) = survey.notes
    assert "V1_01_easy.bag: the same recording as the folder" in note


def test_nothing_to_run_is_an_error_that_says_what_was_seen(tmp_path):
    with pytest.raises(StudyError, match="no such folder"):
        Survey.of(tmp_path / "nowhere")
    (tmp_path / "MH_01_easy.zip").write_bytes(b"PK")
    with pytest.raises(StudyError, match=r"no recording below it(.|\n)*MH_01_easy.zip: an archive"):
        Survey.of(tmp_path)


def test_the_sequence_is_read_out_of_a_name():
    rooms = Published.of("tumvi")
    assert EUROC.sequence_in("MH_01_easy") == EUROC.sequence_in("replays/MH_01") == "MH_01"
    assert EUROC.sequence_in("V2_03_difficult") == "V2_03"
    assert rooms.sequence_in("dataset-room1_512_16") == rooms.sequence_in("room1") == "room1"
    assert [p.sequence_in(n) for p, n in ((EUROC, "XMH_01"), (EUROC, "MH_011"), (rooms, "room10"))] == [None] * 3


@pytest.mark.parametrize(
    ("dataset", "means"),
    [
        ("euroc", {"OpenVINS mono": 0.150, "OpenVINS stereo": 0.094, "VINS-Fusion mono": 0.202, "DM-VIO mono": 0.069}),
        ("tumvi", {}),
    ],
)
def test_published_figures_are_whole(dataset, means):
    """Means as they were published beside the sequences; every figure has a source and belongs to a sequence."""
    published = Published.of(dataset)
    by_name = {s.name: s for s in published.systems}
    assert len(by_name) == len(published.systems) and all(s.source for s in published.systems)
    assert all(set(s.ate_m) <= set(published.sequences) for s in published.systems)
    for name, mean in means.items():
        assert set(by_name[name].ate_m) == set(published.sequences)
        assert np.mean(list(by_name[name].ate_m.values())) == pytest.approx(mean, abs=6e-4)


def test_every_recording_is_run_once_and_its_state_told(root, tmp_path, scheduler):
    dataset, diary = Dataset(EUROC, Survey.of(root)), tmp_path / "diary"
    outcome = run(dataset, tmp_path / "out", scheduler, diary=str(diary))
    results = dataset.results(outcome).set_index("recording")
    states = dict.fromkeys(("MH_01_easy", "V1_01_easy", "V2_02_medium", "V2_03_difficult"), DONE)
    assert results.state.to_dict() == {**states, "V2_01_easy": NO_IMAGES, "broken": FAILED}
    assert results.sequence["V1_01_easy"] == "V1_01" and results["published Basalt stereo"]["V1_01_easy"] == 0.04
    first = results.loc["MH_01_easy"]
    assert first.drift_percent == pytest.approx(100.0 * first.ate_m / first.path_m)
    assert first.estimator_ms_per_frame == pytest.approx(1.0) and 0.0 < first.ate_m < 0.5
    assert len(diary.read_text().splitlines()) == 4
    run(dataset, tmp_path / "out", scheduler, diary=str(diary))
    assert len(diary.read_text().splitlines()) == 4  # what is finished is kept
    written = pd.read_csv(write_table(dataset.results(outcome), tmp_path))
    assert list(written.recording) == list(results.index) and written.ate_m[0] == pytest.approx(first.ate_m)


def test_another_prior_or_setting_or_input_is_another_run(root, tmp_path):
    survey = Survey.of(root)
    plain = Dataset(EUROC, survey).study(tmp_path)
    keys = {c.key({}) for c in plain.cells}
    told = Dataset(EUROC, survey, "truth").study(tmp_path)
    set_ = Dataset(EUROC, survey, config=replace(FilterConfig(), cameras=2, vision=VisionConfig(fej=False)))
    assert {c.overrides for c in set_.study(tmp_path).cells} == {(("vision.fej", False), ("cameras", 2))}
    for other in (told, set_.study(tmp_path)):
        assert len(other.cells) == len(plain.cells) and not keys & {c.key({}) for c in other.cells}
    device = tmp_path / "device.json"
    device.write_text(json.dumps({"b_g": [0, 0, 0], "b_a": [0, 0, 0], "covariance": [1e-4] * 6}))
    (prior,) = {c.prior for c in Dataset(EUROC, survey, f"constant:{device}").study(tmp_path / "out").cells}
    assert (tmp_path / "out" / prior.removeprefix("constant:")).is_file()


def test_settings_that_differ_are_named():
    assert differences({"a": {"b": 1, "c": 2}, "d": 3}, {"a": {"b": 1, "c": 4}, "d": 5}) == {"a.c": 4, "d": 5}


def test_what_fails_diverges_or_was_not_run_is_said(root, tmp_path, scheduler):
    dataset = Dataset(EUROC, Survey.of(root / "machine_hall"))
    (failed,) = dataset.results(run(dataset, tmp_path / "a", scheduler, fail="no such luck")).itertuples()
    assert failed.state == FAILED and failed.message == "RuntimeError: no such luck"
    (blind,) = dataset.results(run(dataset, tmp_path / "b", scheduler, blind_after=0)).itertuples()
    assert blind.state == DIVERGED and np.isinf(blind.ate_m)
    outcome = run(dataset, tmp_path / "c", scheduler)
    (missing,) = dataset.results(replace(outcome, records=(), errors=("a worker died",))).itertuples()
    assert missing.state == MISSING and missing.message == "a worker died"


def test_means_are_over_the_whole_sequences_that_both_have(root, tmp_path, scheduler):
    dataset = Dataset(EUROC, Survey.of(root))
    results = dataset.results(run(dataset, tmp_path, scheduler))
    ours = results.set_index("recording").ate_m
    _, table, amiss = dataset.tables(results)
    rows = {row[0]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    assert "V2_02_medium (a part)" in rows and "V2_01_easy" not in rows and "OKVIS2 stereo" not in table.columns
    assert rows["mean of the same, theirs"]["OpenVINS mono"] == f"{(0.111 + 0.059 + 0.145) / 3:.3f}"
    mine = [ours[n] for n in ("MH_01_easy", "V1_01_easy", "V2_03_difficult")]
    assert rows["… here"]["OpenVINS mono"] == rows["… here"]["here"] == f"{np.mean(mine):.3f}"
    assert rows["mean of the same, theirs"]["Basalt stereo"] == f"{(0.08 + 0.04) / 2:.3f}"  # it has no V2_03
    assert rows["… here"]["Basalt stereo"] == f"{np.mean(mine[:2]):.3f}"
    assert (
        rows["V1_01_easy"]["Yi et al. baseline"] == "–"
        and rows["V2_02_medium (a part)"]["Yi et al. baseline"] == "diverged"
    )
    assert [row[0] for row in amiss.rows] == ["broken"]


def test_a_mean_alone_is_shown_beside_all_sequences(root, tmp_path, scheduler):
    (tmp_path / "all").mkdir()
    for name in EUROC.sequences:
        shutil.copytree(root / "V1_01_easy", tmp_path / "all" / name)
    dataset = Dataset(EUROC, Survey.of(tmp_path / "all"))
    _, table = dataset.tables(dataset.results(run(dataset, tmp_path / "out", scheduler)))
    shown = dict(zip(table.columns, table.rows[-2], strict=True))
    assert shown["SchurVINS stereo"] == "0.075" and shown["OpenVINS mono"] == "0.150"


def test_the_command_runs_the_filter_and_shows_both_tables(root, tmp_path, scheduler, monkeypatch, capsys):
    out, run_it = tmp_path / "out", ["euroc", str(root / "machine_hall"), "--scheduler", scheduler, "--out"]
    monkeypatch.setattr("sys.argv", ["python -m eval", *run_it, str(out), "--config.vision.no-fej"])
    assert main() == 0
    told = capsys.readouterr().out
    assert "unpack it" in told and "EuRoC: msckf, 1 camera, prior none" in told and "OpenVINS mono" in told
    (row,) = pd.read_csv(out / "table.csv").itertuples()
    assert row.state == DIVERGED and row.frames > 0  # the filter finds nothing in noise
    monkeypatch.setattr("sys.argv", ["python -m eval", *run_it, str(out), "--prior", "nobody"])
    with pytest.raises(SystemExit, match="1"):
        main()
    assert "bias prior 'nobody' is unknown" in capsys.readouterr().err

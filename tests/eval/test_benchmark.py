import json
from dataclasses import replace

import numpy as np
import pytest

from eval import images
from eval.__main__ import main
from eval.benchmark import Benchmark
from eval.cells import Study
from eval.errors import StudyError
from eval.kept import kept
from eval.report import write_report
from eval.sources import Degraded, Recording, degradations
from eval.study import run_study
from eval.unseen import unseen_sources
from eval.work import resolved
from ipnet.recordings import PUBLIC_LABELS, read_labels
from ipnet.seen import seen_by
from ipnet.splits import SPLITS, unseen_split
from navcore.prior import load_prior
from navcore.readers import open_sequence
from sim.degrade import degrade_sequence
from sim.degrade.spec import Spec
from sim.errors import ConfigError
from sim.output import write_recording
from tests.eval.fakes import FakeFlight
from tests.eval.recorded import write_flight

SPEC = Spec(
    "mine",
    7,
    3.0,
    {
        "clean": "",
        "low_light-2": "low_light:2@35%-65%",
        "low_light-5": "low_light:5@35%-65%",
        "low_light-4-late": "low_light:4@70%-95%",
        "outage-2": "blackout@15%+2",
        "outage-20": "blackout@15%+20",
        "night": "low_light:3@30%-70%, jpeg:3@30%-70%",
    },
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two recordings, the second one without biases in its truth."""
    folder = tmp_path_factory.mktemp("recordings")
    write_flight(folder, "one", 1)
    write_flight(folder, "two", 2, biases=False)
    return folder


def test_a_cell_stands_where_its_kind_and_time_say(folder, tmp_path):
    study, left_out = Benchmark(SPEC, (folder / "one",)).study(tmp_path)
    found = {(c.regime, c.condition): (c.level, c.axis) for c in study.cells}
    assert found == {
        ("clean", "clean"): (None, ""),
        ("low light, 35%-65%", "clean"): (0.0, "severity"),
        ("low light, 35%-65%", "low_light-2"): (2.0, "severity"),
        ("low light, 35%-65%", "low_light-5"): (5.0, "severity"),
        ("low light, 70%-95%", "clean"): (0.0, "severity"),
        ("low light, 70%-95%", "low_light-4-late"): (4.0, "severity"),
        ("blackout from 15%", "clean"): (0.0, "length of the outage [s]"),
        ("blackout from 15%", "outage-2"): (2.0, "length of the outage [s]"),
        ("several at once", "clean"): (None, ""),
        ("several at once", "night"): (None, ""),
    }
    assert len(left_out) == 1 and left_out[0].startswith("one, outage-20 is left out: mine, outage-20: blackout")
    assert len(study.cells) == 2 * len(found) and study.name == "Benchmark mine"


def test_all_arms_see_the_recording_and_truth_only_where_it_knows_biases(folder, tmp_path):
    device = tmp_path / "device.json"
    device.write_text(json.dumps({"b_g": [0, 0, 0], "b_a": [0, 0, 0], "covariance": [1e-4] * 6}))
    prior = f"constant:{device}"
    chosen = Benchmark(SPEC, (folder / "one", folder / "two"), ("low_light-5",), (prior,))
    study, _ = chosen.study(tmp_path / "study")
    arms = {(c.source.name, c.arm) for c in study.cells}
    assert arms == {("one", "none"), ("one", "truth"), ("one", prior), ("two", "none"), ("two", prior)}
    assert {(c.source.name, c.seed) for c in study.cells} == {("one", 1), ("two", 2)}
    (kept,) = {c.prior for c in study.cells if c.arm == prior}
    assert (tmp_path / "study" / kept.removeprefix("constant:")).read_bytes() == device.read_bytes()
    device.write_text(device.read_text().replace("0.0001", "0.0002"))
    changed, _ = chosen.study(tmp_path / "study")
    assert kept not in {c.prior for c in changed.cells}


def test_files_and_folders_of_priors_are_kept_by_their_content(tmp_path, monkeypatch):
    """A device, weights in a folder, options: what is read is what was there when the study was planned."""
    monkeypatch.chdir(tmp_path)
    study, weights = tmp_path / "study", tmp_path / "weights"
    weights.mkdir()
    (tmp_path / "device.json").write_text("{}")
    (weights / "card.json").write_text("one")
    spec = "constant:./device.json,file:./weights?window=8"
    first = kept(spec, study)
    device, folder = (part.partition(":")[2].partition("?")[0] for part in first.split(","))
    assert first == f"constant:{device},file:{folder}?window=8"
    assert (study / device).read_text() == "{}" and (study / folder / "card.json").read_text() == "one"
    assert resolved(first, study) == f"constant:{study / device},file:{study / folder}?window=8"
    (weights / "card.json").write_text("two")
    second = kept(spec, study)
    assert second.split(",")[0] == first.split(",")[0] and second.split(",")[1] != first.split(",")[1]
    for name in ("none", "truth:1e-3,0.5", "file:weights", "constant:gone.json"):  # a folder's path has a slash
        assert kept(name, study) == name


def test_images_are_those_of_the_same_benchmark_on_disk(folder, tmp_path):
    study, _ = Benchmark(SPEC, (folder / "one",), ("low_light-5",)).study(tmp_path)
    source = next(c.source for c in study.cells if c.condition == "low_light-5")
    assert isinstance(source, Degraded) and isinstance(source.clean, Recording) and source.seed == SPEC.seed
    (span,) = degradations(source)
    assert (span.kind, span.severity) == ("low_light", 5)
    sequence = open_sequence(folder / "one")
    schedule = SPEC.schedule("low_light-5", (sequence.frames[-1].t_ns - sequence.frames[0].t_ns) * 1e-9)
    expected = degrade_sequence(sequence, schedule, SPEC.seed)
    for a, b in zip(source.load(tmp_path).frames, expected.frames, strict=True):
        np.testing.assert_array_equal(a.images[0].load(), b.images[0].load())


def test_the_study_runs_and_its_report_shows_the_recordings(folder, scheduler, tmp_path):
    plan, _ = Benchmark(SPEC, (folder / "one", folder / "two"), ("low_light-*",)).study(tmp_path)
    fakes = tuple(replace(c, estimator="tests.eval.fakes:make") for c in plan.cells)
    outcome = run_study(Study(plan.name, fakes), tmp_path, scheduler=scheduler)
    assert not outcome.failures and not outcome.missing and not outcome.errors
    conditions = 1 + 3  # the clean recording is run once for both regimes
    assert len(list((tmp_path / "cells").iterdir())) == 2 * conditions + conditions
    assert [r.config["recording"] for r in outcome.records[:2]] == ["one", "one"]
    page = write_report(outcome, tmp_path).read_text(encoding="utf-8")
    assert "low light, 35%-65%" in page and "Benchmark mine" in page
    shown = images.samples(outcome.records, tmp_path)
    assert shown[0].condition == "recordings, low light, 35%-65%, clean"
    assert len({s.source for s in shown}) == len(shown) == 4
    assert shown[0].t_s == shown[1].t_s == pytest.approx(0.5 * 9.25, abs=0.13)  # clean and dark, the same moment


def test_what_cannot_be_run_is_named(folder, tmp_path):
    with pytest.raises(ConfigError, match="cell 'fog-9' is not in mine"):
        Benchmark(SPEC, (folder / "one",), ("fog-9",)).study(tmp_path)
    with pytest.raises(ConfigError, match=r"outage-20: .* needs"):
        Benchmark(SPEC, (folder / "one",), ("outage-20",)).study(tmp_path)
    with pytest.raises(StudyError, match=r"nothing to run on 1 recordings: one, outage-20 is left out"):
        Benchmark(SPEC, (folder / "one",), ("outage-20*",)).study(tmp_path)
    with pytest.raises(StudyError, match="another recording is called one too"):
        Benchmark(SPEC, (folder / "one", folder / "one" / "mav0")).study(tmp_path)
    blind = FakeFlight(1, 4.0).load(tmp_path)
    write_recording(replace(blind, frames=()), tmp_path / "blind")
    with pytest.raises(StudyError, match="no images to degrade"):
        Benchmark(SPEC, (tmp_path / "blind",)).study(tmp_path)


def test_the_command_says_what_is_wrong(folder, tmp_path, monkeypatch, capsys):
    wrong = ["benchmark", str(folder / "one"), "--cell", "fog-9", "--out", str(tmp_path)]
    monkeypatch.setattr("sys.argv", ["python -m eval", *wrong])
    with pytest.raises(SystemExit, match="1"):
        main()
    assert "error: cell 'fog-9' is not in v1" in capsys.readouterr().err


def test_an_ablation_tells_each_recording_what_was_made_without_it(tmp_path):
    for seed, name in enumerate(("MH_01_easy", "V1_03_difficult", "dataset-room3_512_16", "mine")):
        write_flight(tmp_path, name, seed, biases=name != "V1_03_difficult")
    paths = tuple(tmp_path / name for name in ("MH_01_easy", "V1_03_difficult", "dataset-room3_512_16", "mine"))
    study, left_out = Benchmark(SPEC, paths, ("low_light-2",), ablation=True).study(tmp_path / "study")
    names = ("dataset-room3_512_16", "mine")
    assert [line.partition(" is left out")[0] for line in left_out] == list(names)
    told = {}
    for c in study.cells:
        told.setdefault((c.source.name, c.estimator), {})[c.arm] = c
        assert (
            c.prior == "none" or c.arm == "truth" or c.source.name not in seen_by(resolved(c.prior, tmp_path / "study"))
        )
        assert c.kind == ("clean" if c.condition == "clean" else "other")
    assert set(told) == {(name, e) for name in ("MH_01_easy", "V1_03_difficult") for e in ("msckf", "factor")}
    everything = {"none", "constant", "window-mean", "paper-plain", "ipnet", "motion", "ipnet+motion", "recursive"}
    assert set(told["MH_01_easy", "msckf"]) == everything | {"truth"}
    assert set(told["V1_03_difficult", "factor"]) == everything | {"paper-plain, figure 2"}
    assert told["MH_01_easy", "msckf"]["ipnet"].prior == "ipnet:euroc-rest"
    assert told["V1_03_difficult", "factor"]["recursive"].prior == "recursive:euroc-table2"
    memory = told["V1_03_difficult", "msckf"]["constant"].prior
    device = load_prior(resolved(memory, tmp_path / "study")).device()
    trained = [read_labels(PUBLIC_LABELS)[n].bias for n in ("MH_01_easy", "MH_03_medium", "V2_03_difficult")]
    np.testing.assert_allclose(device.vector, np.mean(trained, axis=0), rtol=1e-6)
    with_more, _ = Benchmark(SPEC, paths[:1], ("low_light-2",), ("motion:euroc-table2",), ablation=True).study(tmp_path)
    assert "motion:euroc-table2" in {c.arm for c in with_more.cells}


@pytest.mark.parametrize("split", SPLITS)
def test_every_split_has_every_source(split, tmp_path):
    """Otherwise an arm would rest on fewer recordings than the others."""
    recording = SPLITS[split].test[0]
    assert unseen_split(recording)[0] == split
    sources, missing = unseen_sources(recording, tmp_path, truth=True)
    assert missing == () and None not in vars(sources).values()

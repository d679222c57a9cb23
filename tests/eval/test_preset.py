import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eval.arms import BASE, WEIGHTS, Arm, Sources, told, told_all, told_joined, weighed, write_device
from eval.errors import StudyError
from eval.figures.look import mark
from eval.flights import Flight, PointsFlight
from eval.preset import ABLATION, DEVICE_SEEDS, FULL, PRESETS, QUICK, STANDARD, Block, Preset
from eval.progress import Ledger
from eval.regimes import Setting, outage
from eval.sources import degradations, to_render
from navcore.prior import load_prior
from sim.commands.fleet import Fleet
from sim.degrade import Schedule
from sim.degrade.schedule import KINDS, SCENE
from sim.imu import GRADES
from sim.platforms import DIFFICULTIES, PLATFORMS

ARMS = {"none", "constant", "ipnet", "motion", "truth"}
JOINED = {"ipnet+motion", "constant, ipnet+motion"}
RIVALS = {"window-mean", "paper-plain", "recursive"}
FACTOR_ONLY = "paper-plain, figure 2"
SWEPT = {"none", "ipnet", *(f"W = {w:g}" for w in WEIGHTS)}
NAMES = {told: ARMS, told_joined: ARMS | JOINED, told_all: ARMS | RIVALS | {"ipnet+motion"}, weighed: SWEPT}


@pytest.fixture(scope="module", params=PRESETS)
def planned(request, tmp_path_factory):
    """A preset, its folder and its study; two seeds each stand for all."""
    preset = PRESETS[request.param]
    few = replace(preset, seeds=2, rendered_seeds=2)
    folder = tmp_path_factory.mktemp(request.param)
    return few, folder, few.study(folder)


def arms_of(preset, regime):
    """What the filter is told in a regime; no two blocks of a preset with other arms share a regime's name."""
    (which,) = {b.told or preset.told for b in preset.blocks if b.regime.name == regime}
    return NAMES[which]


def regimes(preset):
    return {(b.regime.name, b.images): b for b in preset.blocks}


def test_every_seed_condition_and_arm_is_there_once(planned):
    preset, _, study = planned
    names = [(c.platform, c.regime, c.condition, c.seed, c.estimator, c.arm) for c in study.cells]
    assert len(set(names)) == len(names)
    for estimator in preset.estimators:
        expected = 0
        for b in preset.blocks:
            more = FACTOR_ONLY in {c.arm for c in study.cells if (c.regime, c.estimator) == (b.regime.name, estimator)}
            assert more == (estimator == "factor" and b.told is None)
            arms = len(arms_of(preset, b.regime.name)) + b.chance + more
            expected += 2 * len(b.platforms) * len(b.regime.conditions) * arms
        assert sum(c.estimator == estimator for c in study.cells) == expected
    assert study.base == BASE


def test_each_claim_stands_beside_none_constant_and_truth(planned):
    preset, _, study = planned
    arms = {}
    for c in study.cells:
        arms.setdefault((c.platform, c.regime, c.condition, c.seed, c.estimator), {})[c.arm] = c
    for (_, regime, *_), found in arms.items():
        assert set(found) - {"none, reseeded", FACTOR_ONLY} == arms_of(preset, regime)
        assert {cell.source for arm, cell in found.items() if arm != "none, reseeded"} == {found["none"].source}
        if "none, reseeded" in found:
            again = found["none, reseeded"].source
            assert again != found["none"].source and again.flight == found["none"].source.flight
    for platform in {c.platform for c in study.cells if "points" in c.platform and "quadrotor" in c.platform}:
        assert any("none, reseeded" in a for key, a in arms.items() if key[0] == platform)


def test_arms_of_measurements_know_the_motion_of_their_platform_and_no_device(planned):
    _, _, study = planned
    for c in study.cells:
        body = c.platform.split(",")[0]
        expected = {"ipnet": f"ipnet:sim-{body}", "motion": f"motion:sim-{body}", "none": "none", "truth": "truth"}
        if c.arm in expected:
            assert c.prior == expected[c.arm]
        if c.arm in JOINED:
            assert c.prior.endswith(f"ipnet+motion:sim-{body}")
    devices = {c.prior.split(",")[0] for c in study.cells if "constant" in c.arm}
    assert devices == {c.prior for c in study.cells if c.arm == "constant"}
    for c in study.cells:
        settings = dict(c.overrides)
        assert (settings.get("prior.mode") == "plain") == (c.arm.startswith(("paper-plain", "W = "))) == bool(settings)
        if c.arm.startswith("W = "):
            assert settings["prior.weight"] == float(c.arm.removeprefix("W = "))


def test_no_study_flies_what_is_kept_for_learning(planned):
    """Seeds of fleets are for training and tests of the sources of measurements; a study must not know them."""
    _, _, study = planned
    learned = Fleet(Path("x")).first_seed
    assert learned == 100001
    assert max(c.seed for c in study.cells) < learned
    with pytest.raises(StudyError, match="allowed is up to 1000"):
        replace(QUICK, seeds=learned).study(Path("x"))
    assert max(DEVICE_SEEDS) == 1040 < learned


def test_every_degradation_lies_in_its_flight_and_leaves_time_to_recover(planned):
    _, _, study = planned
    for c in study.cells:
        flight = c.source.flight if isinstance(c.source, PointsFlight) else to_render(c.source).flight
        spans = degradations(c.source)
        assert all(d.end_s + 5.0 <= flight.seconds for d in spans), c.title
        assert c.level is None or bool(spans) == (c.level != 0.0) or "features" in c.axis


def test_a_flight_is_rendered_once_for_all_that_is_done_to_its_images(planned):
    preset, folder, study = planned
    ledger = Ledger(study.cells, [c.key({}) for c in study.cells], folder, None)
    settings = {
        (platform, seed, c.setting.flight(platform, seed), str(Schedule.parse(c.setting.degrade).in_camera))
        for b in preset.blocks if b.images for platform in b.platforms for seed in (1, 2)
        for c in b.regime.conditions
    }  # fmt: skip
    assert len(ledger.films) == len(settings)
    assert all(kind == "motion_blur" for film in ledger.films for kind in {d.kind for d in degradations(film)})


def test_the_presets_ask_where_a_prior_can_matter():
    """Starts in motion, vision that is wrong, still and straight, cheap IMUs, outages early and late."""
    for preset in (STANDARD, FULL):
        blocks = [b for b in preset.blocks if not b.images]
        conditions = [c for b in blocks for c in b.regime.conditions]
        assert {c.setting.features for c in conditions if c.setting.moving_start} >= {100, 12}
        assert any("moving_objects" in c.setting.degrade for c in conditions)
        assert any(c.setting.difficulty == "easy" and "blackout" in c.setting.degrade for c in conditions)
        assert {c.setting.imu for c in conditions} == set(GRADES)
        assert {c.setting.difficulty for c in conditions} == set(DIFFICULTIES)
        for name in ("outage, early", "outage, late"):
            block = regimes(preset)[name, False]
            assert [c.level for c in block.regime.conditions] == [0.0, 5.0, 10.0, 20.0, 30.0]
            assert block.platforms == tuple(PLATFORMS) and block.chance
    full = " ".join(c.setting.degrade for b in FULL.blocks for c in b.regime.conditions)
    assert all(kind in full for kind in KINDS) and all(f"{kind}:5" in full for kind in SCENE)


def test_the_ablation_counts_as_degraded_what_its_design_says():
    """Wrong vision, outages of 10 s and more, starts in motion, cheap IMUs; clean is none of these."""
    kinds = {(b.regime.name, c.name): c.kind for b in ABLATION.blocks for c in b.regime.conditions}
    clean = {names for names, kind in kinds.items() if kind == "clean"}
    assert clean == {("outage", "clean"), ("wrong vision", "clean")}
    assert set(kinds.values()) == {"clean", "degraded"}
    mild = {c.name: c.kind for b in STANDARD.blocks if b.regime.name == "outage, early" for c in b.regime.conditions}
    assert mild == {"clean": "clean", "5 s": "other", "10 s": "degraded", "20 s": "degraded", "30 s": "degraded"}
    assert ABLATION.seeds >= 6 and ABLATION.estimators == ("msckf", "factor")


def test_all_arms_of_the_ablation_look_different(tmp_path):
    study = replace(ABLATION, seeds=1).study(tmp_path)
    arms = list(dict.fromkeys(c.arm for c in study.cells))
    assert len({tuple(mark(arm, arms).values()) for arm in arms}) == len(arms) > 13


def test_what_there_is_no_source_of_is_no_arm():
    bare = Sources(None, None, None, None, None, None, truth=False)
    assert [a.name for tell in NAMES for a in tell(bare)] == ["none"] * len(NAMES)
    some = replace(bare, motion="motion:euroc", truth=True)
    assert [(a.name, a.prior) for a in told_all(some)] == [
        ("none", "none"),
        ("motion", "motion:euroc"),
        ("truth", "truth"),
    ]
    whole = Sources("constant:a", "window-mean", "ipnet:b", "motion:b", "ipnet+motion:b", "recursive:b")
    assert {"ipnet", "motion", "ipnet+motion"} < {a.name for a in told_all(whole)}
    assert {a.name: a.prior for a in told_joined(whole)}["constant, ipnet+motion"] == "constant:a,ipnet+motion:b"


def test_quick_is_small_and_has_enough_seeds_for_an_interval():
    assert QUICK.seeds == 6 and QUICK.rendered_seeds == 1
    cells = [b for b in QUICK.blocks if b.images]
    assert len(cells) == 1 and len(cells[0].regime.conditions) == 3
    assert len({str(Schedule.parse(c.setting.degrade).in_camera) for c in cells[0].regime.conditions}) == 1


def test_the_constant_arm_knows_only_other_recordings(tmp_path):
    study = Preset("one", (Block(outage("outage", 1.0, (1.0,), Setting(8.0))),), 1, 0).study(tmp_path)
    spec = next(c.prior for c in study.cells if c.arm == "constant")
    (file,) = tmp_path.glob("device-*.json")
    assert spec == f"constant:{file.name}"
    device = load_prior(f"constant:{file}").device()
    assert device is not None
    imu = GRADES["adis16448"]
    expected = np.repeat([imu.gyroscope.turn_on, imu.accelerometer.turn_on], 3)
    np.testing.assert_allclose(np.sqrt(np.diag(device.covariance)), expected, rtol=0.4)
    assert np.all(np.abs(device.vector) < 4.0 * expected / np.sqrt(40))
    flights = [PointsFlight(Flight("quadrotor", 1.0, seed)).load(tmp_path).truth for seed in range(1001, 1041)]
    np.testing.assert_allclose(device.b_g, np.mean([t.b_g[0] for t in flights], axis=0))
    assert write_device(tmp_path, "adis16448", range(1001, 1041)) == file.name
    assert write_device(tmp_path, "adis16448", range(1002, 1042)) != file.name
    assert write_device(tmp_path, "cheap", range(1001, 1041)) != file.name
    assert set(json.loads(file.read_text())) == {"b_g", "b_a", "covariance"}


@pytest.mark.parametrize(("seeds", "rendered"), [(0, 1), (1001, 1), (1, -1), (1, 1001)])
def test_sizes_that_cannot_be_are_named(tmp_path, seeds, rendered):
    with pytest.raises(StudyError, match=f"seeds {seeds}, rendered seeds {rendered}; allowed is up to 1000"):
        Preset("bad", QUICK.blocks, seeds, rendered).study(tmp_path)
    with pytest.raises(StudyError, match="12 or more"):
        write_device(tmp_path, "adis16448", range(3))


def test_an_arm_is_reseeded_only_if_it_says_so():
    flight = PointsFlight(Flight("quadrotor", 1.0, 1))
    assert Arm("none", "none").reseeded(flight) is flight
    assert Arm("other", "none", noise_seed=3).reseeded(flight).noise_seed == 3


def test_a_file_cannot_be_the_folder_of_a_study(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StudyError, match="cannot be the folder of a study"):
        write_device(tmp_path / "file", "adis16448", range(1001, 1013))

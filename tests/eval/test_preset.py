import json

import numpy as np
import pytest

from eval.arms import write_device
from eval.errors import StudyError
from eval.preset import POINTS, RENDERED, SimPreset
from eval.sources import PointsFlight, Recording, RenderedFlight
from navcore.prior import load_prior
from sim.imu import GRADES


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("preset")
    return folder, SimPreset(seeds=3).study(folder)


def test_every_seed_condition_and_arm_is_there_once(planned):
    _, study = planned
    names = [(c.scene, c.condition, c.seed, c.arm) for c in study.cells]
    assert len(set(names)) == len(names) == 3 * len(RENDERED) + 4 * 3 * len(POINTS)
    assert {c.arm for c in study.cells} == {"none", "constant", "truth", "none, reseeded"}
    assert study.base == "none"


def test_arms_of_a_seed_see_the_same_recording_but_for_the_reseeded_one(planned):
    _, study = planned
    for condition in POINTS:
        found = {
            c.arm: c.source for c in study.cells if (c.seed, c.condition, c.scene) == (2, condition.name, "points")
        }
        assert found["none"] == found["truth"] == found["constant"]
        assert found["none, reseeded"] != found["none"]
        assert found["none, reseeded"].seed == found["none"].seed


def test_the_constant_arm_knows_only_other_recordings(planned):
    folder, study = planned
    spec = next(c.prior for c in study.cells if c.arm == "constant")
    (file,) = folder.glob("device-*.json")
    assert spec == f"constant:{file.name}"
    device = load_prior(f"constant:{file}").device()
    assert device is not None
    imu = GRADES["adis16448"]
    expected = np.repeat([imu.gyroscope.turn_on, imu.accelerometer.turn_on], 3)
    np.testing.assert_allclose(np.sqrt(np.diag(device.covariance)), expected, rtol=0.4)
    assert np.all(np.abs(device.vector) < 4.0 * expected / np.sqrt(40))
    truths = [PointsFlight("quadrotor", 1.0, seed).load(folder).truth for seed in range(1001, 1041)]
    np.testing.assert_allclose(device.b_g, np.mean([t.b_g[0] for t in truths], axis=0))
    assert write_device(folder, "quadrotor", range(1001, 1041)) == file.name
    assert write_device(folder, "quadrotor", range(1002, 1042)) != file.name
    assert set(json.loads(file.read_text())) == {"b_g", "b_a", "covariance"}


def test_sizes_that_cannot_be_are_named(tmp_path):
    with pytest.raises(StudyError, match="seeds 0"):
        SimPreset(seeds=0).study(tmp_path)
    with pytest.raises(StudyError, match="seeds 2000"):
        SimPreset(seeds=2000).study(tmp_path)
    with pytest.raises(StudyError, match=r"^seconds is 30.0; .* at least 50"):
        SimPreset(seconds=30.0).study(tmp_path)
    with pytest.raises(StudyError, match=r"^rendered_seconds is 30.0; .* at least 35"):
        SimPreset(rendered_seconds=30.0).study(tmp_path)
    with pytest.raises(StudyError, match="12 or more"):
        write_device(tmp_path, "quadrotor", range(3))


def test_a_points_flight_is_degraded_on_the_same_motion(tmp_path):
    clean = PointsFlight("quadrotor", 4.0, 1).load(tmp_path)
    dark = PointsFlight("quadrotor", 4.0, 1, "blackout@1-2").load(tmp_path)
    other = PointsFlight("quadrotor", 4.0, 1, noise_seed=1).load(tmp_path)
    np.testing.assert_array_equal(clean.truth.p_WB, dark.truth.p_WB)
    np.testing.assert_array_equal(clean.imu.gyro, dark.imu.gyro)
    np.testing.assert_array_equal(clean.truth.p_WB, other.truth.p_WB)
    assert not np.array_equal(clean.imu.gyro, other.imu.gyro)
    seen = [len(f.tracks[0]) for f in dark.frames]
    assert max(seen[21:39]) == 0 < min(seen[:19])


def test_a_rendered_flight_is_made_once_and_read_back(tmp_path, monkeypatch):
    from eval import sources

    made = []

    def record(platform, seconds, seed, out, *, degrade):
        made.append(degrade)
        monkeypatch.undo()
        sources.record(platform, seconds, seed, out, degrade=degrade, mode="points")  # images take long

    monkeypatch.setattr(sources, "record", record)
    flight = RenderedFlight.of("quadrotor", 3.0, 1, "blackout@1-2")
    with pytest.raises(StudyError, match="was not made"):
        flight.load(tmp_path)
    flight.make(tmp_path)
    flight.make(tmp_path)
    assert made == ["blackout@1-2"]
    sequence = flight.load(tmp_path)
    assert sequence.truth is not None and len(sequence.frames) > 50
    assert len(Recording(str(flight.folder(tmp_path))).load(tmp_path).imu) == len(sequence.imu)
    assert RenderedFlight.of("quadrotor", 3.0, 2).folder(tmp_path) != flight.folder(tmp_path)

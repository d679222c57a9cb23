import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from navcore import so3
from navcore.errors import DataError
from navcore.odometry import Estimate, Health, RunRecorder, State
from navcore.prior import load_prior
from navcore.results import check_free, folder, read_run, summarise, write_run
from tests.navcore.recordings import sequence

OFFSET_NS = 5_000_000  # the camera's, in the recording


@dataclass(frozen=True)
class Config:
    """What any estimator's configuration looks like."""

    sigma: float = 1.5
    mode: Health = Health.LOST


def estimate(k, state=True, health=Health.TRACKING, reasons=(), stages=None):
    t_ns = sequence().frames[k].t_ns + OFFSET_NS
    given = None
    if state:
        b_g, b_a = np.full(3, 1e-3 * k), np.array([0.1, 0.2, 0.3]) * k
        R_WB, p_WB = so3.exp(np.array([0.1, 0.2, 0.03 * k])), np.array([k, 0.5, 1e-7])
        given = State(R_WB, p_WB, np.ones(3), b_g, b_a, np.diag(np.arange(1.0, 16.0) ** 2))
    return Estimate(t_ns, health, tuple(reasons), given, 50 + k, k, stages or {})


def made():
    """Ten frames: two before the start, one lost, one with a bad image; the last two never answered."""
    recorder = RunRecorder()
    stages = {"decode": 0.010, "track": 0.002, "update": 0.001}
    starting = [estimate(k, False, Health.INITIALISING, ["no motion yet"], stages) for k in (0, 1)]
    skipped = "skipped: cam0/3.png: corrupt image, cannot be decoded"
    rest = [estimate(k, stages=stages) for k in (2, 4, 5, 6)]
    bad = estimate(3, health=Health.INERTIAL_ONLY, reasons=["few features: 3", skipped], stages={"decode": 0.020})
    lost = estimate(7, False, Health.LOST, ["12.5 m/s is too fast"], {"track": 0.008, "update": 0.001})
    recorder.add([*starting, rest[0], bad, *rest[1:], lost])
    return recorder.result()


@pytest.fixture
def out(tmp_path):
    return tmp_path / "runs" / "one"


def test_the_folder_holds_what_it_says(out):
    config = {"filter": Config(), "path": Path("/data/x"), "spread": np.array([1.0, np.inf])}
    write_run(out, made(), sequence(), config, {"ate_m": 0.5, "nees": float("nan")})
    assert sorted(x.name for x in out.iterdir()) == ["biases.csv", "frames.csv", "run.json", "trajectory.tum"]
    assert [x.name for x in out.parent.iterdir()] == ["one"]
    content = json.loads((out / "run.json").read_text())
    assert content["config"]["filter"] == {"sigma": 1.5, "mode": "LOST"}
    assert content["config"]["spread"] == [1.0, None]
    assert content["config"]["path"] == "/data/x"
    assert content["summary"] == {"ate_m": 0.5, "nees": None}
    assert content["input"]["frames"] == 10
    assert content["input"]["notes"] == ["a note"]
    assert content["versions"]["numpy"] == np.__version__


def test_what_is_written_is_read(out):
    run = made()
    write_run(out, run, sequence(), {"a": 1}, {"b": 2})
    stored = read_run(out)
    np.testing.assert_array_equal(stored.trajectory.t_ns, run.trajectory.t_ns)
    np.testing.assert_allclose(stored.trajectory.p_WB, run.trajectory.p_WB, atol=1e-9)
    np.testing.assert_allclose(stored.trajectory.q_WB, run.trajectory.q_WB, atol=1e-9)
    np.testing.assert_allclose(stored.trajectory.b_g, run.trajectory.b_g, rtol=1e-9)
    np.testing.assert_allclose(stored.trajectory.b_a, run.trajectory.b_a, rtol=1e-9)
    np.testing.assert_allclose(stored.sigma, np.tile(np.arange(10.0, 16.0), (5, 1)), rtol=1e-9)
    assert stored.config == {"a": 1}
    assert stored.summary == {"b": 2}


def test_the_table_of_frames(out):
    write_run(out, made(), sequence(), {}, {})
    with (out / "frames.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["health"] for row in rows[:4]] == [
        "INITIALISING",
        "INITIALISING",
        "TRACKING",
        "INERTIAL_ONLY",
    ]
    assert rows[3]["reasons"] == "few features: 3; skipped: cam0/3.png: corrupt image, cannot be decoded"
    assert (rows[3]["tracked"], rows[3]["used"]) == ("53", "3")
    assert float(rows[0]["track_ms"]) == 2.0
    assert float(rows[3]["track_ms"]) == 0.0
    assert int(rows[2]["t_ns"]) == sequence().frames[2].t_ns + OFFSET_NS


def test_biases_can_be_given_to_another_run_as_a_prior(out):
    write_run(out, made(), sequence(), {}, {})
    source = load_prior(f"file:{out / 'biases.csv'}?constant_share=0")
    first = source.poll(2**62)[0]
    np.testing.assert_allclose(first.b_a, [0.2, 0.4, 0.6])
    np.testing.assert_allclose(np.sqrt(np.diag(first.covariance)), np.arange(10.0, 16.0))


def test_the_summary_counts_against_the_recordings_frames():
    summary = summarise(made(), sequence())
    assert summary["frames"] == 10
    assert summary["completeness"] == 0.5
    assert summary["start_s"] == pytest.approx(0.1)
    assert summary["health"] == {"INITIALISING": 2, "TRACKING": 4, "INERTIAL_ONLY": 1, "LOST": 1}
    assert summary["reasons"] == {"no motion yet": 2, "few features": 1, "skipped": 1, "N m/s is too fast": 1}
    (skipped,) = summary["skipped_frames"]
    assert str(sequence().frames[3].t_ns + OFFSET_NS) in skipped
    assert "cam0/3.png: corrupt image" in skipped
    assert summary["notes"] == ["a note"]
    assert 10.0 < summary["peak_rss_mb"] < 10_000.0


def test_the_cost_of_a_frame_leaves_decoding_out():
    cost = summarise(made(), sequence())["cpu_ms_per_frame"]
    assert cost["mean"] == pytest.approx((6 * 3.0 + 0.0 + 9.0) / 8)
    assert cost["median"] == pytest.approx(3.0)
    assert cost["stages"]["decode"]["mean"] == pytest.approx((6 * 10.0 + 20.0) / 8)
    assert cost["stages"]["track"] == {"mean": pytest.approx(20.0 / 8), "median": pytest.approx(2.0)}


def test_a_run_without_a_pose(out):
    recorder = RunRecorder()
    recorder.add([estimate(k, False, Health.INITIALISING) for k in range(3)])
    run = recorder.result()
    summary = summarise(run, sequence())
    assert summary["start_s"] is None
    assert summary["completeness"] == 0.0
    write_run(out, run, sequence(), {}, summary)
    assert len(read_run(out).trajectory) == 0


def test_a_run_without_frames(out):
    empty = RunRecorder().result()
    summary = summarise(empty, sequence(frames=0))
    assert summary["completeness"] == 0.0
    assert summary["cpu_ms_per_frame"]["mean"] == 0.0
    write_run(out, empty, sequence(frames=0), {}, summary)
    assert read_run(out).summary["frames"] == 0


def test_results_are_never_overwritten(out):
    write_run(out, made(), sequence(), {}, {})
    before = (out / "run.json").read_bytes()
    with pytest.raises(DataError, match=r"one: already holds biases\.csv, .*; expected a new or an empty folder"):
        check_free(out)
    with pytest.raises(DataError, match="already holds"):
        write_run(out, made(), sequence(), {"other": 1}, {})
    assert (out / "run.json").read_bytes() == before


def test_what_counts_as_free(tmp_path):
    check_free(tmp_path / "new" / "deeper")
    (tmp_path / "empty").mkdir()
    check_free(tmp_path / "empty")
    write_run(tmp_path / "empty", made(), sequence(), {}, {})
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="is a file"):
        check_free(tmp_path / "file")


@pytest.mark.parametrize("stage", ["_write_biases", "_write_frames", "_write_description"])
def test_nothing_is_left_behind_after_an_error(out, monkeypatch, stage):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(folder, stage, interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_run(out, made(), sequence(), {}, {})
    assert list(out.parent.iterdir()) == []


def test_a_value_that_json_cannot_hold_leaves_nothing_behind(out):
    with pytest.raises(TypeError):
        write_run(out, made(), sequence(), {"f": print}, {})
    assert list(out.parent.iterdir()) == []


def test_what_an_interrupted_run_left_is_replaced(out):
    partial = out.with_name("one.partial")
    partial.mkdir(parents=True)
    (partial / "old").write_text("")
    write_run(out, made(), sequence(), {}, {})
    assert not (out / "old").exists()


def test_the_same_run_gives_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        write_run(tmp_path / name, made(), sequence(), {}, {})
    for file in ("trajectory.tum", "biases.csv", "frames.csv", "run.json"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda out: (out / "run.json").unlink(), r"run\.json: no such file; expected the folder of a run"),
        (lambda out: (out / "run.json").write_text("{"), r"run\.json: not the description of a run"),
        (lambda out: (out / "run.json").write_text("[]"), r"run\.json: not the description of a run"),
        (lambda out: (out / "trajectory.tum").unlink(), r"trajectory\.tum: no such file"),
        (lambda out: (out / "biases.csv").unlink(), r"biases\.csv: no such file"),
        (
            lambda out: (out / "biases.csv").write_text("5" + ",1" * 12),
            r"biases\.csv: stamps are not those of",
        ),
    ],
)
def test_a_damaged_folder_is_named(out, damage, says):
    write_run(out, made(), sequence(), {}, {})
    damage(out)
    with pytest.raises(DataError, match=says):
        read_run(out)

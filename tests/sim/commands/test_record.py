from pathlib import Path

import pytest

from navcore.readers import open_sequence
from sim.imu import GRADES
from sim.platforms import DIFFICULTIES, PLATFORMS
from sim.world import SCENES
from tests.sim.calls import call


def test_help_lists_what_can_be_chosen(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert call(monkeypatch, "record", "--help") == 0
    shown = "".join(capsys.readouterr().out.split())
    for names in (PLATFORMS, SCENES, DIFFICULTIES, ("images", "points", "imu"), ("asl", "ros1", "ros2")):
        assert "{" + ",".join(names) + "}" in shown
    assert all(name in shown for grade in GRADES for name in (grade, f"{grade}-uncalibrated"))


def test_a_name_that_is_none_is_refused_with_those_that_are(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(monkeypatch, "record", "--out", str(tmp_path / "x"), "--platform", "boat") == 2
    assert "quadrotor" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_it_records_imu_into_a_bag(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    out = tmp_path / "flight"
    assert call(monkeypatch, "record", "--out", str(out), "--seconds", "1", "--mode", "imu", "--format", "ros2") == 0
    assert len(open_sequence(out).imu) == 200
    assert (out / "recording.db3").is_file()


def test_what_is_interrupted_says_how_it_goes_on(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("sim.commands.record.record", interrupted)
    assert call(monkeypatch, "record", "--out", str(tmp_path / "x")) == 130
    assert "the same command goes on" in capsys.readouterr().err

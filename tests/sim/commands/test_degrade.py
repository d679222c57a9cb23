"""`python -m sim degrade`: cells and schedules on a recording that is made here."""

from pathlib import Path

import numpy as np
import pytest

from navcore.readers import open_sequence
from sim.output import write_recording
from tests.sim.calls import call
from tests.sim.degrade.recordings import turning


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("degrade") / "turning"
    write_recording(turning(cameras=1), folder)
    return folder


def test_every_cell_that_is_named_is_written_and_no_other(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, recording: Path
) -> None:
    assert call(monkeypatch, "degrade", recording, "--cell", "fog-2", "--cell", "low_rate-*", "--out", tmp_path) == 0
    assert {p.name for p in tmp_path.iterdir()} == {"fog-2", *(f"low_rate-{k}" for k in range(1, 6))}
    clean, foggy = open_sequence(recording), open_sequence(tmp_path / "fog-2")
    same = [
        np.array_equal(a.images[0].load(), b.images[0].load()) for a, b in zip(clean.frames, foggy.frames, strict=True)
    ]
    t_s = np.array([(f.t_ns - clean.frames[0].t_ns) * 1e-9 for f in clean.frames])
    inside = (t_s >= 0.35 * t_s[-1]) & (t_s < 0.65 * t_s[-1])
    np.testing.assert_array_equal(same, ~inside)
    np.testing.assert_array_equal(clean.imu.gyro, foggy.imu.gyro)


def test_what_is_there_is_left_alone_and_what_does_not_fit_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):
        assert (
            call(monkeypatch, "degrade", recording, "--cell", "jpeg-1", "--cell", "outage-5-*", "--out", tmp_path) == 0
        )
    said = capsys.readouterr().err
    assert "outage-5-early is left out" in said and "jpeg-1 is there already" in said
    assert call(monkeypatch, "degrade", recording, "--cell", "outage-5-early", "--out", tmp_path / "other") == 1
    assert "needs 8.4 s" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


def test_bad_requests_end_before_work_begins(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, message in (
        (("--cell", "smog-1"), "there are clean, motion_blur-1"),
        (("--degrade", "fog:6@0-1"), "severity of fog is 6, expected 1 to 5"),
        (("--degrade", "smog:1@0-1"), "known are blackout, motion_blur"),
        (("--degrade", "fog:1@5-6"), "reaches beyond the recording"),
        (("--spec", "v9"), "expected v1"),
    ):
        assert call(monkeypatch, "degrade", recording, *arguments, "--out", tmp_path / "x") == 1
        assert message in " ".join(capsys.readouterr().err.split())
        assert not (tmp_path / "x").exists()


def test_a_recording_is_never_written_into(
    monkeypatch: pytest.MonkeyPatch, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(recording.iterdir())
    for how in (("--cell", "fog-2"), ("--degrade", "fog:1@0-1")):
        for out in (recording, recording / "mav0" / "other"):
            assert call(monkeypatch, "degrade", recording, *how, "--out", out) == 1
            assert "is inside the recording" in " ".join(capsys.readouterr().err.split())
    assert sorted(recording.iterdir()) == before

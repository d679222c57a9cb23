from pathlib import Path

import cv2
import pytest

from navcore.readers import open_sequence
from sim.camera import gl
from sim.errors import RenderError
from tests.sim.calls import call


def test_record_writes_what_the_reader_reads(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    out = tmp_path / "flight"
    arguments = [
        "--platform",
        "quadrotor",
        "--seconds",
        "1",
        "--seed",
        "2",
        "--mode",
        "points",
        "--start-in-motion",
    ]
    assert call(monkeypatch, "record", *arguments, "--out", str(out)) == 0
    assert len(open_sequence(out).frames) == 18


def test_a_wrong_degradation_ends_with_one_and_the_valid_kinds(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(monkeypatch, "record", "--out", str(tmp_path / "x"), "--degrade", "smog:1@0-1") == 1
    assert "known are blackout, motion_blur, texture_loss" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


def test_check_gl_says_what_to_type_where_there_is_none(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(gl, "works", lambda: False)
    monkeypatch.setattr(gl.os, "geteuid", lambda: 1000)
    for arguments in (["check-gl"], ["check-gl", "--install"]):
        assert call(monkeypatch, *arguments) == 1
        assert "apt-get install -y --no-install-recommends libegl1 libegl-mesa0" in capsys.readouterr().err


def test_install_reports_a_failing_apt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl.os, "geteuid", lambda: 0)
    monkeypatch.setattr(gl.shutil, "which", lambda _: "/usr/bin/apt-get")
    monkeypatch.setattr(gl, "INSTALL", "echo no network >&2; false")
    with pytest.raises(RenderError, match="no network"):
        gl.install()


@pytest.mark.usefixtures("opengl")
def test_check_gl_passes_and_strip_draws(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert call(monkeypatch, "check-gl") == 0
    monkeypatch.setattr("sim.strip._SECONDS", 4.0)
    out = tmp_path / "strip.png"
    assert call(monkeypatch, "strip", "--out", str(out)) == 0
    picture = cv2.imread(str(out), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    assert picture.shape[1] == 960
    assert out.stat().st_size < 600_000

import pytest

from msckf.__main__ import main


def run(monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", ["python -m msckf", "run", *map(str, arguments)])
    return main()


def test_a_run_that_is_drawn_writes_the_same(short_flight, tmp_path, monkeypatch):
    assert run(monkeypatch, short_flight, "--out", tmp_path / "a") == 0
    file = tmp_path / "run.rrd"
    assert run(monkeypatch, short_flight, "--out", tmp_path / "b", "--rerun-save", file) == 0
    assert file.stat().st_size > 50_000
    for name in ("trajectory.tum", "biases.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_a_drawing_that_cannot_be_written_is_said_before_anything_runs(short_flight, tmp_path, monkeypatch, capsys):
    with pytest.raises(SystemExit, match="1"):
        run(monkeypatch, short_flight, "--out", tmp_path / "a", "--rerun-save", tmp_path / "gone" / "run.rrd")
    assert "no such folder" in capsys.readouterr().err and not (tmp_path / "a").exists()

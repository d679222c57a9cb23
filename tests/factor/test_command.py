"""`python -m factor run`."""

import json

from factor.__main__ import main


def run(monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", ["python -m factor", "run", *map(str, arguments)])
    return main()


def test_it_writes_the_same_folder_as_the_filter(short_flight, tmp_path, monkeypatch):
    out = tmp_path / "out"
    assert run(monkeypatch, short_flight, "--out", out, "--prior", "truth", "--prior-mode", "plain") == 0
    assert {"trajectory.tum", "biases.csv", "frames.csv", "run.json"} <= {f.name for f in out.iterdir()}
    config = json.loads((out / "run.json").read_text())["config"]
    assert config["bias_prior"] == "truth" and config["prior"]["mode"] == "plain" and config["end_s"] is None


def test_a_start_from_truth(short_flight, tmp_path, monkeypatch):
    assert run(monkeypatch, short_flight, "--out", tmp_path / "out", "--init", "truth") == 0
    lines = (tmp_path / "out" / "trajectory.tum").read_text().splitlines()
    assert len([line for line in lines if not line.startswith("#")]) > 55

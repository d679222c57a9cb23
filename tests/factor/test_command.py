"""`python -m factor run`."""

import json

import pytest

from factor.__main__ import main
from sim.output import write_recording
from sim.points import simulate_points


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("points") / "flight"
    write_recording(simulate_points("quadrotor", seconds=3.0), folder)
    return folder


def run(monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", ["python -m factor", "run", *map(str, arguments)])
    return main()


def test_it_writes_the_same_folder_as_the_filter(recording, tmp_path, monkeypatch):
    out = tmp_path / "out"
    assert run(monkeypatch, recording, "--out", out, "--prior", "truth", "--prior-mode", "plain") == 0
    assert {"trajectory.tum", "biases.csv", "frames.csv", "run.json"} <= {f.name for f in out.iterdir()}
    config = json.loads((out / "run.json").read_text())["config"]
    assert config["bias_prior"] == "truth" and config["prior"]["mode"] == "plain" and config["end_s"] is None


def test_a_start_from_truth(recording, tmp_path, monkeypatch):
    assert run(monkeypatch, recording, "--out", tmp_path / "out", "--init", "truth") == 0
    lines = (tmp_path / "out" / "trajectory.tum").read_text().splitlines()
    assert len([line for line in lines if not line.startswith("#")]) > 55

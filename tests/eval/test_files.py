import json

import numpy as np
import pytest

from eval.__main__ import score
from eval.errors import ScoreError
from eval.files import read_estimate, read_truth
from navcore.errors import DataError
from tests.eval.paths import drifting, flight


@pytest.fixture
def run_folder(tmp_path):
    rng = np.random.default_rng(1)
    truth = flight(rng, seconds=15.0)
    estimate = drifting(truth, rng)
    folder = tmp_path / "run"
    folder.mkdir()
    estimate.to_tum(folder / "trajectory.tum")
    sigma = np.ones((len(truth), 6))
    rows = np.hstack([estimate.b_g, estimate.b_a, sigma])
    lines = [f"{t}," + ",".join(f"{x:.9g}" for x in row) for t, row in zip(estimate.t_ns, rows, strict=True)]
    names = "t_ns,b_g_x,b_g_y,b_g_z,b_a_x,b_a_y,b_a_z,s1,s2,s3,s4,s5,s6"
    (folder / "biases.csv").write_text("\n".join([names, *lines]) + "\n")
    truth.to_tum(tmp_path / "truth.tum")
    return folder, estimate, tmp_path / "truth.tum"


def test_a_run_is_read_with_its_biases(run_folder):
    folder, estimate, _ = run_folder
    found = read_estimate(folder)
    np.testing.assert_array_equal(found.t_ns, estimate.t_ns)
    np.testing.assert_allclose(found.b_a, estimate.b_a, rtol=1e-8)
    np.testing.assert_allclose(found.b_g, estimate.b_g, rtol=1e-8)
    assert read_estimate(folder / "trajectory.tum").b_g is None
    (folder / "biases.csv").unlink()
    assert read_estimate(folder).b_g is None


@pytest.mark.parametrize("fault", ["1,2\n", "t,b\nx,y,z,1,2,3,4\n", ""])
def test_biases_that_do_not_fit_are_named(run_folder, fault):
    folder, _, _ = run_folder
    (folder / "biases.csv").write_text(fault)
    with pytest.raises(ScoreError, match=r"biases\.csv"):
        read_estimate(folder)


def test_biases_of_another_run_are_not_taken(run_folder):
    folder, _, _ = run_folder
    lines = (folder / "biases.csv").read_text().splitlines()
    stamp, _, rest = lines[5].partition(",")
    lines[5] = f"{int(stamp) + 1},{rest}"
    (folder / "biases.csv").write_text("\n".join(lines))
    with pytest.raises(ScoreError, match="do not match 300 poses"):
        read_estimate(folder)


def test_what_is_not_there_is_named(tmp_path, run_folder):
    folder, _, _ = run_folder
    with pytest.raises(ScoreError, match="nowhere"):
        read_estimate(tmp_path / "nowhere")
    with pytest.raises(ScoreError, match="nowhere"):
        read_truth(tmp_path / "nowhere")
    with pytest.raises(DataError):
        read_truth(folder)


def test_the_command_prints_json(run_folder, capsys):
    folder, _, truth = run_folder
    assert score(folder, truth, still_s=1.0, as_json=True) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["poses"] == 300 and 0.0 < found["ate_m"] < 0.5 and found["still_drift_m"] > 0.0
    assert score(folder, truth) == 0
    assert "ate_m" in capsys.readouterr().out

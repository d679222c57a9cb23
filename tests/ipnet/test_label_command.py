"""`python -m ipnet label`: files in, a file of labels and a figure out, and what goes wrong."""

import io
import json

import numpy as np
import pytest
from rich.console import Console

from ipnet.commands.label import Label
from ipnet.errors import LabelError
from ipnet.recordings import read_labels
from sim.output import write_recording
from tests.ipnet.swinging import BIAS, recording, samples, truth


def console():
    return Console(record=True, width=250, file=io.StringIO())


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """Three recordings, the last of which has too little truth."""
    root = tmp_path_factory.mktemp("flights")
    for k, seconds in enumerate((15.0, 14.0, 3.0)):
        sequence = recording(imu=samples(15.0, BIAS * (1.0 + k)), path=truth(seconds), name=f"flight{k}")
        write_recording(sequence, root / f"flight{k}", format="asl", origin={"flight": k})
    return root


def test_labels_are_written_and_read_back(flights, tmp_path):
    said, out = console(), tmp_path / "made" / "labels.json"
    Label((flights,), out, source="swings").run(said)
    labels = read_labels(out)
    assert sorted(labels) == ["flight0", "flight1"]
    np.testing.assert_allclose(labels["flight1"].bias, 2.0 * BIAS, atol=1e-3)
    text = said.export_text()
    assert "no label:" in text and "flight2" in text and "wrote 2 of 3 labels" in text
    row = json.loads(out.read_text())[0]
    assert row["provenance"]["source"] == "swings"
    assert row["provenance"]["truth"] == "poses of the recording's truth, 50 Hz"
    assert row["segments"] == {"used": 14, "left_out": 0}


def test_labels_of_other_recordings_stay(flights, tmp_path):
    out = tmp_path / "labels.json"
    Label((flights / "flight0",), out).run(console())
    Label((flights / "flight1",), out).run(console())
    Label((flights / "flight1",), out).run(console())
    assert [r["sequence"] for r in json.loads(out.read_text())] == ["flight0", "flight1"]


def test_errors_against_other_labels_are_in_standard_deviations_of_both(flights, tmp_path):
    out = tmp_path / "labels.json"
    Label((flights / "flight0",), out).run(console())
    rows = json.loads(out.read_text())
    covariance = np.array(rows[0]["covariance"])
    step = np.sqrt(np.diag(covariance))  # nearly uncorrelated: each half is off by one standard deviation
    rows[0]["b_g"] = (rows[0]["b_g"] - 2.0 * step[:3]).tolist()
    rows[0]["covariance"] = (3.0 * covariance).tolist()  # four in all
    other, said = tmp_path / "other.json", console()
    other.write_text(json.dumps(rows))
    Label((flights / "flight0",), out, against=other).run(said)
    assert "1.0 0.0" in said.export_text()


def test_what_cannot_be_done_is_said(flights, tmp_path):
    with pytest.raises(LabelError, match="no PATH"):
        Label((), tmp_path / "x.json").run(console())
    with pytest.raises(LabelError, match="--out FILE"):
        Label((flights,)).run(console())
    with pytest.raises(LabelError, match="holds no recording"):
        Label((tmp_path,), tmp_path / "x.json").run(console())
    with pytest.raises(LabelError, match="none of 1 recordings"):
        Label((flights / "flight2",), tmp_path / "x.json").run(console())
    (tmp_path / "other.json").write_text('{"no": "labels"}')
    with pytest.raises(LabelError, match="expected a file of labels"):
        Label((flights,), tmp_path / "other.json").run(console())
    assert not (tmp_path / "x.json").exists()

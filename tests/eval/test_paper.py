"""The paper's tables: what is run for them, and where each figure stands."""

import numpy as np
import pandas as pd
import pytest

from eval.outcome import Index, Outcome
from eval.paper import PaperTables
from eval.records import Record
from eval.survey import Survey
from ipnet.seen import seen_by
from tests.eval.recorded import write_flight


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    """Three recordings that the paper has figures of, and one that it has not."""
    folder = tmp_path_factory.mktemp("recordings")
    for seed, name in enumerate(("V2_02_medium", "dataset-room5_512_16", "MH_04_difficult", "MH_01_easy")):
        write_flight(folder, name, seed)
    return PaperTables(Survey.of(folder))


def test_each_sequence_is_run_for_the_tables_that_have_it(asked):
    cells = [c for c in asked.study().cells if c.regime != "table III"]
    found = {(c.regime, c.condition) for c in cells}
    assert found == {
        *(("table I", f"{name}, {rate}") for name in ("V2_02", "room5") for rate in ("20 Hz", "10 Hz")),
        *(("table II", f"{name}, 20 Hz") for name in ("V2_02", "MH_04")),
    }
    assert {c.estimator for c in cells} == {"msckf", "factor"}
    assert len({(c.regime, c.condition, c.estimator, c.arm) for c in cells}) == len(cells) == 2 * 4 * len(found)
    frames = {c.condition: len(c.source.load(None).frames) for c in cells if c.regime == "table I"}
    images = {
        c.condition: sum(bool(f.images) for f in c.source.load(None).frames) for c in cells if c.regime == "table I"
    }
    assert images["V2_02, 10 Hz"] == pytest.approx(0.5 * images["V2_02, 20 Hz"], abs=1) and frames["V2_02, 20 Hz"] > 10


def test_nothing_that_a_table_is_told_has_seen_its_recording(asked):
    for cell in asked.study().cells:
        if cell.prior != "none":
            assert cell.source.name not in seen_by(cell.prior), cell.title
            assert (cell.arm == "paper") == bool(cell.overrides)
    flights = {c.source for c in asked.study().cells if c.regime == "table III"}
    assert len(flights) == 12  # four indoors, four outdoors by day and by night


def record(condition, arm, ate_m, rpe_rad, table="table I", estimator="factor", seed=1):
    config = {"platform": "recordings", "regime": table, "condition": condition, "level": None, "axis": ""}
    config |= {"seed": seed, "estimator": estimator, "arm": arm, "recording": condition}
    scores = {"ate_m": ate_m, "rpe_rad": rpe_rad, "diverged": float(np.isinf(ate_m)), "initial_ate_m": 0.5 * ate_m}
    scores |= {"estimator_ms_per_frame": 20.0}
    return Record(f"{condition} {arm} {seed}", "", config, {}, scores, None, pd.DataFrame())


def test_figures_stand_beside_the_papers_and_what_is_not_at_hand_stays_open(asked):
    records = [
        record("V2_01, 20 Hz", "none", 0.1, 0.002),
        record("V2_01, 20 Hz", "paper", 0.15, 0.001),
        record("V2_01, 20 Hz", "ipnet", 0.05, 0.002),
        record("room5, 10 Hz", "none", np.inf, np.nan),
        record("MH_02, 20 Hz", "recursive", 0.2, 0.004, "table II"),
        *(record("outdoor", "none", 0.1 * s, 0.001 * s, "table III", seed=s) for s in (1, 2, 6)),
    ]
    index = Index("", "none", {}, 0.0, [], [], [])
    tables = asked.tables(Outcome(index, tuple(records)))
    first = {row[:3]: row[3:] for row in tables["table-1"].rows}
    assert len(first) == 6 * 2 * 2
    assert first["V2_01", "20 Hz", "factor"] == (
        *("0.100", "0.00200", "0.150 (+50 %)", "0.00100 (−50 %)", "0.050 (−50 %)", "0.00200 (±0 %)", "–", "–"),
        *("0.133", "0.04317", "0.048 (−64 %)", "0.00672 (−84 %)"),
    )
    assert first["room5", "10 Hz", "factor"][:2] == ("diverged", "diverged")
    assert first["MH_05", "20 Hz", "msckf"] == (*["–"] * 8, "0.340", "0.02115", "0.249 (−27 %)", "0.00655 (−69 %)")
    assert first["V2_02", "20 Hz", "factor"][8:] == ("diverged", "diverged", "0.098", "0.00565")
    second = {row[:2]: row[2:] for row in tables["table-2"].rows}
    assert second["MH_02", "factor"][2:4] == ("0.200", "0.00400") and second["MH_02", "factor"][8:] == (
        *("0.130", "0.087", "0.00260"),
    )
    third = {row[:2]: row[2:] for row in tables["table-3"].rows}
    assert third["outdoor", "factor"][:2] == ("0.200", "0.00200")
    assert third["outdoor, evening", "msckf"][6:8] == (f"{(0.4150 + 0.8047) / 2:.3f}", "0.17200")
    phase = {row[:2]: row[2:] for row in tables["initial-phase"].rows}
    assert phase["V2_01, 20 Hz", "factor"] == ("0.0500", "0.0750", "0.0250", "–")
    speed = {row[0]: row[1:] for row in tables["speed"].rows}
    assert speed["frames, factor with ipnet"] == ("50", "30")
    assert len(tables["labels"].rows) == 9

import io
from dataclasses import replace

import pytest
from rich.console import Console

from eval import records
from eval.bar import expectation, study_bar
from eval.flights import Flight, RenderedFlight
from eval.progress import Ledger, Progress
from eval.sources import rendered
from tests.eval.test_study import cell


def test_a_ledger_counts_cells_by_their_records_and_time_by_cost(tmp_path):
    cells = [cell(1, "none"), cell(1, "other", scale=2.0), cell(2, "none")]
    records.write(records.Record("c", "done before", {}, {}), tmp_path)
    seen = []
    ledger = Ledger(cells, ["a", "b", "c"], tmp_path, seen.append)
    assert [[key for key, _ in batch] for batch in ledger.batches.values()] == [["a", "b"]]
    ledger.start(2)
    assert (seen[-1].cells, seen[-1].all_cells, seen[-1].workers) == (1, 3, 2)
    assert seen[-1].expected_s == pytest.approx((0.1 + 2 * 0.2) / 2)
    records.write(records.Record("a", "one of two", {}, {}), tmp_path)
    ledger.finished(cells[0].source)  # the other one could not be run: its time is behind, but it is no result
    assert seen[-1].cells == 2 and seen[-1].expected_s == pytest.approx(0.0)


def test_a_film_is_listed_once_and_its_images_never_count_backwards(tmp_path):
    flight = Flight("quadrotor", 2.0, 1)
    dark = rendered(flight, "low_light:3@0.5-1")
    cells = [cell(1), *(cell(1, arm) for arm in ("b", "c"))]
    cells = [replace(c, source=s) for c, s in zip(cells, (RenderedFlight.of(flight), dark, dark), strict=True)]
    seen = []
    ledger = Ledger(cells, ["a", "b", "c"], tmp_path, seen.append)
    assert len(ledger.films) == 1 and len(ledger.batches) == 2
    ledger.start(1)
    assert (seen[-1].images, seen[-1].all_images) == (0, 40)
    ledger.rendered(0, 30, 39)
    half = seen[-1].cost_s
    ledger.rendered(0, 2, 39)  # its worker died, another one begins
    assert (seen[-1].images, seen[-1].all_images, seen[-1].cost_s) == (30, 39, half)
    assert half == pytest.approx(ledger.films[0].cost.make_s * 30 / 39)


def test_the_bar_says_what_it_will_take_and_how_far_it_is():
    now = Progress(4, 100, 0, 400, 0.0, 1200.0, 2)
    assert expectation(now) == "96 cells and 400 images to make: about 10 minutes on 2 workers"
    long = Progress(0, 100, 0, 0, 0.0, 72000.0, 2)
    assert expectation(long) == "100 cells to make: about 10.0 hours on 2 workers"
    assert expectation(Progress(0, 1, 0, 0, 0.0, 9.0, 1)) == "1 cell to make: about 1 minute on 1 worker"
    console = Console(file=io.StringIO(), width=120, force_terminal=True, color_system=None)
    with study_bar(console) as show:
        show(now)
        show(Progress(50, 100, 400, 400, 600.0, 1200.0, 2))
    text = console.file.getvalue()
    assert text.count("about 10 minutes") == 1 and "50/100 cells, 400/400 images" in text
    console = Console(file=io.StringIO(), width=120, force_terminal=True, color_system=None)
    with study_bar(console) as show:
        show(Progress(100, 100, 0, 0, 0.0, 0.0, 0))
    assert "to make" not in console.file.getvalue()

"""What the parts of a study cost, against what a study expects; `docs/study.md` has the table."""

from time import process_time

import pytest

from eval.cells import Cell
from eval.flights import Flight, PointsFlight, RenderedFlight
from eval.work import run_cell
from sim.platforms import PLATFORMS

pytestmark = pytest.mark.bench
FACTOR = 3.0  # machines differ; an expectation that is further off misleads


def spent(action) -> float:
    """CPU seconds of this process, one thread of its own or many."""
    begun = process_time()
    action()
    return process_time() - begun


@pytest.mark.parametrize("platform", PLATFORMS)
def test_points(platform, tmp_path):
    flight = Flight(platform, 40.0, 3)
    source = PointsFlight(flight, "blackout@15-25")
    motion, load = spent(flight.motion), spent(lambda: source.load(tmp_path))
    print(f"\n{platform}: motion {motion / 40.0:.4f}, tracks {load / 40.0:.4f} s a second of flight")
    assert motion / 2.0 + load < FACTOR * source.cost.load_s
    cell = Cell(source, platform, "bench", "outage", 1, "none")
    run = spent(lambda: run_cell(cell, {}, tmp_path)) - load
    print(f"{platform}: filter and scores, points, {run / flight.frames:.4f} s a frame")
    assert source.cost.run_s / FACTOR < run < FACTOR * source.cost.run_s


@pytest.mark.parametrize("degrade", ["", "motion_blur:4@0-6"])
def test_images(degrade, tmp_path):
    flight = Flight("quadrotor", 6.0, 3)
    flight.motion()
    film = RenderedFlight.of(flight, degrade)
    make = spent(lambda: film.make(tmp_path))
    print(f"\nimages, {degrade or 'clean'}: {make / flight.frames:.3f} s each")
    assert film.cost.make_s / FACTOR < make < FACTOR * film.cost.make_s
    run = spent(lambda: run_cell(Cell(film, "q", "bench", "x", 1, "none"), {}, tmp_path))
    print(f"filter and scores, images, {run / flight.frames:.4f} s a frame")
    assert film.cost.run_s / FACTOR < run < FACTOR * film.cost.run_s

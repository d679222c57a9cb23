"""A schedule or a cell of a benchmark, by one text."""

import numpy as np
import pytest

from sim import simulate_points
from sim.degrade import Request
from sim.degrade.spec import Spec
from sim.errors import ConfigError
from sim.motion import Motion


def test_a_schedule_is_taken_as_it_is_and_a_cell_fits_the_length() -> None:
    assert str(Request.parse("fog:2@3-5").schedule(20.0)) == "fog:2@3-5"
    assert Request.parse("fog:2@3-5").seed(7) == 7
    assert str(Request.parse("").schedule(20.0)) == ""
    cell = Request.parse("v1/fog-2")
    assert str(cell.schedule(200.0)) == "fog:2@70-130"
    assert cell.seed(7) == Spec.load("v1").seed


def test_what_is_unknown_or_does_not_fit_is_named() -> None:
    with pytest.raises(ConfigError, match="cell 'smog' is not in v1; there are clean, "):
        Request.parse("v1/smog")
    with pytest.raises(ConfigError, match="benchmark 'v9' is unknown; expected v1"):
        Request.parse("v9/fog-2")
    with pytest.raises(ConfigError, match="not of the form"):
        Request.parse("fog")
    with pytest.raises(ConfigError, match="beyond the recording"):
        Request.parse("fog:2@3-50").schedule(20.0)
    with pytest.raises(ConfigError, match=r"needs 63\.0 s"):
        Request.parse("v1/outage-30-late").schedule(50.0)


def test_a_cell_drives_a_simulated_flight(flight: Motion) -> None:
    sequence = simulate_points(seed=3, motion=flight, degrade="v1/outage-5-early")
    dark = np.array([len(frame.tracks[0]) == 0 for frame in sequence.frames])
    seconds = np.array([(f.t_ns - sequence.frames[0].t_ns) * 1e-9 for f in sequence.frames])
    length_s = seconds[-1]
    assert seconds[dark].min() == pytest.approx(0.15 * length_s, abs=0.06)
    assert dark.sum() == pytest.approx(100, abs=1)

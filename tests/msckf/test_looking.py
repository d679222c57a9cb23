"""What the filter lets others look at while it runs."""

import numpy as np
import pytest

from msckf import Filter
from msckf.config import FilterConfig
from navcore.prior import BiasPrior
from navcore.priors.listed import ListedPrior
from navcore.sequence import Frame
from sim.points import simulate_points


@pytest.fixture(scope="module")
def flight():
    return simulate_points("quadrotor", seconds=4.0, cameras=2)


def answers(vio, flight):
    """The frames that were answered, one after the other."""
    waiting = []
    for event in flight.events():
        if isinstance(event, Frame):
            waiting.append(event)
            found = vio.add_frame(event)
        else:
            found = vio.add_imu(event)
        for estimate in found:
            yield waiting.pop(0), estimate


def test_tracks_are_those_of_the_newest_answered_frame(flight):
    vio = Filter(flight.calibration, FilterConfig(cameras=2))
    assert vio.tracks == {}
    for frame, estimate in answers(vio, flight):
        seen = vio.tracks
        assert set(seen) == {c for c, tracks in frame.tracks.items() if len(tracks)}
        assert estimate.tracked == sum(len(tracks) for tracks in seen.values())
        for c, tracks in seen.items():
            np.testing.assert_array_equal(tracks.uv, frame.tracks[c].uv)
            np.testing.assert_array_equal(tracks.ids, frame.tracks[c].ids)


def said(flight, covariance):
    """A source that states the true biases once a second, as exact as it says."""
    stamps = flight.imu.t_ns[0] + 1_000_000_000 * np.arange(1, 4)
    at = flight.truth.at(stamps)
    rows = [BiasPrior(int(t), b_g, b_a, covariance) for t, b_g, b_a in zip(stamps, at.b_g, at.b_a, strict=True)]
    return ListedPrior(rows, window_s=0.5, constant_covariance=covariance)


def test_what_is_known_of_a_prior(flight):
    covariance = np.diag(np.repeat([1e-3, 0.05], 3) ** 2)
    vio = Filter(flight.calibration, prior=said(flight, covariance))
    applied = [(vio.prior.applied, vio.prior.nis) for _ in answers(vio, flight)]
    last = vio.prior
    assert vio.state is not None and applied[-1] == (last.applied, last.nis)
    assert [n for n, _ in applied] == sorted(n for n, _ in applied) and last.applied >= 2
    assert all((nis is None) == (n == 0) for n, nis in applied)  # it is kept between measurements
    assert 0.0 < last.nis < 30.0 and last.c.shape == (6,) and last.covariance.shape == (6, 6)
    assert np.all(np.diagonal(last.covariance) < np.diagonal(covariance))
    last.c[:] = 1.0  # a copy
    assert np.abs(vio.prior.c).max() < 0.2


def test_nothing_is_known_without_a_prior(flight):
    vio = Filter(flight.calibration)
    for _ in answers(vio, flight):
        known = vio.prior
        assert (known.applied, known.nis, known.c, known.covariance) == (0, None, None, None)

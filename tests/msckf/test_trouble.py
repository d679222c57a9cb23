"""What goes wrong around a filter: it says so, stays finite, and starts again where it was."""

from dataclasses import replace

import numpy as np
import pytest

from msckf.blocks import BIASES
from msckf.config import FilterConfig
from msckf.errors import InputError
from msckf.filter import Filter
from navcore.imu import ImuSamples
from navcore.odometry import Health, run
from navcore.sequence import Frame, Sequence, Tracks
from sim.points import simulate_points
from tests.msckf.flights import fly, seconds, without_imu


@pytest.fixture(scope="module")
def flight() -> Sequence:
    return simulate_points(seed=4, seconds=18.0)


def estimates(sequence, **settings):
    """Every estimate with its covariance."""
    vio = Filter(sequence.calibration, FilterConfig().with_overrides(settings))
    found = []
    for event in sequence.events():
        found += vio.add_frame(event) if isinstance(event, Frame) else vio.add_imu(event)
    return vio, found + vio.finish()


def test_what_was_learned_of_the_biases_outlives_a_loss(flight):
    t = (np.array([f.t_ns for f in flight.frames]) - flight.frames[0].t_ns) * 1e-9
    frames = [f for f, s in zip(flight.frames, t, strict=True) if not 10.0 < s < 12.0]
    sequence = replace(without_imu(flight, 10.0, 12.0), frames=frames)
    _, found = estimates(sequence)
    t = np.array([e.t_ns for e in found])
    lost = np.flatnonzero([e.health is Health.LOST for e in found])
    before, after = found[lost[0] - 1].state, found[lost[-1] + 1].state
    sigma = [np.sqrt(np.diagonal(s.covariance)[BIASES]) for s in (before, after)]
    assert (sigma[1] < 6.0 * sigma[0]).all()
    assert sigma[1][3:].max() < 0.5 * FilterConfig().start.accel_bias_sigma
    true = flight.truth.at(t[lost[-1] + 1 : lost[-1] + 2])
    error = np.concatenate([after.b_g - true.b_g[0], after.b_a - true.b_a[0]])
    assert (np.abs(error) < 4.0 * sigma[1]).all()
    assert all(e.state is None or np.isfinite(e.state.covariance).all() for e in found)


def test_one_missing_image_ends_nothing(flight):
    k = 200
    blind = replace(flight, frames=[f if i != k else Frame(f.t_ns) for i, f in enumerate(flight.frames)])
    vio = Filter(flight.calibration, FilterConfig())
    kept = {}
    for event in blind.events():
        answers = vio.add_frame(event) if isinstance(event, Frame) else vio.add_imu(event)
        for estimate in answers:
            kept[estimate.t_ns] = set(vio.state.landmarks.keys.tolist()) if vio.state else set()
    before, during, after = (kept[blind.frames[i].t_ns] for i in (k - 1, k, k + 1))
    assert len(before) > 10
    assert during == before
    assert len(after & before) > 0.8 * len(before)


def kidnapped(seed=6) -> tuple[Sequence, Sequence, float]:
    """A flight that goes on as another one, in another place, from one frame to the next; the second; and when."""
    first, second = (
        simulate_points(seed=4, seconds=8.0, noisy_imu=False),
        simulate_points(seed=seed, seconds=10.0, moving_start=True, noisy_imu=False),
    )
    shift = int(first.frames[-1].t_ns + 50_000_000 - second.frames[0].t_ns)
    frames = [
        Frame(f.t_ns + shift, tracks={c: Tracks(t.ids + 10**6, t.uv) for c, t in f.tracks.items()})
        for f in second.frames
    ]
    begin = frames[0].t_ns - 25_000_000
    a, b = first.imu, second.imu
    keep_a, keep_b = a.t_ns < begin, b.t_ns + shift >= begin
    imu = ImuSamples(
        np.concatenate([a.t_ns[keep_a], b.t_ns[keep_b] + shift]),
        np.concatenate([a.gyro[keep_a], b.gyro[keep_b]]),
        np.concatenate([a.accel[keep_a], b.accel[keep_b]]),
    )
    whole = replace(first, imu=imu, frames=[*first.frames, *frames], truth=None)
    return whole, second, (frames[0].t_ns - first.frames[0].t_ns) * 1e-9


def test_after_kidnapping_it_finds_itself_again():
    sequence, second, at_s = kidnapped()
    result = run(Filter(sequence.calibration, FilterConfig()), sequence)
    t = seconds(sequence, result)
    end = result.estimates[-1]
    assert end.health is Health.TRACKING
    true = second.truth.at(np.array([second.frames[-1].t_ns]))
    v_B, up_B = end.state.R_WB.T @ end.state.v_WB, end.state.R_WB.T @ [0.0, 0.0, 1.0]
    assert np.linalg.norm(v_B - true.R_WB[0].T @ true.v_WB[0]) < 0.2
    assert np.linalg.norm(up_B - true.R_WB[0].T @ [0.0, 0.0, 1.0]) < 0.03
    assert any(e.health is not Health.TRACKING for e, s in zip(result.estimates, t, strict=True) if s > at_s)


def test_a_crowd_in_the_view_is_no_reason_to_start_again():
    result = fly(simulate_points(seed=3, seconds=12.0, moving=0.4))
    started = next(k for k, e in enumerate(result.estimates) if e.state is not None)
    assert all(e.health is not Health.LOST for e in result.estimates[started:])


def test_a_stamp_from_the_far_future_is_refused(flight):
    vio = Filter(flight.calibration, FilterConfig())
    for event in list(flight.events())[:100]:
        vio.add_frame(event) if isinstance(event, Frame) else vio.add_imu(event)
    with pytest.raises(InputError, match="ahead"):
        vio.add_frame(Frame(flight.frames[100].t_ns + 3_600_000_000_000))
    assert isinstance(vio.add_frame(flight.frames[100]), list)

"""What goes wrong around a filter: it says so, stays finite, and starts again where it was."""

from dataclasses import replace

import numpy as np
import pytest

from msckf.blocks import BIASES
from msckf.config import FilterConfig
from msckf.filter import Filter
from navcore.errors import InputError
from navcore.imu import ImuSamples
from navcore.odometry import Health
from navcore.sequence import Frame, Sequence, Tracks
from sim.points import simulate_points
from tests.msckf.flights import fly, without_imu


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


class Kidnapping:
    """A flight that goes on as another one, in another place, from one frame to the next, with the same device."""

    def __init__(self, seed: int) -> None:
        first = simulate_points(seed=seed, seconds=10.0)
        self.second = simulate_points(seed=seed + 100, seconds=8.0, moving_start=True)
        self.at_ns = first.frames[-1].t_ns + 50_000_000
        self.shift = int(self.at_ns - self.second.frames[0].t_ns)
        frames = [
            Frame(f.t_ns + self.shift, tracks={c: Tracks(t.ids + 10**6, t.uv) for c, t in f.tracks.items()})
            for f in self.second.frames
        ]
        b_g, b_a = (getattr(first.truth, b)[-1] - getattr(self.second.truth, b)[0] for b in ("b_g", "b_a"))
        a, b, begin = first.imu, self.second.imu, self.at_ns - 25_000_000
        before, after = a.t_ns < begin, b.t_ns + self.shift >= begin
        imu = ImuSamples(
            np.concatenate([a.t_ns[before], b.t_ns[after] + self.shift]),
            np.concatenate([a.gyro[before], b.gyro[after] + b_g]),
            np.concatenate([a.accel[before], b.accel[after] + b_a]),
        )
        self.sequence = replace(first, imu=imu, frames=[*first.frames, *frames], truth=None)

    def velocity_error(self, estimates) -> np.ndarray:
        """(N,) m/s, of the velocity in B; NaN without a state."""
        true = self.second.truth.at(np.array([e.t_ns - self.shift for e in estimates]))
        v_B = np.array([e.state.R_WB.T @ e.state.v_WB if e.state else np.full(3, np.nan) for e in estimates])
        return np.linalg.norm(v_B - np.einsum("nji,nj->ni", true.R_WB, true.v_WB), axis=1)


def assert_finds_itself_again(seed: int, doubt_s: float, lost_s: float) -> None:
    kidnapping = Kidnapping(seed)
    _, found = estimates(kidnapping.sequence)
    found = [e for e in found if e.t_ns >= kidnapping.at_ns]
    t, error = (np.array([e.t_ns for e in found]) - kidnapping.at_ns) * 1e-9, kidnapping.velocity_error(found)
    health = np.array([e.health.name for e in found])
    doubted, lost = int(np.argmax(health != "TRACKING")), int(np.argmax(health == "LOST"))
    assert error[doubted] > 0.5  # there is something to be found
    assert 0.0 < t[doubted] < doubt_s
    assert t[doubted] <= t[lost] < lost_s
    assert "TRACKING" not in health[doubted : lost + 1]
    assert found[lost + 1].reasons == ("started",)
    np.testing.assert_array_equal(found[lost + 1].state.p_WB, found[lost - 1].state.p_WB)
    assert set(health[lost + 1 :]) == {"TRACKING"}
    assert error[lost + 1 :].max() < 0.2
    end = found[-1].state
    true_up = kidnapping.second.truth.at(np.array([found[-1].t_ns - kidnapping.shift])).R_WB[0].T @ [0.0, 0.0, 1.0]
    assert np.linalg.norm(end.R_WB.T @ [0.0, 0.0, 1.0] - true_up) < 0.01
    assert error[-1] < 0.05


def test_after_kidnapping_it_doubts_itself_until_it_starts_again():
    assert_finds_itself_again(seed=10, doubt_s=0.8, lost_s=4.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 21))
def test_twenty_kidnappings(seed):
    assert_finds_itself_again(seed, doubt_s=0.8, lost_s=4.0)


@pytest.mark.parametrize(("moving", "seed"), [(0.4, 3), (0.7, 7)])
def test_a_crowd_in_the_view_is_no_reason_to_start_again(moving, seed):
    result = fly(simulate_points(seed=seed, seconds=12.0, moving=moving))
    started = next(k for k, e in enumerate(result.estimates) if e.state is not None)
    assert {e.health for e in result.estimates[started:]} == {Health.TRACKING}


def test_one_of_two_cameras_goes_blind_and_comes_back():
    both = simulate_points(seed=1, seconds=12.0, cameras=2)
    t_0 = both.frames[0].t_ns
    for blind in (0, 1):
        frames = [
            Frame(f.t_ns, tracks={c: tracks for c, tracks in f.tracks.items() if c != blind})
            if 4.0 < (f.t_ns - t_0) * 1e-9 < 9.0
            else f
            for f in both.frames
        ]
        vio, found = estimates(replace(both, frames=frames), cameras=2)
        assert {e.health for e in found if e.state} == {Health.TRACKING}
        assert np.mean([e.used for e in found[100:180]]) > 30
        true = both.truth.at(np.array([found[-1].t_ns]))
        v_B = vio.state.R_WB.T @ vio.state.v_WB
        assert np.linalg.norm(v_B - true.R_WB[0].T @ true.v_WB[0]) < 0.03


def test_a_stamp_from_the_far_future_is_refused(flight):
    vio = Filter(flight.calibration, FilterConfig())
    for event in list(flight.events())[:100]:
        vio.add_frame(event) if isinstance(event, Frame) else vio.add_imu(event)
    with pytest.raises(InputError, match="ahead"):
        vio.add_frame(Frame(flight.frames[100].t_ns + 3_600_000_000_000))
    assert isinstance(vio.add_frame(flight.frames[100]), list)

"""The filter as its users meet it: whatever comes, it answers, says what is wrong, and never jumps or breaks."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from msckf.blocks import POSITION
from msckf.config import FilterConfig
from msckf.filter import Filter, make
from msckf.state import FilterState
from msckf.window import VisualWindow
from navcore import so3
from navcore.calibration import Calibration
from navcore.errors import ConfigError, InputError
from navcore.imu import GRAVITY, ImuNoise, ImuSamples
from navcore.odometry import SKIPPED, Health, State, TimedState, run
from navcore.prior import load_prior
from navcore.sequence import Frame, ImageArray, ImageFile, Sequence
from sim.points import simulate_points
from tests.msckf.flights import fly, seconds, states, without_imu
from tests.msckf.scenes import RADTAN, mount

SECONDS = 12.0


@pytest.fixture(scope="module")
def flight():
    return simulate_points(seed=2, seconds=SECONDS)


@pytest.fixture(scope="module")
def clean(flight):
    return fly(flight)


@pytest.fixture(scope="module")
def brief(flight):
    """As much of the flight as shows whether two ways to the same are the same."""
    return flight.span(None, 6.0)


@pytest.fixture(scope="module")
def briefly(brief):
    return fly(brief)


def off(result, truth, at=slice(None)):
    """Distance [m] of the path from the truth, moved onto it in position and yaw at the start."""
    path = result.trajectory
    true = truth.at(path.t_ns)
    *_, z, w = Rotation.from_matrix(path.R_WB[0] @ true.R_WB[0].T).as_quat()
    turn = Rotation.from_rotvec([0.0, 0.0, 2.0 * np.arctan2(z, w)]).as_matrix()
    return np.linalg.norm(path.p_WB - path.p_WB[0] - (true.p_WB - true.p_WB[0]) @ turn.T, axis=1)[at]


def assert_finite(result):
    assert np.isfinite(states(result)).all()
    assert np.isfinite(result.covariances).all()
    for blocks in result.covariances:
        assert np.linalg.eigvalsh(blocks).min() >= -1e-12


def test_a_flight_is_followed(flight, clean):
    assert_finite(clean)
    assert len(clean.estimates) == len(flight.frames)
    assert [e.t_ns for e in clean.estimates] == [f.t_ns for f in flight.frames]
    assert clean.completeness > 0.9
    assert off(clean, flight.truth).max() < 0.05
    assert {e.health for e in clean.estimates} == {Health.INITIALISING, Health.TRACKING}
    first = next(e for e in clean.estimates if e.state is not None)
    assert first.reasons == ("started",)
    assert clean.estimates[0].reasons[0]
    assert np.mean([e.used for e in clean.estimates[-100:]]) > 10


def test_two_runs_give_the_same_bits(brief, briefly):
    np.testing.assert_array_equal(states(fly(brief)), states(briefly))


def test_sample_by_sample_gives_the_same_bits_as_chunks(brief, briefly):
    odometry, found = Filter(brief.calibration), []
    frames, k = list(brief.frames), 0
    for i in range(len(brief.imu)):
        sample = brief.imu[i : i + 1]
        while k < len(frames) and frames[k].t_ns < sample.t_ns[0]:
            found += odometry.add_frame(frames[k])
            k += 1
        found += odometry.add_imu(sample)
    found += odometry.finish()
    whole = np.array([np.concatenate([e.state.p_WB, e.state.b_a]) for e in found if e.state is not None])
    np.testing.assert_array_equal(whole, states(briefly)[:, [9, 10, 11, 18, 19, 20]])
    assert [e.reasons for e in found] == [e.reasons for e in briefly.estimates]


def test_frames_that_come_early_wait_for_the_imu(brief, briefly):
    """All frames first, then all samples: the answers are the same."""
    odometry = Filter(brief.calibration)
    assert [odometry.add_frame(frame) for frame in brief.frames] == [[]] * len(brief.frames)
    found = odometry.add_imu(brief.imu)
    assert odometry.finish() == []
    np.testing.assert_array_equal([e.state.p_WB for e in found if e.state is not None], states(briefly)[:, 9:12])


# -- vision fails -----------------------------------------------------------------------------------------------


def corrections(monkeypatch):
    """Every visual correction of the position as (stamp of the newest clone, how many sigmas squared)."""
    real, heard = FilterState.update, []

    def update(self, H, columns, r, R):
        before, P = self.p_WB, np.array(self.covariance[POSITION, POSITION])
        dx = real(self, H, columns, r, R)
        d = self.p_WB - before
        heard.append((int(self.clones.t_ns[-1]), float(d @ np.linalg.solve(P, d))))
        return dx

    monkeypatch.setattr(FilterState, "update", update)
    return heard


def blackout(seed, seconds_before, monkeypatch, length=5.0):
    end = seconds_before + length
    sequence = simulate_points(seed=seed, seconds=end + 4.0, blackouts=((seconds_before, end),))
    heard = corrections(monkeypatch)
    result = fly(sequence)
    t = seconds(sequence, result)
    assert_finite(result)
    blind = (t > seconds_before + 0.7) & (t < end)
    after = t > end + 1.0
    health = np.array([e.health.name for e in result.estimates])
    assert set(health[blind]) == {"INERTIAL_ONLY"}
    assert "no visual correction" in " ".join(result.estimates[np.flatnonzero(blind)[-1]].reasons)
    assert set(health[after]) == {"TRACKING"}
    assert "LOST" not in health
    at_return = [d for stamp, d in heard if (stamp - sequence.frames[0].t_ns) * 1e-9 > end]
    return sequence, result, np.sqrt(max(at_return[:20]))


def test_a_blackout_is_dead_reckoned_and_left_without_a_jump(monkeypatch):
    _, result, sigmas = blackout(3, 8.0, monkeypatch)
    assert sigmas < 3.0
    drift = result.sigmas[:, 1].max(axis=1)
    assert drift.max() > 10.0 * drift[100]  # it knew that it did not know


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 21))
def test_twenty_blackouts(seed, monkeypatch):
    _, _, sigmas = blackout(seed, 20.0, monkeypatch)
    assert sigmas < 3.0


def test_few_features_are_named(flight):
    frames = [replace(f, tracks={0: type(f.tracks[0])(f.tracks[0].ids[:5], f.tracks[0].uv[:5])}) for f in flight.frames]
    poor = replace(flight, frames=[*flight.frames[:160], *frames[160:200], *flight.frames[200:]])
    result = fly(poor)
    assert_finite(result)
    assert any(r == "5 features followed" for r in result.estimates[190].reasons)
    assert result.estimates[190].health is Health.INERTIAL_ONLY
    assert result.estimates[-1].health is Health.TRACKING


# -- the IMU fails ----------------------------------------------------------------------------------------------


def test_a_short_imu_gap_is_named_and_survived(flight):
    result = fly(without_imu(flight, 8.0, 8.3))
    assert_finite(result)
    t = seconds(flight, result)
    named = [k for k, e in enumerate(result.estimates) if any(r.startswith("IMU gap of") for r in e.reasons)]
    assert named
    assert all(7.95 < t[k] < 8.36 for k in named)
    assert {e.health for e in result.estimates[named[0] :]} == {Health.TRACKING}
    assert off(result, flight.truth).max() < 0.1


def stopped(sequence, start_s, end_s):
    """The recording with neither IMU nor frames for a while."""
    t_0 = sequence.frames[0].t_ns
    frames = [f for f in sequence.frames if not start_s < (f.t_ns - t_0) * 1e-9 < end_s]
    return replace(without_imu(sequence, start_s, end_s), frames=frames)


def test_half_a_second_without_anything_is_bridged(flight):
    result = fly(stopped(flight, 8.0, 8.5))
    assert_finite(result)
    assert Health.LOST not in {e.health for e in result.estimates}
    assert any(r.startswith("IMU gap of 0.49") for e in result.estimates for r in e.reasons)


def test_more_than_a_second_without_anything_is_lost_and_begun_anew_where_it_was(flight):
    result = fly(stopped(flight, 8.0, 9.5))
    assert_finite(result)
    lost = [k for k, e in enumerate(result.estimates) if e.health is Health.LOST]
    assert "cannot be bridged" in " ".join(result.estimates[lost[0]].reasons)
    assert all(result.estimates[k].state is None for k in lost)
    assert lost == list(range(lost[0], lost[-1] + 1))
    before, after = result.estimates[lost[0] - 1], result.estimates[lost[-1] + 1]
    assert (after.health, after.reasons) == (Health.TRACKING, ("started",))
    np.testing.assert_array_equal(after.state.p_WB, before.state.p_WB)
    true = flight.truth.at(np.array([before.t_ns, after.t_ns])).R_WB
    turned, really = after.state.R_WB @ before.state.R_WB.T, true[1] @ true[0].T
    off = so3.log(turned @ really.T)[2]  # by what nobody measured
    up = after.state.R_WB.T @ [0.0, 0.0, 1.0]
    P_theta = result.covariances[result.has_state[: lost[-1] + 1].sum(), 0]
    assert abs(off) < 3.0 * np.sqrt(up @ P_theta @ up)
    assert {e.health for e in result.estimates[lost[-1] + 1 :]} == {Health.TRACKING}


@pytest.mark.parametrize("back", [0, 1, 5])
def test_samples_out_of_order_are_refused_with_their_time_and_change_nothing(brief, briefly, back):
    odometry, found = Filter(brief.calibration), []
    events = list(brief.events())
    for k, event in enumerate(events):
        found += odometry.add_frame(event) if isinstance(event, Frame) else odometry.add_imu(event)
        if k in (60, 201):
            newest = max(int(e.t_ns[-1]) for e in events[: k + 1] if isinstance(e, ImuSamples))
            i = int(np.searchsorted(brief.imu.t_ns, newest)) - back
            with pytest.raises(InputError, match=str(brief.imu.t_ns[i])):
                odometry.add_imu(brief.imu[i : i + 20])
            frame = max((e for e in events[: k + 1] if isinstance(e, Frame)), key=lambda f: f.t_ns)
            with pytest.raises(InputError, match=str(frame.t_ns)):
                odometry.add_frame(frame)
            with pytest.raises(InputError, match=str(frame.t_ns - 1)):
                odometry.add_frame(Frame(frame.t_ns - 1))
    found += odometry.finish()
    np.testing.assert_array_equal([e.state.p_WB for e in found if e.state is not None], states(briefly)[:, 9:12])


def test_frames_before_and_after_the_imu_are_answered_too(flight):
    imu = flight.imu
    t = (imu.t_ns - flight.frames[0].t_ns) * 1e-9
    keep = (t > 0.52) & (t < 6.0)
    part = replace(flight, imu=ImuSamples(imu.t_ns[keep], imu.gyro[keep], imu.accel[keep]), frames=flight.frames[:140])
    result = fly(part)
    assert len(result.estimates) == 140
    assert {e.reasons for e in result.estimates[:10]} == {("no IMU yet",)}
    assert {e.health for e in result.estimates[:10]} == {Health.INITIALISING}
    assert result.estimates[119].health is Health.TRACKING
    assert {e.reasons for e in result.estimates[121:]} == {("no IMU up to this frame",)}
    assert {e.state for e in result.estimates[121:]} == {None}


def test_finish_answers_a_frame_that_lies_just_past_the_last_sample(flight):
    last = flight.frames[100]
    odometry = Filter(flight.calibration)
    odometry.add_imu(flight.imu.between(0, last.t_ns))
    for frame in flight.frames[:101]:
        odometry.add_frame(frame)
    (estimate,) = odometry.finish()
    assert estimate.t_ns == last.t_ns
    assert estimate.state is not None
    assert odometry.finish() == []


def test_nothing_in_nothing_out(flight):
    odometry = Filter(flight.calibration)
    assert odometry.finish() == []
    assert odometry.add_imu(flight.imu[0:0]) == []
    assert run(Filter(flight.calibration), replace(flight, frames=[])).estimates == ()


# -- images -----------------------------------------------------------------------------------------------------

NOISE = ImuNoise(1.7e-4, 1.9e-5, 2.0e-3, 3.0e-3, 200.0)
PERIOD = 50_000_000


def standing_rig(images):
    """A rig that stands before a wall; one image source a frame."""
    rng = np.random.default_rng(0)
    n = len(images)
    t_ns = 5_000_000 * np.arange(10 * n + 4)
    gyro = 2.4e-3 * rng.standard_normal((len(t_ns), 3))
    accel = [0.0, 0.0, GRAVITY] + 0.028 * rng.standard_normal((len(t_ns), 3))
    frames = [Frame(7_000_000 + PERIOD * k, {} if image is None else {0: image}) for k, image in enumerate(images)]
    return Sequence("wall", Calibration(NOISE, (mount(RADTAN),)), ImuSamples(t_ns, gyro, accel), frames)


def wall(k):
    """The same texture in every image, with its own sensor noise."""
    blobs = cv2.GaussianBlur(np.random.default_rng(0).standard_normal((480, 752)), (0, 0), 3.0)
    grey = 128.0 + 45.0 * blobs / blobs.std() + 2.0 * np.random.default_rng(k + 1).standard_normal(blobs.shape)
    return np.clip(grey, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def walls():
    return [ImageArray(wall(k)) for k in range(40)]


def test_an_image_that_cannot_be_used_is_skipped_and_named(walls, tmp_path):
    """Corrupt file, missing file, wrong size, no image at all: each costs one frame's features, not the run."""
    corrupt = tmp_path / "corrupt.png"
    corrupt.write_bytes(cv2.imencode(".png", wall(0))[1].tobytes()[:5000].replace(b"IHDR", b"IHDX"))
    images = list(walls)
    images[22] = ImageFile(corrupt, 752, 480)
    images[26] = ImageFile(tmp_path / "missing.png", 752, 480)
    images[30] = ImageArray(wall(0)[:, :700])
    images[34] = None
    result = fly(standing_rig(images))
    skipped = {k: r for k, e in enumerate(result.estimates) for r in e.reasons if r.startswith(SKIPPED)}
    assert sorted(skipped) == [22, 26, 30, 34]
    assert str(corrupt) in skipped[22]
    assert "missing.png" in skipped[26]
    assert "700x480" in skipped[30]
    assert "752x480" in skipped[30]
    assert "no image" in skipped[34]
    assert_finite(result)
    assert all(e.state is not None for e in result.estimates[20:])
    assert result.estimates[-1].health is Health.TRACKING
    assert np.linalg.norm(states(result)[-1, 9:12]) < 0.005


def test_standing_still_does_not_drift(walls):
    result = fly(standing_rig(walls))
    first = next(k for k, e in enumerate(result.estimates) if e.state is not None)
    assert first <= 17  # .8 s
    assert "standing still" in result.estimates[-1].reasons
    assert np.abs(states(result)[:, 9:12]).max() < 1e-3


def test_dark_images_are_named(walls):
    images = [*walls[:24], *[ImageArray(np.full((480, 752), 3, dtype=np.uint8))] * 8, *walls[32:]]
    result = fly(standing_rig(images))
    assert_finite(result)
    for k in range(24, 32):
        assert any("image dark" in r for r in result.estimates[k].reasons)
    assert not any("image dark" in r for e in result.estimates[32:] for r in e.reasons)


# -- settings ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("overrides", "match"),
    [
        ({"vision.pixel_noize": 1.0}, "pixel_noize.*pixel_noise"),
        ({"sight.fej": True}, "'sight'.*vision"),
        ({"cameras.number": 2}, "cameras"),
        ({"vision.fej": 1}, "fej.*bool"),
        ({"vision.clones": 8.5}, "clones.*int"),
        ({"vision": 3}, "vision"),
    ],
)
def test_wrong_settings_are_named(overrides, match):
    with pytest.raises(ConfigError, match=match):
        FilterConfig().with_overrides(overrides)


def test_settings_are_replaced_by_dotted_name():
    config = FilterConfig().with_overrides({"vision.pixel_noise": 2, "cameras": 2, "start.mode": "moving"})
    assert (config.vision.pixel_noise, config.cameras, config.start.mode) == (2, 2, "moving")
    assert config.vision.clones == FilterConfig().vision.clones


def test_more_cameras_than_there_are_is_an_error(flight):
    with pytest.raises(ConfigError, match="2 cameras"):
        make(flight.calibration, load_prior("none"), {"cameras": 2})
    assert make(flight.calibration, load_prior("none"), {"cameras": 1}).config.cameras == 1


# -- a start that is told ---------------------------------------------------------------------------------------


def test_a_told_start_is_begun_from(flight):
    t_ns = int(flight.imu.t_ns[1200])
    truth = flight.truth.at(np.array([t_ns]))
    P = np.diag(np.repeat([1e-6, 1e-8, 1e-4, 1e-8, 1e-6], 3))
    told = State(truth.R_WB[0], truth.p_WB[0], truth.v_WB[0], truth.b_g[0], truth.b_a[0], P)
    result = run(Filter(flight.calibration, start=TimedState(t_ns, told)), flight)
    assert_finite(result)
    first = next(e for e in result.estimates if e.state is not None)
    assert 0 <= first.t_ns - t_ns < PERIOD
    path = result.trajectory
    true = flight.truth.at(path.t_ns)
    assert np.linalg.norm(path.p_WB - true.p_WB, axis=1).max() < 0.05  # in the world of the truth, without alignment


def test_the_camera_clock_is_moved_onto_the_imus(brief, briefly):
    """Stamps that are 30 ms early and a calibration that says so give the same estimates."""
    shift = -30_000_000
    mounts = tuple(replace(m, dt_cam_imu=0.03) for m in brief.calibration.cameras)
    early = replace(
        brief,
        calibration=replace(brief.calibration, cameras=mounts),
        frames=[replace(f, t_ns=f.t_ns + shift) for f in brief.frames],
    )
    result = fly(early)
    assert [e.t_ns for e in result.estimates] == [f.t_ns for f in brief.frames]
    np.testing.assert_array_equal(states(result), states(briefly))


def test_a_numerical_failure_is_a_loss_not_an_end(flight, monkeypatch):
    real, calls = VisualWindow.advance, []

    def fails_once(self, *arguments):
        calls.append(1)
        if len(calls) == 60:
            raise np.linalg.LinAlgError("Singular matrix")
        return real(self, *arguments)

    monkeypatch.setattr(VisualWindow, "advance", fails_once)
    result = fly(flight)
    lost = [e for e in result.estimates if e.health is Health.LOST]
    assert any("numerical failure" in reason for reason in lost[0].reasons)
    assert result.estimates[-1].health is Health.TRACKING

import time
from collections import defaultdict

import numpy as np
import pytest

from navcore.sequence import Sequence
from sim import simulate_motion, simulate_points
from sim.degrade.effects import effect
from sim.degrade.schedule import KINDS, STREAM
from sim.errors import ConfigError
from sim.imu import GRADES
from sim.motion import Motion
from sim.platforms import PLATFORMS
from sim.world import SCENES


@pytest.fixture(scope="module")
def exact(flight: Motion) -> Sequence:
    return simulate_points(seed=3, motion=flight, pixel_noise=0.0, noisy_imu=False, cameras=2)


def test_exact_tracks_meet_in_one_point_each(flight: Motion, exact: Sequence) -> None:
    """Landmarks triangulated from the true poses reproject to where they were seen, in both cameras."""
    poses = flight.at(np.array([f.t_ns for f in exact.frames]))
    rays = defaultdict(list)
    for R_WB, p_WB, frame in zip(poses.R_WB, poses.p_WB, exact.frames, strict=True):
        for index, mount in enumerate(exact.calibration.cameras):
            d = mount.camera.unproject(frame.tracks[index].uv) @ (R_WB @ mount.R_BC).T
            for i, ray in zip(frame.tracks[index].ids.tolist(), d, strict=True):
                rays[i].append((R_WB @ mount.p_BC + p_WB, ray))
    long = [np.array(r) for r in rays.values() if len(r) > 60]
    assert len(long) > 50
    for r in long:
        centres, d = r[:, 0], r[:, 1]
        A = np.eye(3) - d[:, :, None] * d[:, None, :]
        point = np.linalg.solve(A.sum(axis=0), (A @ centres[..., None]).sum(axis=0)[:, 0])
        towards = point - centres
        miss = np.linalg.norm(np.cross(d, towards / np.linalg.norm(towards, axis=1, keepdims=True)), axis=1)
        assert miss.max() * 458.0 < 1e-5  # px


def test_frames_are_full_spread_and_in_time_with_the_imu(exact: Sequence) -> None:
    counts = [len(f.tracks[0]) for f in exact.frames]
    assert np.median(counts) > 120
    assert max(counts) <= 150
    uv = np.concatenate([f.tracks[0].uv for f in exact.frames[160:260:20]])
    grid = np.histogram2d(*uv.T, bins=(4, 3), range=((0, 752), (0, 480)))[0] / 5.0
    assert grid.min() >= 3
    assert np.diff([f.t_ns for f in exact.frames]).tolist() == [50_000_000] * (len(exact.frames) - 1)
    assert exact.imu.t_ns[0] < exact.frames[0].t_ns < exact.frames[-1].t_ns < exact.imu.t_ns[-1]


def test_ids_are_never_reused_after_a_gap(exact: Sequence) -> None:
    seen: dict[int, int] = {}
    for k, frame in enumerate(exact.frames):
        for i in frame.tracks[0].ids.tolist():
            assert seen.get(i, k - 1) == k - 1
            seen[i] = k


def test_pixel_noise_is_white_with_its_size(flight: Motion) -> None:
    clean, noisy = (simulate_points(seed=3, motion=flight, pixel_noise=s) for s in (0.0, 1.5))
    errors = []
    for a, b in zip(clean.frames, noisy.frames, strict=True):
        np.testing.assert_array_equal(a.tracks[0].ids, b.tracks[0].ids)
        errors.append(b.tracks[0].uv - a.tracks[0].uv)
    e = np.concatenate(errors)
    assert np.std(e) == pytest.approx(1.5, rel=4.0 / np.sqrt(2 * e.size))
    assert np.abs(e.mean(axis=0)).max() < 4.0 * 1.5 / np.sqrt(len(e))


def test_tracks_live_as_long_as_asked(flight: Motion) -> None:
    lives = {}
    for life in (0.3, 30.0):
        count: dict[int, int] = defaultdict(int)
        for frame in simulate_points(seed=3, motion=flight, track_life_s=life).frames:
            for i in frame.tracks[0].ids.tolist():
                count[i] += 1
        lives[life] = 0.05 * float(np.mean(list(count.values())))
    assert lives[0.3] == pytest.approx(0.3, rel=0.25)
    assert lives[30.0] > 3.0 * lives[0.3]


def test_nothing_is_seen_in_a_blackout_and_all_is_new_after_it(flight: Motion) -> None:
    sequence = simulate_points(seed=3, motion=flight, blackouts=((5.0, 7.0),))
    counts = np.array([len(f.tracks[0]) for f in sequence.frames])
    assert np.all(counts[100:140] == 0)
    assert counts[99] > 100 and counts[140] > 100
    before = set(sequence.frames[99].tracks[0].ids.tolist())
    assert before.isdisjoint(sequence.frames[140].tracks[0].ids.tolist())
    same = simulate_points(seed=3, motion=flight, degrade="blackout@5-7")
    np.testing.assert_array_equal(same.frames[200].tracks[0].uv, sequence.frames[200].tracks[0].uv)


def test_degraded_vision_leaves_fewer_or_shorter_or_noisier_tracks(flight: Motion) -> None:
    foggy = simulate_points(seed=3, motion=flight, degrade="fog:5@5-10")
    assert np.mean([len(f.tracks[0]) for f in foggy.frames[110:190]]) < 80
    compressed = simulate_points(seed=3, motion=flight, degrade="jpeg:5@5-10")
    clean = simulate_points(seed=3, motion=flight)
    after_a_second = []
    for sequence in (compressed, clean):
        a, b = (set(sequence.frames[k].tracks[0].ids.tolist()) for k in (130, 150))
        after_a_second.append(len(a & b))
    assert after_a_second[0] < 0.5 * after_a_second[1]


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in STREAM])
def test_every_kind_does_more_at_a_higher_severity(kind: str) -> None:
    """The number of tracks that live for a second and are right never grows."""
    lasting = []
    for severity in range(1, 6):
        e = effect(kind, severity)
        right = (1.0 - e.outliers) * (1.0 - e.moving)
        lasting.append(e.features * right * np.exp(-1.0 / (3.0 * e.life)))
        assert e.noise >= 1.0
    assert lasting == sorted(lasting, reverse=True)


def test_another_noise_seed_keeps_path_and_world() -> None:
    one, other, again, third = (simulate_points(seconds=3.0, seed=5, noise_seed=n) for n in (None, 1, 1, 2))
    assert one.truth is not None and other.truth is not None
    np.testing.assert_array_equal(one.truth.p_WB, other.truth.p_WB)
    assert np.abs(one.imu.gyro - other.imu.gyro).max() > 1e-3
    assert np.abs(third.imu.gyro - other.imu.gyro).max() > 1e-3
    np.testing.assert_array_equal(other.imu.accel, again.imu.accel)
    np.testing.assert_array_equal(other.frames[-1].tracks[0].uv, again.frames[-1].tracks[0].uv)


def test_bad_requests_are_refused(flight: Motion) -> None:
    with pytest.raises(ConfigError, match="3 cameras were asked for"):
        simulate_points(motion=flight, cameras=3)
    with pytest.raises(ConfigError, match="must be above zero"):
        simulate_points(motion=flight, max_features=0)
    with pytest.raises(ConfigError, match="too short for one frame"):
        simulate_points(motion=flight.after(19.95))


def test_bad_requests_end_before_anything_is_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.points.flight", None)
    with pytest.raises(ConfigError, match="beyond the recording"):
        simulate_points(seconds=10.0, degrade="blackout@12-14")
    with pytest.raises(ConfigError, match="known are"):
        simulate_points(imu="toy")
    with pytest.raises(ConfigError, match="known are"):
        simulate_points(degrade="rain:3@1-2")


def test_frames_are_lost_and_stamps_move_as_with_images(flight: Motion) -> None:
    clean, lossy = (simulate_points(seed=3, motion=flight, degrade=d) for d in ("", "frame_drops:3@5-15"))
    kept = {f.t_ns: f for f in lossy.frames}
    assert 250 < len(kept) < 360
    for frame in clean.frames:
        if frame.t_ns in kept:
            np.testing.assert_array_equal(kept[frame.t_ns].tracks[0].uv, frame.tracks[0].uv)
    late = simulate_points(seed=3, motion=flight, degrade="time_offset:5@5-10")
    moved = np.array([b.t_ns - a.t_ns for a, b in zip(clean.frames, late.frames, strict=True)])
    assert moved[:100].max() == 0 and moved[110] == 40_000_000


@pytest.mark.parametrize("platform", sorted(PLATFORMS))
@pytest.mark.parametrize("difficulty", ["easy", "difficult"])
def test_every_platform_has_features_and_its_truth(platform: str, difficulty: str) -> None:
    sequence = simulate_points(platform, 4.0, 2, moving_start=True, difficulty=difficulty)
    assert np.median([len(f.tracks[0]) for f in sequence.frames]) > 100
    assert sequence.truth is not None and sequence.truth.b_a is not None
    assert len(sequence.truth) == len(sequence.imu) == 800


@pytest.mark.parametrize("scene", sorted(SCENES))
def test_every_scene_has_features(flight: Motion, scene: str) -> None:
    counts = [len(f.tracks[0]) for f in simulate_points(seed=3, motion=flight, scene=scene).frames]
    assert np.median(counts) > 60


@pytest.mark.parametrize("imu", sorted(GRADES))
def test_every_grade_writes_its_noise_into_the_calibration(flight: Motion, imu: str) -> None:
    sequence = simulate_points(seed=3, motion=flight.after(19.0), imu=imu)
    assert sequence.calibration.imu == GRADES[imu].noise
    same = simulate_points(seed=3, motion=flight.after(19.0), imu=imu)
    np.testing.assert_array_equal(sequence.imu.accel, same.imu.accel)
    skewed = simulate_points(seed=3, motion=flight.after(19.0), imu=f"{imu}-uncalibrated")
    assert np.abs(skewed.imu.accel - sequence.imu.accel).max() > 1e-4
    np.testing.assert_array_equal(skewed.frames[5].tracks[0].uv, sequence.frames[5].tracks[0].uv)


@pytest.mark.bench
@pytest.mark.parametrize("what", [{}, {"outliers": 0.2}, {"moving": 0.3}, {"cameras": 2}], ids=str)
def test_tracks_and_imu_come_a_hundred_times_faster_than_real_time(what: dict[str, float]) -> None:
    motion = simulate_motion()
    start = time.process_time()
    simulate_points(motion=motion, **what)  # type: ignore[arg-type]
    assert time.process_time() - start < 0.6

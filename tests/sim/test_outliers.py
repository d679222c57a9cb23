"""Mismatches and moving objects in points mode, told from landmarks by where they are seen."""

from collections import defaultdict
from itertools import pairwise

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from navcore.calibration import CameraMount
from navcore.sequence import Sequence
from sim import simulate_points
from sim.degrade import Schedule
from sim.degrade.effects import EFFECTS, Effect
from sim.errors import ConfigError
from sim.motion import Motion
from sim.points.seeing import Seeing
from sim.points.tracks import LANDMARKS
from sim.streams import Streams
from sim.world import make_layout

SEED = 3
SHARE = 0.2


def projections(mount: CameraMount, R_WB: np.ndarray, p_WB: np.ndarray, p_WF: np.ndarray) -> np.ndarray:
    """Pixels by OpenCV; nan behind the camera and far outside."""
    R_CW = (R_WB @ mount.R_BC).T
    t = -R_CW @ (p_WB + R_WB @ mount.p_BC)
    p_CF = p_WF @ R_CW.T + t
    K = np.array([[mount.camera.fx, 0, mount.camera.cx], [0, mount.camera.fy, mount.camera.cy], [0, 0, 1]])
    uv = cv2.projectPoints(p_WF, cv2.Rodrigues(R_CW)[0], t, K, np.array(mount.camera.distortion))[0][:, 0]
    return np.where((p_CF[:, 2:] > 0.1) & (np.abs(p_CF[:, :2]) < 2.0 * p_CF[:, 2:]).all(axis=1, keepdims=True), uv, 1e6)


def points_seen(sequence: Sequence, flight: Motion) -> list[dict[int, tuple[int, np.ndarray]]]:
    """By frame: of every feature the landmark that is where it was seen, -1 if there is none, and the pixel."""
    world = Streams.of(SEED).world
    p_WF, _ = make_layout("room", flight.p_WB, world).landmarks(LANDMARKS, world)
    (mount,) = sequence.calibration.cameras
    poses = flight.at(np.array([f.t_ns for f in sequence.frames]))
    found = []
    for R_WB, p_WB, frame in zip(poses.R_WB, poses.p_WB, sequence.frames, strict=True):
        miss, which = cKDTree(projections(mount, R_WB, p_WB, p_WF)).query(frame.tracks[0].uv)
        which = np.where(miss < 1e-4, which, -1)
        features = zip(frame.tracks[0].ids.tolist(), which.tolist(), frame.tracks[0].uv, strict=True)
        found.append({i: (w, uv) for i, w, uv in features})
    return found


def test_without_outliers_every_feature_stays_on_its_landmark(flight: Motion) -> None:
    first: dict[int, int] = {}
    for frame in points_seen(simulate_points(seed=SEED, motion=flight, pixel_noise=0.0), flight):
        for i, (which, _) in frame.items():
            assert which >= 0
            assert first.setdefault(i, which) == which


def test_a_share_of_features_jumps_to_other_landmarks_nearby(flight: Motion) -> None:
    sequence = simulate_points(seed=SEED, motion=flight, pixel_noise=0.0, outliers=SHARE)
    first: dict[int, int] = {}
    last: dict[int, tuple[int, np.ndarray]] = {}
    shares, jumps = [], []
    for frame in points_seen(sequence, flight):
        wrong = [first.setdefault(i, which) != which for i, (which, _) in frame.items()]
        shares.append(np.mean(wrong))
        both = [(last[i], now) for i, now in frame.items() if i in last]
        jumps += [np.linalg.norm(now[1] - before[1]) for before, now in both if before[0] != now[0]]
        last = frame
    assert min(which for frame in points_seen(sequence, flight) for which, _ in frame.values()) >= 0
    assert np.mean(shares[10:]) == pytest.approx(SHARE, abs=0.02)
    assert np.std(shares[10:]) < 0.05
    assert 20.0 < np.median(jumps) < 80.0  # a cell of the image is 94 by 96 px
    assert len(jumps) / np.sum([s * 150 for s in shares]) == pytest.approx(0.05 / 0.3, rel=0.35)


def stereo_positions(sequence: Sequence, flight: Motion) -> list[dict[int, np.ndarray]]:
    """By frame, p_WF of every feature that both cameras saw: the middle of the two rays' shortest link."""
    poses = flight.at(np.array([f.t_ns for f in sequence.frames]))
    found = []
    for R_WB, p_WB, frame in zip(poses.R_WB, poses.p_WB, sequence.frames, strict=True):
        ids, *rows = np.intersect1d(frame.tracks[0].ids, frame.tracks[1].ids, return_indices=True)
        rays, centres = [], []
        for mount, tracks, row in zip(sequence.calibration.cameras, frame.tracks.values(), rows, strict=True):
            rays.append(mount.camera.unproject(tracks.uv[row]) @ (R_WB @ mount.R_BC).T)
            centres.append(p_WB + R_WB @ mount.p_BC)
        A = sum(np.eye(3) - d[:, :, None] * d[:, None, :] for d in rays)
        b = sum(c - d * (d @ c)[:, None] for d, c in zip(rays, centres, strict=True))
        found.append(dict(zip(ids.tolist(), np.linalg.solve(A, b[..., None])[..., 0], strict=True)))
    return found


@pytest.fixture(scope="module")
def crowded(flight: Motion) -> list[dict[int, np.ndarray]]:
    return stereo_positions(simulate_points(seed=SEED, motion=flight, pixel_noise=0.0, cameras=2, moving=0.5), flight)


def test_half_of_the_features_move_and_the_others_stand_still(crowded: list[dict[int, np.ndarray]]) -> None:
    steps = [np.linalg.norm(b[i] - a[i]) for a, b in pairwise(crowded) for i in a.keys() & b.keys()]
    moving = np.array(steps) > 1e-4
    assert np.mean(moving) == pytest.approx(0.5, abs=0.08)
    assert np.array(steps)[~moving].max() < 1e-6
    assert np.array(steps)[moving].max() < 0.05 * 5.0  # m in a frame: 5 m/s, turning included


def test_what_moves_is_rigid_smooth_and_near(flight: Motion, crowded: list[dict[int, np.ndarray]]) -> None:
    ratios, accelerations, depths = [], [], []
    places = flight.at(flight.start_ns + np.rint((0.1013 + 0.05 * np.arange(len(crowded))) * 1e9).astype(np.int64)).p_WB
    for k in range(0, len(crowded) - 2, 5):
        a, b, c = crowded[k : k + 3]
        ids = [i for i in a.keys() & b.keys() & c.keys() if np.linalg.norm(b[i] - a[i]) > 1e-4]
        if len(ids) < 2:
            continue
        A, B, C = (np.array([x[i] for i in ids]) for x in (a, b, c))
        accelerations.append(np.linalg.norm(A - 2.0 * B + C, axis=1) / 0.05**2)
        depths.append(np.linalg.norm(A - places[k], axis=1))
        pairs = np.array(list(cKDTree(A).query_pairs(0.12)))
        if len(pairs):
            before, after = (np.linalg.norm(X[pairs[:, 0]] - X[pairs[:, 1]], axis=1) for X in (A, C))
            ratios.append(np.abs(after - before))
    assert np.mean(np.concatenate(ratios) < 1e-5) > 0.97  # the others are on two objects that touch
    assert np.concatenate(accelerations).max() < 12.0
    assert 0.3 < np.median(np.concatenate(depths)) < 4.0


def test_objects_are_several_and_are_replaced(flight: Motion) -> None:
    ids: dict[int, list[int]] = defaultdict(list)
    sequence = simulate_points(seed=SEED, motion=flight, pixel_noise=0.0, moving=0.9)
    for k, frame in enumerate(points_seen(sequence, flight)):
        for i, (which, _) in frame.items():
            if which < 0:
                ids[i].append(k)
    counts = np.bincount(np.concatenate([np.array(frames) for frames in ids.values()]), minlength=len(sequence.frames))
    assert np.median(counts) > 0.7 * 0.9 * 150
    assert np.percentile(counts, 2) > 20
    assert all(np.all(np.diff(frames) == 1) for frames in ids.values())
    assert max(len(frames) for frames in ids.values()) < 20 * 8.5


def test_degradations_add_mismatches_and_moving_things() -> None:
    clean, half = Seeing(outliers=0.2, moving=0.1), Effect(outliers=0.5, moving=0.5)
    schedule = Schedule.parse("low_light:1@5-10")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EFFECTS, "low_light", (half,) * 5)
        during, after = clean.degraded(schedule, 5.0), clean.degraded(schedule, 10.0)
    assert during is not None and after is not None
    assert after.outliers == pytest.approx(0.2)
    assert during.outliers == pytest.approx(0.6)
    assert during.moving == pytest.approx(0.55)


def test_noise_of_the_imu_and_of_landmarks_does_not_depend_on_what_moves(flight: Motion) -> None:
    plain, crowded = (simulate_points(seed=SEED, motion=flight, moving=share) for share in (0.0, 0.3))
    np.testing.assert_array_equal(plain.imu.gyro, crowded.imu.gyro)


def test_bad_shares_are_refused(flight: Motion) -> None:
    with pytest.raises(ConfigError, match="shares from 0 to 1"):
        simulate_points(motion=flight, outliers=1.2)
    with pytest.raises(ConfigError, match="shares from 0 to 1"):
        simulate_points(motion=flight, moving=-0.1)

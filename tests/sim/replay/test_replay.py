from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from navcore.errors import DataError
from navcore.readers import open_sequence
from navcore.sequence import Frame, Sequence
from sim.errors import ConfigError
from sim.motion import Motion
from sim.points.tracks import LANDMARKS
from sim.replay import SmoothedTruth, replayed, smooth_truth
from sim.replay.figures import figures
from sim.replay.replay import frame_stamps
from sim.replay.stamps import open_recording, read_stamps
from sim.streams import Streams
from sim.world import make_layout
from tests.sim.replay.flights import spoil

LAG_S = 0.012


@pytest.fixture(scope="module")
def recording(flight: Motion) -> Sequence:
    """A spoilt flight whose camera's clock is 12 ms early, and whose first frames come before truth."""
    spoilt = spoil(flight, gap_s=(8.0, 9.0)).recording
    calibration = spoilt.calibration
    mounts = tuple(replace(mount, dt_cam_imu=LAG_S) for mount in calibration.cameras)
    stamps = flight.start_ns + np.arange(0, 20_000_000_000, 50_000_000)
    frames = tuple(Frame(t) for t in stamps.tolist())
    return replace(spoilt, calibration=replace(calibration, cameras=mounts), frames=frames)


@pytest.fixture(scope="module")
def path(recording: Sequence) -> SmoothedTruth:
    return smooth_truth(recording)


@pytest.fixture
def smoothed(path: SmoothedTruth, monkeypatch: pytest.MonkeyPatch) -> SmoothedTruth:
    """The path, which `replayed` need not find again."""
    monkeypatch.setattr("sim.replay.replay.smooth_truth", lambda _: path)
    return path


def test_the_gyro_and_the_path_agree_to_a_tenth_of_a_pixel(recording: Sequence, path: SmoothedTruth) -> None:
    stamps, _ = frame_stamps(recording, None, path)
    found = figures(recording, path, stamps)
    assert found.frame_px_max < 0.1
    assert found.bridged_s == pytest.approx(1.0, abs=0.02)
    assert found.left_out_s == 0.0
    assert found.reckoning_m is not None
    assert 0.001 < found.reckoning_m < 0.1  # white noise alone makes 0.013 m an axis of it


def test_it_keeps_the_imu_and_stamps_frames_in_its_time(opengl: None, recording: Sequence) -> None:
    with replayed(recording, cameras=2) as sequence:
        assert sequence.imu is recording.imu
        stamps = np.array([f.t_ns for f in sequence.frames])
        assert sequence.calibration.imu == recording.calibration.imu
        for mount, real in zip(sequence.calibration.cameras, recording.calibration.cameras, strict=True):
            assert mount.camera == real.camera
            assert mount.dt_cam_imu == 0.0
            np.testing.assert_array_equal(mount.T_BC, real.T_BC)
        assert sequence.truth is not None
        assert "frame(s) left out" in "\n".join(sequence.notes)
    wanted = [f.t_ns + 12_000_000 for f in recording.frames]
    assert set(stamps.tolist()) < set(wanted)
    assert len(stamps) >= len(wanted) - 4


@pytest.mark.usefixtures("opengl", "smoothed")
def test_a_part_begins_and_ends_where_it_is_asked_to(recording: Sequence) -> None:
    with replayed(recording, start_s=5.0, end_s=6.0) as sequence:
        stamps = np.array([f.t_ns for f in sequence.frames])
        assert len(stamps) == 21
        assert 0.0 <= (stamps[0] - sequence.imu.t_ns[0]) * 1e-9 <= 0.1


def test_rendered_flow_is_that_of_the_path(opengl: None, recording: Sequence, smoothed: SmoothedTruth) -> None:
    """OpenCV's corners and their flow, against the scene's geometry seen from the path."""
    with replayed(recording, start_s=12.0, end_s=12.2, seed=3) as sequence:
        images = [f.images[0].load() for f in sequence.frames[:2]]
        truth, mount = sequence.truth, sequence.calibration.cameras[0]
        stamps = np.array([f.t_ns for f in sequence.frames[:2]])
    assert truth is not None
    states = truth.at(stamps)
    corners = cv2.goodFeaturesToTrack(images[0], 150, 0.02, 15)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(images[0], images[1], corners, None, winSize=(21, 21), maxLevel=4)
    before, after = corners[:, 0].astype(np.float64), moved[:, 0].astype(np.float64)
    poses = []
    for R_WB, p_WB in zip(states.R_WB, states.p_WB, strict=True):
        poses.append((R_WB @ mount.R_BC, p_WB + R_WB @ mount.p_BC))
    layout = make_layout("room", smoothed.motion.p_WB, Streams.of(3).world)
    (R_0, p_0), (R_1, p_1) = poses
    rays = mount.camera.unproject(before) @ R_0.T
    start = np.tile(p_0, (len(rays), 1))
    points = start + layout.distance(start, rays)[:, None] * rays
    expected = mount.camera.project((points - p_1) @ R_1)
    error = np.linalg.norm(after - expected, axis=1)[status[:, 0] == 1]
    assert len(error) > 60
    assert np.median(np.linalg.norm(after - before, axis=1)) > 2.0
    assert np.median(error) < 0.15


@pytest.mark.usefixtures("opengl", "smoothed")
def test_the_same_request_gives_the_same_image(recording: Sequence) -> None:
    images = []
    for _ in range(2):
        with replayed(recording, start_s=3.0, end_s=3.1, degrade="low_light:3@0-0.1") as sequence:
            images.append(sequence.frames[1].images[0].load())
    np.testing.assert_array_equal(images[0], images[1])


def test_landmarks_are_seen_from_the_path_without_images(recording: Sequence, smoothed: SmoothedTruth) -> None:
    with replayed(recording, mode="points", start_s=12.0, end_s=14.0, degrade="blackout@1-1.5", seed=3) as sequence:
        truth, mount = sequence.truth, sequence.calibration.cameras[0]
        seen = [f.tracks[0] for f in sequence.frames]
        stamps = np.array([f.t_ns for f in sequence.frames])
    assert [len(s) > 0 for s in seen] == [True] * 20 + [False] * 10 + [True] * 11
    assert truth is not None
    world, states = Streams.of(3).world, truth.at(stamps)
    points, _ = make_layout("room", smoothed.motion.p_WB, world).landmarks(LANDMARKS, world)
    for k in (0, 10, 40):
        R_WC = states.R_WB[k] @ mount.R_BC
        p_CF = (points - states.p_WB[k] - states.R_WB[k] @ mount.p_BC) @ R_WC
        uv = mount.camera.project(p_CF[mount.camera.unfolded(p_CF)])
        off = np.linalg.norm(seen[k].uv[:, None] - uv, axis=2).min(axis=1)
        assert len(off) > 100
        assert np.median(off) < 1.3  # 1 px of noise an axis: 1.18


def test_a_bad_request_ends_before_work_begins(recording: Sequence, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError("smoothing began")

    monkeypatch.setattr("sim.replay.replay.smooth_truth", never)
    for wrong, match in (
        ({"cameras": 3}, "3 cameras were asked for"),
        ({"scene": "sea"}, "scene 'sea' is unknown"),
        ({"degrade": "gloom:1@0-1"}, "'gloom' is unknown"),
        ({"seed": -1}, "seeds are"),
        ({"mode": "imu"}, "mode 'imu' is unknown"),
        ({"mode": "points", "movers": 1}, "need images"),
    ):
        with pytest.raises(ConfigError, match=match), replayed(recording, **wrong):  # type: ignore[arg-type]
            pass


@pytest.mark.usefixtures("opengl", "smoothed")
def test_a_part_without_frames_says_where_they_end(recording: Sequence) -> None:
    with pytest.raises(DataError, match="frames end at"), replayed(recording, start_s=50.0):
        pass


def test_listed_stamps_take_the_place_of_images(tmp_path: Path) -> None:
    path = tmp_path / "timestamps_ns.txt"
    path.write_text("10\n20\n\n35\n")
    assert read_stamps(path).tolist() == [10, 20, 35]
    for text in ("10\n10\n", "10\nten\n"):
        path.write_text(text)
        with pytest.raises(DataError, match=r"timestamps_ns\.txt:2"):
            read_stamps(path)


def _real(vio_data: Path) -> list[Path]:
    return sorted(p for p in vio_data.glob("*/*") if (p / "mav0").is_dir())


@pytest.mark.slow
def test_every_real_recording_agrees_with_its_gyro_to_a_tenth_of_a_pixel(vio_data: Path) -> None:
    for folder in _real(vio_data):
        recording, listed = open_recording(folder)
        path = smooth_truth(recording)
        stamps, _ = frame_stamps(recording, listed, path)
        found = figures(recording, path, stamps)
        assert found.frame_px_max < 0.1, folder.name
        assert found.left_out_s == 0.0, folder.name
        assert found.force_slow < 0.03, folder.name


@pytest.mark.slow
def test_a_gap_cut_into_motion_capture_is_bridged_to_a_centimetre(vio_data: Path) -> None:
    recording = open_sequence(vio_data / "tumvi" / "dataset-room5_512_16")
    whole = smooth_truth(recording)
    assert recording.truth is not None
    t_ns = recording.truth.t_ns
    low = t_ns[0] + 60_000_000_000
    cut = replace(recording, truth=recording.truth[(t_ns < low) | (t_ns > low + 2_500_000_000)])
    bridged = smooth_truth(cut)
    stamps = np.arange(low, low + 2_500_000_000, 10_000_000)
    error = np.linalg.norm(bridged.motion.at(stamps).p_WB - whole.motion.at(stamps).p_WB, axis=1)
    assert bridged.known(stamps).all()
    assert error.max() < 0.01

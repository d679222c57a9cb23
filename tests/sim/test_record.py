from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from navcore.readers import open_sequence
from navcore.sequence import Sequence
from sim import simulate_points
from sim.camera import gl
from sim.errors import ConfigError, RenderError
from sim.record import felt, record
from tests.sim.output.recordings import assert_same, digest


@pytest.fixture(scope="module")
def rendered(opengl: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("rendered") / "flight"
    counts: list[tuple[int, int]] = []
    progress = lambda done, total: counts.append((done, total))  # noqa: E731
    record("quadrotor", 0.5, 4, out, degrade="blackout@0.2-0.3", moving_start=True, progress=progress)
    assert counts == [(k, 8) for k in range(1, 9)]
    return out


def test_a_rendered_recording_reads_back(rendered: Path) -> None:
    sequence = open_sequence(rendered)
    expected = simulate_points(seconds=0.5, seed=4, moving_start=True)
    np.testing.assert_array_equal(sequence.imu.t_ns, expected.imu.t_ns)
    np.testing.assert_array_equal(sequence.imu.accel, expected.imu.accel)
    assert sequence.truth is not None and expected.truth is not None
    assert sequence.truth.b_g is not None and expected.truth.b_g is not None
    np.testing.assert_array_equal(sequence.truth.p_WB, expected.truth.p_WB)
    np.testing.assert_array_equal(sequence.truth.q_WB, expected.truth.q_WB)
    np.testing.assert_array_equal(sequence.truth.b_g, expected.truth.b_g)
    assert [f.t_ns for f in sequence.frames] == [f.t_ns for f in expected.frames]
    assert sequence.calibration.imu == expected.calibration.imu
    mount, wanted = sequence.calibration.cameras[0], expected.calibration.cameras[0]
    assert mount.camera == wanted.camera
    np.testing.assert_array_equal(mount.T_BC, wanted.T_BC)
    assert sequence.notes == ()


def test_its_images_are_bright_but_in_the_blackout(rendered: Path) -> None:
    means = np.array([frame.images[0].load().mean() for frame in open_sequence(rendered).frames])
    dark = np.array([False] * 4 + [True] * 2 + [False] * 2)
    assert means[dark].max() < 40 < 60 < means[~dark].min()


def test_the_same_arguments_give_the_same_bytes(rendered: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    record("quadrotor", 0.5, 4, again, degrade="blackout@0.2-0.3", moving_start=True)
    assert digest(again) == digest(rendered)


def test_a_degradation_changes_no_other_frame(rendered: Path, tmp_path: Path) -> None:
    clean = tmp_path / "clean"
    record("quadrotor", 0.5, 4, clean, moving_start=True)
    one, other = digest(rendered / "mav0"), digest(clean / "mav0")
    changed = [name for name in one if one[name] != other[name]]
    assert len(changed) == 2
    assert all("/data/17" in name for name in changed)


def test_points_read_back_with_the_frames_of_a_blackout(tmp_path: Path) -> None:
    out = tmp_path / "points"
    record("quadrotor", 2.0, 4, out, degrade="blackout@1-1.2", mode="points", moving_start=True, cameras=2)
    sequence = open_sequence(out)
    expected = simulate_points(seconds=2.0, seed=4, moving_start=True, degrade="blackout@1-1.2", cameras=2)
    assert len(sequence.frames) == len(expected.frames)
    assert min(len(f.tracks[0]) for f in sequence.frames) == 0
    for got, want in zip(sequence.frames, expected.frames, strict=True):
        for index in (0, 1):
            assert sorted(got.tracks[index].ids.tolist()) == sorted(want.tracks[index].ids.tolist())
    got, want = sequence.frames[3].tracks[1], expected.frames[3].tracks[1]
    np.testing.assert_allclose(got.uv[np.argsort(got.ids)], want.uv[np.argsort(want.ids)], atol=1e-6)


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(ConfigError, match="is there already"):
        record("quadrotor", 1.0, 1, tmp_path, mode="points")
    assert [x.name for x in tmp_path.iterdir()] == ["mine.txt"]


def test_a_failure_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RenderError("no light")

    monkeypatch.setattr("sim.camera.film.Film.image", broken)
    with pytest.raises(RenderError):
        record("quadrotor", 0.3, 1, tmp_path / "a" / "flight")
    with pytest.raises(ConfigError):
        record("quadrotor", 0.3, 1, tmp_path / "a" / "flight", degrade="fog:6@0-0.2")
    assert not any((tmp_path / "a").iterdir())


def test_images_are_grey_png_of_the_cameras_size(rendered: Path) -> None:
    first = sorted((rendered / "mav0" / "cam0" / "data").iterdir())[0]
    image = cv2.imread(str(first), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert image.shape == (480, 752)
    assert image.dtype == np.uint8


def test_a_bag_has_the_images_of_the_folder(rendered: Path, tmp_path: Path) -> None:
    arguments = {"degrade": "blackout@0.2-0.3", "moving_start": True}
    record("quadrotor", 0.5, 4, tmp_path / "bag", format="ros1", **arguments)
    assert_same(open_sequence(tmp_path / "bag"), open_sequence(rendered))


def test_without_vision_there_are_the_same_imu_and_truth_and_nothing_else(tmp_path: Path) -> None:
    record("quadrotor", 1.0, 4, tmp_path / "out", mode="imu", moving_start=True)
    read = open_sequence(tmp_path / "out")
    assert_same(read, felt(seconds=1.0, seed=4, moving_start=True))
    assert (read.frames, read.calibration.cameras) == ((), ())
    points = simulate_points(seconds=1.0, seed=4, moving_start=True)
    np.testing.assert_array_equal(read.imu.gyro, points.imu.gyro)
    assert {x.name for x in (tmp_path / "out" / "mav0").iterdir()} == {"imu0", "state_groundtruth_estimate0"}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"degrade": "low_light:3@4-9"}, "low_light:3@4-9 reaches beyond the recording"),
        ({"degrade": "low_light:6@0-1"}, "severity of low_light is 6, expected 1 to 5"),
        ({"degrade": "rain:1@0-1"}, "'rain' is unknown; known are blackout, "),
        ({"format": "bag"}, "'bag' is unknown; known are asl, ros1, ros2"),
        ({"mode": "sound"}, "'sound' is unknown; known are images, points, imu"),
        ({"mode": "points", "format": "ros1"}, "tracks cannot be written as ros1.*; expected asl"),
        ({"mode": "imu", "degrade": "blackout@0-1"}, "without vision cannot be degraded"),
        ({"cameras": 3}, "3 cameras were asked for"),
        ({"imu": "perfect"}, "'perfect' is unknown; known are "),
        ({"platform": "boat"}, "'boat' is unknown; known are "),
        ({"difficulty": "hard"}, "'hard' is unknown; known are easy, medium, difficult"),
        ({"scene": "moon"}, "'moon' is unknown; known are "),
    ],
)
def test_a_bad_request_ends_with_the_valid_choices_before_work_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: dict[str, str], says: str
) -> None:
    def worked(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr("sim.record.gl.make_context", lambda *_: SimpleNamespace(free=lambda: None))
    monkeypatch.setattr("sim.record.make_scene", worked)
    monkeypatch.setattr("sim.camera.film.Film.image", worked)
    if not {"platform", "difficulty", "scene"} & arguments.keys():  # those are refused by what would do the work
        monkeypatch.setattr("sim.record.flight", worked)
        monkeypatch.setattr("sim.points.flight", worked)
    with pytest.raises(ConfigError, match=says):
        record(**{"platform": "quadrotor", "seconds": 3.0, "seed": 1, "out": tmp_path / "out", **arguments})
    assert not any(tmp_path.iterdir())


def test_without_opengl_it_ends_before_anything_is_simulated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: object) -> None:
        raise RenderError(f"no OpenGL here; type: {gl.INSTALL}")

    monkeypatch.setattr(gl, "make_context", missing)
    monkeypatch.setattr("sim.record.flight", lambda *_: pytest.fail("work began"))
    with pytest.raises(RenderError, match="apt-get install"):
        record("quadrotor", 1.0, 1, tmp_path / "out")
    assert not any(tmp_path.iterdir())


def test_a_folder_with_something_in_it_is_seen_before_anything_is_simulated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    monkeypatch.setattr("sim.record.flight", lambda *_: pytest.fail("work began"))
    for mode in ("images", "imu"):
        with pytest.raises(ConfigError, match="is there already; expected a new or empty folder"):
            record("quadrotor", 1.0, 1, tmp_path, mode=mode)


def test_noise_is_drawn_anew_on_a_motion_that_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def made(name: str, **options: Any) -> Sequence:
        record("rover", 3.0, 4, tmp_path / name, mode="imu", **options)
        return open_sequence(tmp_path / name)

    plain, first = made("plain"), made("first", noise_seed=1, flights=tmp_path / "flights")
    monkeypatch.setattr("sim.flights.simulate_motion", lambda *_: pytest.fail("physics ran again"))
    again = made("again", flights=tmp_path / "flights")
    second = made("second", noise_seed=2, imu="cheap", flights=tmp_path / "flights")
    np.testing.assert_array_equal(again.imu.accel, plain.imu.accel)
    for other in (first, second):
        assert other.truth is not None and plain.truth is not None
        np.testing.assert_array_equal(other.truth.p_WB, plain.truth.p_WB)
        assert np.abs(other.imu.gyro - plain.imu.gyro).max() > 1e-3

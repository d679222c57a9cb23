import hashlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from navcore.readers import open_sequence
from sim import simulate_points
from sim.errors import ConfigError, RenderError
from sim.record import record


def digest(folder: Path) -> dict[str, str]:
    files = sorted(x for x in folder.rglob("*") if x.is_file())
    return {str(x.relative_to(folder)): hashlib.sha256(x.read_bytes()).hexdigest() for x in files}


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
    np.testing.assert_allclose(sequence.imu.accel, expected.imu.accel, rtol=1e-11)
    assert sequence.truth is not None and expected.truth is not None
    assert sequence.truth.b_g is not None and expected.truth.b_g is not None
    np.testing.assert_allclose(sequence.truth.p_WB, expected.truth.p_WB, rtol=1e-11)
    np.testing.assert_allclose(sequence.truth.R_WB, expected.truth.R_WB, atol=1e-10)
    np.testing.assert_allclose(sequence.truth.b_g, expected.truth.b_g, rtol=1e-11)
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
    one, other = digest(rendered), digest(clean)
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

    monkeypatch.setattr("sim.film.Film.shoot", broken)
    with pytest.raises(RenderError):
        record("quadrotor", 0.3, 1, tmp_path / "a" / "flight")
    with pytest.raises(ConfigError):
        record("quadrotor", 0.3, 1, tmp_path / "a" / "flight", degrade="fog:1@0-1")
    assert not any((tmp_path / "a").iterdir())


def test_images_are_grey_png_of_the_cameras_size(rendered: Path) -> None:
    first = sorted((rendered / "mav0" / "cam0" / "data").iterdir())[0]
    image = cv2.imread(str(first), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert image.shape == (480, 752)
    assert image.dtype == np.uint8

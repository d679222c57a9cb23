import itertools
import shutil
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from navcore.arrays import Image
from navcore.errors import DataError
from navcore.readers import open_sequence
from navcore.sequence import Frame, ImageArray, ImageFile, Sequence, Tracks
from sim.errors import ConfigError
from sim.output import FORMATS, write_recording
from tests.sim.output.recordings import HEIGHT, WIDTH, assert_same, digest, noise_recording

EVERY = pytest.mark.parametrize("form", FORMATS)


@EVERY
@pytest.mark.parametrize("cameras", [0, 1, 2])
def test_every_format_reads_back_to_the_last_bit(tmp_path, form, cameras):
    made = noise_recording(cameras)
    write_recording(made, tmp_path / "out", format=form)
    read = open_sequence(tmp_path / "out")
    assert_same(read, made)
    assert read.name == "out"
    assert read.notes == ()


@EVERY
def test_a_recording_without_truth_and_one_that_knows_only_poses(tmp_path, form):
    made = noise_recording(1)
    poses = replace(made.truth, v_WB=None, b_g=None, b_a=None)
    for name, truth in (("none", None), ("poses", poses)):
        write_recording(replace(made, truth=truth), tmp_path / name, format=form)
        read = open_sequence(tmp_path / name).truth
        assert (read is None) == (truth is None)
    assert (read.v_WB, read.b_g, read.b_a) == (None, None, None)


@EVERY
def test_the_same_recording_gives_the_same_bytes(tmp_path, form):
    for name in ("one", "other"):
        write_recording(noise_recording(), tmp_path / name, format=form, origin={"seed": 0})
    assert digest(tmp_path / "one") == digest(tmp_path / "other")
    write_recording(noise_recording(seed=1), tmp_path / "third", format=form, origin={"seed": 0})
    assert digest(tmp_path / "third") != digest(tmp_path / "one")


@EVERY
def test_nothing_but_the_recording_is_left(tmp_path, form):
    write_recording(noise_recording(1, 1), tmp_path / "a" / "out", format=form, origin={"seed": 0})
    assert [x.name for x in (tmp_path / "a").iterdir()] == ["out"]
    bags = {"ros1": {"recording.bag"}, "ros2": {"recording.db3", "metadata.yaml"}}
    beside = {"camchain-imucam.yaml", "imu.yaml", "origin.json"}
    expected = {"mav0", "origin.json"} if form == "asl" else bags[form] | beside
    assert {x.name for x in (tmp_path / "a" / "out").iterdir()} == expected


@dataclass(frozen=True)
class Darkened:
    """Any source but a file."""

    source: ImageFile

    def load(self) -> Image:
        return self.source.load() // 2


def originals(folder: Path) -> Sequence:
    """JPEG files of which every second frame is darkened when it is loaded."""
    folder.mkdir()
    made = noise_recording(1)
    frames = []
    for k, frame in enumerate(made.frames):
        path = folder / f"{frame.t_ns}.jpg"
        cv2.imwrite(str(path), frame.images[0].load())
        file = ImageFile(path, WIDTH, HEIGHT)
        frames.append(Frame(frame.t_ns, {0: file if k % 2 else Darkened(file)}))
    return replace(made, frames=tuple(frames))


def test_an_image_that_is_a_file_is_copied_byte_for_byte(tmp_path):
    made = originals(tmp_path / "originals")
    write_recording(made, tmp_path / "out")
    data = tmp_path / "out" / "mav0" / "cam0" / "data"
    listed = (data.parent / "data.csv").read_text().splitlines()[1:]
    for k, frame in enumerate(made.frames):
        name = f"{frame.t_ns}.{'jpg' if k % 2 else 'png'}"
        assert listed[k] == f"{frame.t_ns},{name}"
        if k % 2:
            assert (data / name).read_bytes() == frame.images[0].path.read_bytes()
    assert_same(open_sequence(tmp_path / "out"), made)


@pytest.mark.parametrize("form", ["ros1", "ros2"])
def test_bags_hold_the_pixels_of_files(tmp_path, form):
    made = originals(tmp_path / "originals")
    write_recording(made, tmp_path / "out", format=form)
    assert_same(open_sequence(tmp_path / "out"), made)


def test_a_frame_whose_stamp_moved_onto_anothers_keeps_its_own_image(tmp_path):
    made = originals(tmp_path / "originals")
    first, second, *rest = made.frames
    moved = replace(made, frames=(replace(second, t_ns=first.t_ns), replace(rest[0], t_ns=second.t_ns)))
    write_recording(moved, tmp_path / "out")
    assert_same(open_sequence(tmp_path / "out"), moved)


def test_a_missing_original_is_named_and_leaves_nothing(tmp_path):
    made = originals(tmp_path / "originals")
    made.frames[1].images[0].path.unlink()
    with pytest.raises(DataError, match=rf"{made.frames[1].t_ns}\.jpg: no such image"):
        write_recording(made, tmp_path / "out", origin={})
    assert [x.name for x in tmp_path.iterdir()] == ["originals"]


def with_tracks() -> Sequence:
    rng = np.random.default_rng(1)
    made = noise_recording(2)
    frames = []
    for k, frame in enumerate(made.frames):
        n = 0 if k == 2 else 20
        both = [Tracks(rng.permutation(1000)[:n], rng.normal(300, 100, (n, 2))) for _ in range(2)]
        frames.append(Frame(frame.t_ns, {}, dict(enumerate(both[: 1 if k == 4 else 2]))))
    return replace(made, frames=tuple(frames))


def test_tracks_read_back_to_the_last_bit_in_their_order(tmp_path):
    made = with_tracks()
    write_recording(made, tmp_path / "out")
    read = open_sequence(tmp_path / "out")
    assert [f.t_ns for f in read.frames] == [f.t_ns for f in made.frames]
    for (index, one), other in itertools.product(enumerate(made.frames), (0, 1)):
        if other in one.tracks:
            got = read.frames[index].tracks[other]
            np.testing.assert_array_equal(got.ids, one.tracks[other].ids)
            np.testing.assert_array_equal(got.uv, one.tracks[other].uv)


def test_tracks_cannot_be_a_bag(tmp_path):
    with pytest.raises(ConfigError, match="tracks, which bags have no message for; write it as asl"):
        write_recording(with_tracks(), tmp_path / "out", format="ros1")
    assert not any(tmp_path.iterdir())


def test_an_unknown_format_is_refused_with_the_known_ones(tmp_path):
    with pytest.raises(ConfigError, match="'ros3' is unknown; known are asl, ros1, ros2"):
        write_recording(noise_recording(0), tmp_path / "out", format="ros3")


def test_without_rosbags_the_message_is_the_line_to_type(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(ConfigError, match=r"pip install 'msckf-ipnet\[bags\]'"):
        write_recording(noise_recording(0), tmp_path / "out", format="ros2")
    write_recording(noise_recording(0), tmp_path / "out")


def test_stamps_that_ros_cannot_hold_are_refused(tmp_path):
    made = noise_recording(1)
    late = replace(made, frames=(Frame(2**31 * 10**9, made.frames[0].images),))
    with pytest.raises(ConfigError, match="bags hold 0 to 2147483647999999999"):
        write_recording(late, tmp_path / "out", format="ros1")


@dataclass(frozen=True)
class Untouchable:
    """Loading it is a mistake."""

    def load(self) -> Image:
        raise AssertionError


@pytest.mark.parametrize(("form", "needed"), [("asl", 1_400_000), ("ros1", 2_600_000)])
def test_too_little_space_is_said_before_any_image_is_made(tmp_path, monkeypatch, form, needed):
    made = noise_recording(1)
    frames = tuple(Frame(made.frames[0].t_ns + k, {0: Untouchable()}) for k in range(400))
    big = replace(made, frames=frames)
    assert needed > 400 * WIDTH * HEIGHT
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1_000_000))
    with pytest.raises(ConfigError, match=r"may take \d\.\d+ GB, and 0\.001 GB are free"):
        write_recording(big, tmp_path / "new" / "out", format=form)
    assert not any(tmp_path.iterdir())
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=needed))
    with pytest.raises(AssertionError):
        write_recording(big, tmp_path / "new" / "out", format=form)


def test_a_place_where_no_folder_can_be_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="file/out cannot be made: Not a directory"):
        write_recording(noise_recording(0), tmp_path / "file" / "out")


def test_progress_counts_every_image(tmp_path):
    counts: list[tuple[int, int]] = []
    write_recording(noise_recording(2), tmp_path / "out", progress=lambda done, total: counts.append((done, total)))
    assert counts == [(k, 11) for k in range(1, 12)]


def test_images_are_grey_png(tmp_path):
    image = ImageArray(np.arange(WIDTH * HEIGHT, dtype=np.uint8).reshape(HEIGHT, WIDTH))
    made = noise_recording(1)
    write_recording(replace(made, frames=(Frame(made.frames[0].t_ns, {0: image}),)), tmp_path / "out")
    (path,) = (tmp_path / "out" / "mav0" / "cam0" / "data").iterdir()
    read = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert read.dtype == np.uint8
    np.testing.assert_array_equal(read, image.load())

"""Real recordings come out as they went in."""

import itertools
from dataclasses import replace

import pytest

from navcore.readers import open_sequence
from sim.output import write_recording
from tests.sim.output.recordings import assert_same


@pytest.fixture(scope="module")
def part(vio_data):
    """Half a second of MH_01, stereo."""
    cut = open_sequence(vio_data / "euroc" / "MH_01_easy").span(3.0, 3.5)
    start_ns, end_ns = cut.frames[0].t_ns, cut.frames[-1].t_ns + 1
    return replace(cut, imu=cut.imu.between(start_ns, end_ns), truth=cut.truth.between(start_ns, end_ns))


def test_a_real_recording_keeps_the_bytes_of_its_images(part, tmp_path):
    write_recording(part, tmp_path / "out")
    copy = open_sequence(tmp_path / "out")
    assert_same(copy, part)
    for one, other in zip(copy.frames, part.frames, strict=True):
        for index in other.images:
            assert one.images[index].path.name == other.images[index].path.name
            assert one.images[index].path.read_bytes() == other.images[index].path.read_bytes()


@pytest.mark.parametrize("form", ["ros1", "ros2"])
def test_a_real_recording_becomes_a_bag_and_comes_back(part, tmp_path, form):
    write_recording(part, tmp_path / "bag", format=form)
    write_recording(open_sequence(tmp_path / "bag"), tmp_path / "folder")
    assert_same(open_sequence(tmp_path / "bag"), part)
    assert_same(open_sequence(tmp_path / "folder"), part)


def test_truth_of_nine_recordings_reads_back(vio_data, tmp_path):
    found = sorted((vio_data / "euroc").iterdir())
    assert len(found) == 9
    for path, form in zip(found, itertools.cycle(["asl", "ros1", "ros2"]), strict=False):
        made = replace(open_sequence(path), frames=())
        made = replace(made, imu=made.imu[:400], truth=made.truth[:400])
        write_recording(made, tmp_path / path.name, format=form)
        assert_same(open_sequence(tmp_path / path.name), made)

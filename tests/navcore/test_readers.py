import shutil

import numpy as np
import pytest

from navcore.errors import DataError
from navcore.readers import open_sequence
from navcore.readers.asl import read_truth
from navcore.sequence import ImageFile
from tests.navcore.recordings import (
    HEIGHT,
    IMU_HEADER,
    IMU_STEP_NS,
    START_NS,
    TRUTH_HEADER,
    WIDTH,
    frame_stamps,
    imu_rows,
    truth_rows,
    write_camera,
    write_euroc,
    write_image,
    write_rows,
)

KALIBR = """cam0:
  camera_model: pinhole
  distortion_model: equidistant
  intrinsics: [50.0, 50.0, 31.5, 23.5]
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  resolution: [64, 48]
  T_cam_imu: [[0, 1, 0, 0.1], [-1, 0, 0, 0.0], [0, 0, 1, 0.0], [0, 0, 0, 1]]
  timeshift_cam_imu: 0.002
"""
KALIBR_IMU = """imu0:
  update_rate: 200.0
  gyroscope_noise_density: 1.6e-4
  gyroscope_random_walk: 2.2e-5
  accelerometer_noise_density: 2.8e-3
  accelerometer_random_walk: 8.6e-4
"""


@pytest.fixture
def mav0(tmp_path):
    """Two cameras, one second."""
    return write_euroc(tmp_path / "flight", cameras=2)


@pytest.fixture
def tumvi(tmp_path):
    folder = tmp_path / "tum" / "walk"
    write_rows(folder / "mav0" / "imu0" / "data.csv", imu_rows(), IMU_HEADER)
    write_rows(folder / "mav0" / "mocap0" / "data.csv", truth_rows(columns=7), TRUTH_HEADER)
    camera = folder / "mav0" / "cam0"
    write_camera(camera, frame_stamps())
    (camera / "sensor.yaml").unlink()
    (folder.parent / "camchain-imucam.yaml").write_text(KALIBR)
    (folder.parent / "imu.yaml").write_text(KALIBR_IMU)
    return folder


def test_euroc_is_read(mav0):
    for path in (mav0, mav0.parent):
        read = open_sequence(path)
        assert read.name == "flight"
        assert read.notes == ()
        assert len(read.imu) == 201
        assert read.imu.t_ns[1] == START_NS + IMU_STEP_NS
        np.testing.assert_array_equal(read.imu.gyro[3, 2], 0.3)
        np.testing.assert_array_equal(read.imu.accel[3], [0.0, -0.1, 9.81])
        assert [f.t_ns for f in read.frames] == frame_stamps()
        assert all(set(f.images) == {0, 1} for f in read.frames)
        assert read.frames[0].images[1].load().shape == (HEIGHT, WIDTH)
        np.testing.assert_array_equal(read.calibration.cameras[1].p_BC, [0.1, 0.0, 0.0])


def test_truth_turns_from_wxyz_to_xyzw(mav0):
    truth = open_sequence(mav0).truth
    half = 0.5 * 0.3 * 200 * 5e-3
    np.testing.assert_allclose(truth.q_WB[-1], [0.0, 0.0, np.sin(half), np.cos(half)], atol=1e-8)
    np.testing.assert_allclose(truth.v_WB[7], [2.0, 0.0, 0.0])
    np.testing.assert_allclose(truth.b_g[7], [0.001, -0.002, 0.003])
    np.testing.assert_allclose(truth.b_a[7], [0.01, 0.02, -0.03])


@pytest.mark.parametrize(("columns", "known"), [(7, 0), (10, 1), (16, 3)])
def test_truth_with_as_many_columns_as_are_known(tmp_path, columns, known):
    path = tmp_path / "data.csv"
    write_rows(path, truth_rows(columns=columns), "#time(ns),px,py,pz,qw,qx,qy,qz")
    truth = read_truth(path)
    assert sum(x is not None for x in (truth.v_WB, truth.b_g, truth.b_a)) == known


def test_truth_without_biases_has_none(tmp_path):
    rows = truth_rows()
    for row in rows:
        row[11:] = ["nan"] * 6
    rows[0][8:11] = ["nan"] * 3
    path = tmp_path / "data.csv"
    write_rows(path, rows)
    truth = read_truth(path)
    assert truth.b_g is None
    assert truth.b_a is None
    assert np.isnan(truth.v_WB[0]).all()
    assert np.isfinite(truth.v_WB[1:]).all()


def test_a_recording_without_truth(mav0):
    shutil.rmtree(mav0 / "state_groundtruth_estimate0")
    assert open_sequence(mav0).truth is None


def test_a_camera_may_lack_a_frame(mav0):
    stamps = frame_stamps()
    write_camera(mav0 / "cam1", stamps[:3] + stamps[4:])
    frames = open_sequence(mav0).frames
    assert [set(f.images) for f in frames] == [{0, 1}] * 3 + [{0}] + [{0, 1}] * 6


def test_stamps_alone_do_not_make_frames(mav0):
    for folder in (mav0 / "cam0", mav0 / "cam1"):
        (folder / "data.csv").unlink()
        shutil.rmtree(folder / "data")
        (folder / "timestamps_ns.txt").write_text("\n".join(map(str, frame_stamps())))
    read = open_sequence(mav0)
    assert read.frames == ()
    assert len(read.calibration.cameras) == 2


def test_no_image_is_touched_until_it_is_asked_for(mav0):
    stamps = frame_stamps()
    (mav0 / "cam0" / "data" / f"{stamps[2]}.png").unlink()
    (mav0 / "cam0" / "data" / f"{stamps[3]}.png").write_bytes(b"")
    frames = open_sequence(mav0).frames
    with pytest.raises(DataError, match=rf"{stamps[2]}\.png: no such image"):
        frames[2].images[0].load()
    with pytest.raises(DataError, match=rf"{stamps[3]}\.png: corrupt image"):
        frames[3].images[0].load()


@pytest.mark.parametrize("share", [0.05, 0.5, 0.99])
def test_a_corrupt_image_is_named(mav0, share):
    image = mav0 / "cam0" / "data" / f"{frame_stamps()[0]}.png"
    content = image.read_bytes()
    image.write_bytes(content[: int(share * len(content))])
    with pytest.raises(DataError, match=rf"{image.name}: corrupt image"):
        open_sequence(mav0).frames[0].images[0].load()


def test_an_image_of_the_wrong_size_is_named_with_both_sizes(mav0):
    image = mav0 / "cam0" / "data" / f"{frame_stamps()[0]}.png"
    write_image(image, WIDTH + 2, HEIGHT)
    with pytest.raises(DataError, match=rf"{image.name}: image is 66x48, calibration says 64x48"):
        open_sequence(mav0).frames[0].images[0].load()


def test_frames_outside_the_imus_span_are_left_out_and_named(mav0):
    last = START_NS + 200 * IMU_STEP_NS
    early, late = [START_NS - 100, START_NS - 1], [last + 1]
    write_camera(mav0 / "cam0", [*early, START_NS, *frame_stamps(), last, *late])
    read = open_sequence(mav0)
    assert [f.t_ns for f in read.frames] == [START_NS, *frame_stamps(), last]
    before, after = read.notes
    assert before.startswith("2 frame(s) left out, before the first IMU sample")
    assert f"{early[0]} to {early[1]} ns" in before
    assert after.startswith("1 frame(s) left out, after the last IMU sample")
    assert str(late[0]) in after


def test_the_time_offset_counts_for_the_imus_span(mav0):
    sensor = mav0 / "cam0" / "sensor.yaml"
    write_camera(mav0 / "cam0", [START_NS - 1_000_000, *frame_stamps()])
    sensor.write_text(sensor.read_text() + "timeshift_cam_imu: 0.002\n")
    other = mav0 / "cam1" / "sensor.yaml"
    other.write_text(other.read_text() + "timeshift_cam_imu: 0.002\n")
    read = open_sequence(mav0)
    assert read.frames[0].t_ns == START_NS - 1_000_000
    assert read.calibration.cameras[0].dt_cam_imu == 0.002


def test_gaps_of_the_imu_are_noted(mav0):
    rows = imu_rows()
    write_rows(mav0 / "imu0" / "data.csv", rows[:50] + rows[60:100] + rows[102:], IMU_HEADER)
    (note,) = open_sequence(mav0).notes
    assert "2 gap(s)" in note
    assert f"the longest 0.055 s after {rows[49][0]} ns" in note


TRACKS = [["10", "0", "1.5", "2.5"], ["10", "7", "3", "4"], ["20", "7", "3.5", "4.5"]]


def tracks_recording(mav0, rows):
    for folder in (mav0 / "cam0", mav0 / "cam1"):
        (folder / "data.csv").unlink()
        shutil.rmtree(folder / "data")
    stamped = [[str(START_NS + int(t) * 1_000_000), *rest] for t, *rest in rows]
    write_rows(mav0 / "cam0" / "tracks.csv", stamped, "t_ns,id,u,v")


def test_tracks_take_the_place_of_images(mav0):
    tracks_recording(mav0, TRACKS)
    listed = [START_NS + k * 1_000_000 for k in (10, 15, 20)]
    (mav0 / "cam0" / "timestamps_ns.txt").write_text("\n".join(map(str, listed)))
    frames = open_sequence(mav0).frames
    assert [f.t_ns for f in frames] == listed
    assert [f.images for f in frames] == [{}] * 3
    assert frames[0].tracks[0].ids.tolist() == [0, 7]
    np.testing.assert_array_equal(frames[0].tracks[0].uv, [[1.5, 2.5], [3.0, 4.0]])
    assert len(frames[1].tracks[0]) == 0  # the camera saw nothing
    assert frames[2].tracks[0].ids.tolist() == [7]


@pytest.mark.parametrize(
    ("row", "says"),
    [
        (["20", "7", "1", "2"], "id 7 occurs twice"),
        (["20", "7.5", "1", "2"], "id 7.5 .* not a whole number"),
        (["20", "8", "nan", "2"], r"tracks\.csv:5: field 3"),
        (["19", "8", "1", "2"], r"tracks\.csv:5: .*out of order"),
    ],
)
def test_wrong_tracks(mav0, row, says):
    tracks_recording(mav0, [*TRACKS, row])
    with pytest.raises(DataError, match=says):
        open_sequence(mav0)


def test_tumvi_is_read(tumvi):
    for path in (tumvi, tumvi / "mav0"):
        read = open_sequence(path)
        assert read.name == "walk"
        assert read.truth.v_WB is None
        assert read.truth.b_g is None
        (mount,) = read.calibration.cameras
        assert mount.camera.model == "pinhole-equidistant"
        assert mount.dt_cam_imu == 0.002
        np.testing.assert_allclose(mount.p_BC, [0.0, -0.1, 0.0], atol=1e-15)
        assert len(read.frames) == 10


@pytest.mark.parametrize("place", ["walk", "walk/dso", "walk/mav0"])
def test_tumvis_calibration_lies_in_several_places_and_the_nearest_wins(tumvi, place):
    near = tumvi.parent / place
    near.mkdir(exist_ok=True)
    (near / "camchain-imucam.yaml").write_text(KALIBR.replace("0.002", "0.003"))
    assert open_sequence(tumvi).calibration.cameras[0].dt_cam_imu == 0.003


def test_tumvi_without_calibration(tumvi):
    (tumvi.parent / "imu.yaml").unlink()
    with pytest.raises(DataError, match=r"no calibration imu\.yaml or imu_config\.yaml in .*dso"):
        open_sequence(tumvi)


def test_a_layout_is_told_by_content_not_by_name(tmp_path):
    mav0 = write_euroc(tmp_path / "dataset-room1_512_16")
    assert open_sequence(mav0.parent).truth.b_g is not None


@pytest.mark.parametrize(
    ("remove", "says"),
    [
        (".", "no such folder; expected a recording with mav0/imu0"),
        ("imu0", "no folder imu0; expected mav0/imu0/data.csv, found cam0"),
        ("imu0/data.csv", r"imu0/data\.csv: no such file; expected rows of t_ns, gyro"),
        ("imu0/sensor.yaml", r"imu0/sensor\.yaml: no such file; expected a calibration"),
        ("cam0/sensor.yaml", r"cam0/sensor\.yaml: no such file; expected a calibration"),
        ("cam0/data", r"cam0/data: no such folder; .*data\.csv lists 10 images"),
        ("cam0", r"camera folders \['cam1'\], expected \['cam0'\]"),
    ],
)
def test_what_is_missing_is_named(mav0, remove, says):
    target = mav0 / remove
    if target.is_dir():
        shutil.rmtree(target)
    else:
        target.unlink()
    with pytest.raises(DataError, match=says):
        open_sequence(mav0)


def test_an_unknown_layout(mav0):
    for sensor in mav0.glob("*/sensor.yaml"):
        sensor.unlink()
    with pytest.raises(DataError, match=r"unknown layout; expected EuRoC's .* or TUM-VI's"):
        open_sequence(mav0)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda rows: rows[9].pop(), r"data\.csv:11: 6 fields, expected 7"),
        (lambda rows: rows[9].__setitem__(2, "nan"), r"data\.csv:11: field 3 is 'nan'"),
        (lambda rows: rows[9].__setitem__(2, "abc"), r"data\.csv:11: field 3 is 'abc'"),
        (lambda rows: rows.insert(9, rows[11]), r"data\.csv:12: stamp .* out of order"),
        (lambda rows: rows.insert(9, rows[8]), r"data\.csv:11: stamp .* repeated"),
    ],
)
def test_a_wrong_imu_row_is_named(mav0, change, says):
    rows = imu_rows()
    change(rows)
    write_rows(mav0 / "imu0" / "data.csv", rows, IMU_HEADER)
    with pytest.raises(DataError, match=says):
        open_sequence(mav0)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda rows: [row.pop() for row in rows], r"15 numbers a row, expected one of \(7, 10, 16\)"),
        (lambda rows: rows[4].__setitem__(1, "nan"), r"data\.csv:6: field 2 is 'nan'"),
        (lambda rows: rows[4].__setitem__(slice(4, 8), ["0"] * 4), r"data\.csv: pose at \d+ ns is not one"),
    ],
)
def test_wrong_truth_is_named(mav0, change, says):
    rows = truth_rows()
    change(rows)
    write_rows(mav0 / "state_groundtruth_estimate0" / "data.csv", rows, TRUTH_HEADER)
    with pytest.raises(DataError, match=says):
        open_sequence(mav0)


def test_an_imu_that_is_not_the_body_is_refused(mav0):
    sensor = mav0 / "imu0" / "sensor.yaml"
    sensor.write_text(sensor.read_text().replace("[1.0, 0.0, 0.0, 0.0,", "[1.0, 0.0, 0.0, 0.5,"))
    with pytest.raises(DataError, match="T_BS is not the identity"):
        open_sequence(mav0)


def test_real_euroc(vio_data):
    read = open_sequence(vio_data / "euroc" / "MH_01_easy")
    assert len(read.imu) == 36820
    assert len(read.frames) == 600
    assert sum(set(f.images) == {0, 1} for f in read.frames) == 599  # one of cam1 is corrupt at the source
    assert read.frames[0].images[0].load().shape == (480, 752)
    assert read.truth.covers(np.array([f.t_ns for f in read.frames])).all()


def test_real_euroc_truth_has_other_headers_and_rates(vio_data):
    read = open_sequence(vio_data / "euroc" / "V1_01_easy")
    assert read.frames == ()
    assert len(read.truth) == 2895
    assert np.isfinite(read.truth.b_g).all()


def test_real_truth_stamps_are_near_the_imus(vio_data):
    read = open_sequence(vio_data / "euroc" / "V2_01_easy")
    inside = read.imu.between(int(read.truth.t_ns[0]), int(read.truth.t_ns[-1]))
    assert read.truth.covers(inside.t_ns).all()


def test_real_tumvi(vio_data):
    read = open_sequence(vio_data / "tumvi" / "dataset-room1_512_16")
    assert len(read.calibration.cameras) == 2
    assert read.truth.b_g is None
    assert not read.truth.covers(read.imu.t_ns).all()  # motion capture has gaps


def test_the_real_corrupt_frame(vio_data):
    path = vio_data / "bad" / "corrupt_frame.png"
    with pytest.raises(DataError, match=r"corrupt_frame\.png: corrupt image"):
        ImageFile(path, 752, 480).load()

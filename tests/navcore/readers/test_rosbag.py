"""Bags as others make them, written with rosbags: stamps of headers, all encodings, what is missing."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from navcore.errors import DataError
from navcore.readers import open_sequence

START_NS = 1_403_636_579_758_555_392
HEIGHT, WIDTH = 48, 64
LATE_NS = 7_000_003  # between a message's stamp and its reception
CAMCHAIN = """cam0:
  camera_model: pinhole
  distortion_model: radtan
  intrinsics: [50.0, 51.0, 31.5, 23.5]
  distortion_coeffs: [-0.1, 0.01, 0.001, -0.001]
  resolution: [64, 48]
  T_cam_imu: [[0, 1, 0, 0.1], [-1, 0, 0, 0.0], [0, 0, 1, 0.0], [0, 0, 0, 1]]
  rostopic: {topic}
"""
IMU = """gyroscope_noise_density: 1.6e-4
gyroscope_random_walk: 2.2e-5
accelerometer_noise_density: 2.8e-3
accelerometer_random_walk: 8.6e-4
"""
ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_HUMBLE)


def header(store, t_ns):
    T = store.types
    number = {"seq": 1} if store is ROS1 else {}
    time = T["builtin_interfaces/msg/Time"](t_ns // 10**9, t_ns % 10**9)
    return T["std_msgs/msg/Header"](stamp=time, frame_id="x", **number)


def imu(store, t_ns, k):
    T = store.types
    vector, zero = T["geometry_msgs/msg/Vector3"], np.zeros(9)
    attitude = T["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    gyro, accel = vector(0.1 * k, 1 / 3, -1e-17), vector(1e-300, -0.1, 9.81)
    return T["sensor_msgs/msg/Imu"](header(store, t_ns), attitude, zero, gyro, zero, accel, zero)


def raw(store, t_ns, encoding, rows, big=0):
    """An image out of bytes (height, step)."""
    message = store.types["sensor_msgs/msg/Image"]
    return message(header(store, t_ns), HEIGHT, WIDTH, encoding, big, rows.shape[1], rows.reshape(-1))


def compressed(store, t_ns, data, form="png"):
    return store.types["sensor_msgs/msg/CompressedImage"](header(store, t_ns), form, np.frombuffer(data, np.uint8))


def noise(seed=0, channels=1):
    shape = (HEIGHT, WIDTH, channels) if channels > 1 else (HEIGHT, WIDTH)
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def write(folder, messages, kind="ros1", topic="/cam0/image_raw", imu_topic="/imu0"):
    """A bag with IMU for a second, further (topic, stamp, message), and the calibration beside it; its path."""
    folder.mkdir(parents=True, exist_ok=True)
    store = ROS1 if kind == "ros1" else ROS2
    path = folder / ("flight.bag" if kind == "ros1" else "flight")
    samples = [(imu_topic, START_NS + 5_000_000 * k, imu(store, START_NS + 5_000_000 * k, k)) for k in range(201)]
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer1(path) if kind == "ros1" else Writer2(path, version=8, storage_plugin=plugin) as writer:
        connections = {}
        for name, t_ns, message in sorted([*samples, *messages], key=lambda x: x[1]):
            if name not in connections:
                connections[name] = writer.add_connection(name, message.__msgtype__, typestore=store)
            data = (store.serialize_ros1 if kind == "ros1" else store.serialize_cdr)(message, message.__msgtype__)
            writer.write(connections[name], t_ns + LATE_NS, data)
    (folder / "camchain-imucam.yaml").write_text(CAMCHAIN.format(topic=topic))
    (folder / "imu.yaml").write_text(IMU + (f"rostopic: {imu_topic}\n" if imu_topic != "/imu0" else ""))
    return path


def images(store, count=3, topic="/cam0/image_raw"):
    stamps = [START_NS + 100_000_001 + 50_000_000 * k for k in range(count)]
    return [(topic, t, raw(store, t, "mono8", noise(k))) for k, t in enumerate(stamps)]


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
def test_stamps_are_the_headers_and_numbers_keep_every_digit(tmp_path, kind):
    path = write(tmp_path, images(ROS1 if kind == "ros1" else ROS2), kind)
    stored = {"ros1": path, "sqlite": path / "flight.db3", "mcap": path / "flight.mcap"}[kind]
    if kind != "ros1":
        for name in ("imu.yaml", "camchain-imucam.yaml"):
            (path / name).write_text((tmp_path / name).read_text())
    for place in (path, stored):  # a ROS 2 folder, or the file in it
        read = open_sequence(place)
        assert read.name == "flight"
        assert read.imu.t_ns.tolist() == [START_NS + 5_000_000 * k for k in range(201)]
        np.testing.assert_array_equal(read.imu.gyro[7], [0.1 * 7, 1 / 3, -1e-17])
        np.testing.assert_array_equal(read.imu.accel[7], [1e-300, -0.1, 9.81])
        assert [f.t_ns for f in read.frames] == [START_NS + 100_000_001 + 50_000_000 * k for k in range(3)]
        for k in (2, 0, 1, 2):  # in any order, more than once
            np.testing.assert_array_equal(read.frames[k].images[0].load(), noise(k))
        assert read.truth is None
        assert read.notes == ()
        np.testing.assert_allclose(read.calibration.cameras[0].p_BC, [0.0, -0.1, 0.0], atol=1e-15)


def test_a_folder_with_one_bag_is_that_bag(tmp_path):
    write(tmp_path / "walk", images(ROS1))
    assert open_sequence(tmp_path / "walk").name == "walk"
    (tmp_path / "walk" / "flight.bag").rename(tmp_path / "walk" / "a.bag")
    write(tmp_path / "walk", images(ROS1))
    with pytest.raises(DataError, match=r"2 bags, name one of a\.bag, flight\.bag"):
        open_sequence(tmp_path / "walk")


def test_two_images_received_at_one_time_are_told_apart_by_their_stamps(tmp_path):
    t_ns = START_NS + 300_000_000
    late = [("/cam0/image_raw", t_ns, raw(ROS1, t_ns - 1000 * k, "mono8", noise(k))) for k in (0, 1)]
    frames = open_sequence(write(tmp_path, late)).frames
    assert [f.t_ns for f in frames] == [t_ns - 1000, t_ns]
    np.testing.assert_array_equal(frames[0].images[0].load(), noise(1))
    np.testing.assert_array_equal(frames[1].images[0].load(), noise(0))


def test_samples_that_arrived_out_of_order_are_put_in_order(tmp_path):
    t_ns = START_NS + 5_000_000 * 300
    early = ("/imu0", t_ns, imu(ROS1, START_NS - 5_000_000, -1))
    read = open_sequence(write(tmp_path, [*images(ROS1), early])).imu
    assert read.t_ns[0] == START_NS - 5_000_000
    assert read.gyro[0, 0] == -0.1


def padded(image, pad=8):
    return np.hstack([image.reshape(HEIGHT, -1), np.full((HEIGHT, pad), 99, dtype=np.uint8)])


def sixteen(byteorder):
    deep = np.random.default_rng(5).integers(0, 65536, (HEIGHT, WIDTH), dtype=np.uint16)
    return deep, deep.astype(f"{byteorder}u2").view(np.uint8)


def grey_of_png(pixels):
    """What OpenCV reads from the same pixels in a file."""
    return cv2.imdecode(cv2.imencode(".png", pixels)[1], cv2.IMREAD_GRAYSCALE)


DEEP, LITTLE = sixteen("<")
_, BIG = sixteen(">")
COLOUR = noise(3, 3)
ALPHA = np.dstack([COLOUR, noise(4)])


@pytest.mark.parametrize(
    ("encoding", "rows", "big", "expected"),
    [
        ("mono8", padded(noise()), 0, noise()),
        ("8UC1", noise(), 0, noise()),
        ("mono16", padded(LITTLE), 0, grey_of_png(DEEP)),
        ("16UC1", BIG, 1, grey_of_png(DEEP)),
        ("bgr8", padded(COLOUR), 0, cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY)),
        ("rgb8", padded(COLOUR[..., ::-1].copy()), 0, cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY)),
        ("bgra8", padded(ALPHA), 0, cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY)),
        ("rgba8", padded(ALPHA[..., [2, 1, 0, 3]].copy()), 0, cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY)),
    ],
)
def test_encodings(tmp_path, encoding, rows, big, expected):
    t_ns = START_NS + 100_000_000
    path = write(tmp_path, [("/cam0/image_raw", t_ns, raw(ROS1, t_ns, encoding, rows, big))])
    image = open_sequence(path).frames[0].images[0].load()
    assert image.dtype == np.uint8
    np.testing.assert_array_equal(image, expected)


@pytest.mark.parametrize("store", [ROS1, ROS2])
def test_compressed_images_are_found_on_their_own_topic(tmp_path, store):
    t_ns = START_NS + 100_000_000
    data = cv2.imencode(".jpg", noise(), (cv2.IMWRITE_JPEG_QUALITY, 90))[1].tobytes()
    message = ("/cam0/image_raw/compressed", t_ns, compressed(store, t_ns, data, "jpeg"))
    path = write(tmp_path, [message], "ros1" if store is ROS1 else "sqlite")
    expected = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(open_sequence(path).frames[0].images[0].load(), expected)


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (lambda t: raw(ROS1, t, "bayer_rggb8", noise()), r"'bayer_rggb8' is not read; known are mono8, 8UC1"),
        (lambda t: raw(ROS1, t, "mono16", noise()), "corrupt image, 3072 bytes where 48 rows of 64 bytes"),
        (lambda t: raw(ROS1, t, "mono8", noise()[:-1]), "corrupt image, 3008 bytes"),
        (lambda t: compressed(ROS1, t, b"nothing"), r"corrupt image \(png\), cannot be decoded"),
        (lambda t: compressed(ROS1, t, b""), r"corrupt image \(png\), cannot be decoded"),
        (
            lambda t: compressed(ROS1, t, cv2.imencode(".png", np.zeros((4, 6), np.uint8))[1].tobytes()),
            "image is 6x4, calibration says 64x48",
        ),
    ],
)
def test_an_image_that_cannot_be_had_is_named_when_it_is_loaded(tmp_path, message, says):
    t_ns = START_NS + 100_000_000
    image = open_sequence(write(tmp_path, [("/cam0/image_raw", t_ns, message(t_ns))])).frames[0].images[0]
    with pytest.raises(DataError, match=rf"flight\.bag: /cam0/image_raw at {t_ns} ns: .*{says}"):
        image.load()


def test_the_calibration_can_name_other_topics(tmp_path):
    made = images(ROS1, topic="/left/image")
    read = open_sequence(write(tmp_path, made, topic="/left/image", imu_topic="/mavros/imu"))
    assert len(read.frames) == 3
    assert len(read.imu) == 201


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"imu_topic": "/imu/data"}, r"no topic /imu0; .*imu\.yaml can name another as rostopic; topics found: "),
        ({"topic": "/left"}, r"no topic /left; .*camchain-imucam\.yaml can .*topics found: /cam0/image_raw \(sensor"),
    ],
)
def test_a_missing_topic_is_an_error_that_lists_those_found(tmp_path, change, says):
    path = write(tmp_path, images(ROS1), **change)
    (tmp_path / "imu.yaml").write_text(IMU)
    with pytest.raises(DataError, match=says):
        open_sequence(path)


@pytest.mark.parametrize("name", ["imu.yaml", "camchain-imucam.yaml"])
def test_a_bag_without_calibration_says_where_it_was_looked_for(tmp_path, name):
    path = write(tmp_path, images(ROS1))
    (tmp_path / name).unlink()
    with pytest.raises(DataError, match=rf"flight\.bag: no calibration {name} or .* in {tmp_path}"):
        open_sequence(path)


def test_a_bag_with_nothing_but_imu_needs_no_cameras(tmp_path):
    path = write(tmp_path, [])
    (tmp_path / "camchain-imucam.yaml").unlink()
    read = open_sequence(path)
    assert (read.frames, read.calibration.cameras) == ((), ())


def test_motion_capture_of_markers_is_noted_not_taken_for_truth(tmp_path):
    T = ROS1.types
    turn = T["geometry_msgs/msg/Transform"](
        T["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0), T["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    )
    pose = T["geometry_msgs/msg/TransformStamped"](header(ROS1, START_NS), "marker", turn)
    read = open_sequence(write(tmp_path, [*images(ROS1), ("/vrpn_client/raw_transform", START_NS, pose)]))
    assert read.truth is None
    (note,) = read.notes
    assert "/vrpn_client/raw_transform is of a marker, not of the IMU" in note


def test_frames_outside_the_imus_span_and_gaps_are_noted(tmp_path):
    last = START_NS + 5_000_000 * 200
    made = [("/cam0/image_raw", t, raw(ROS1, t, "mono8", noise())) for t in (START_NS - 1, last, last + 1)]
    lonely = ("/imu0", last + 500_000_000, imu(ROS1, last + 500_000_000, 0))
    read = open_sequence(write(tmp_path, [*made, lonely]))
    assert [f.t_ns for f in read.frames] == [last, last + 1]
    assert "1 gap(s) between samples" in read.notes[0]
    assert "1 frame(s) left out, before the first IMU sample" in read.notes[1]


def test_a_repeated_sample_is_an_error(tmp_path):
    twice = ("/imu0", START_NS, imu(ROS1, START_NS, 0))
    with pytest.raises(DataError, match=rf"/imu0: IMU stamp {START_NS} ns is repeated"):
        open_sequence(write(tmp_path, [*images(ROS1), twice]))


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
def test_a_broken_bag_is_named(tmp_path, kind):
    path = write(tmp_path, images(ROS1 if kind == "ros1" else ROS2), kind)
    stored = {"ros1": path, "sqlite": path / "flight.db3", "mcap": path / "flight.mcap"}[kind]
    content = stored.read_bytes()
    (stored.parent / "imu.yaml").write_text(IMU)
    (stored.parent / "camchain-imucam.yaml").write_text(CAMCHAIN.format(topic="/cam0/image_raw"))
    for share in (0.0005, 0.3, 0.95):
        stored.write_bytes(content[: int(share * len(content)) + 20])
        with pytest.raises(DataError, match=rf"{path.name}.*: cannot be read as a bag: "):
            open_sequence(path)


def test_other_files_are_no_recordings(tmp_path):
    path = tmp_path / "flight.bag"
    path.write_text("no bag")
    with pytest.raises(DataError, match=r"flight\.bag: no ROS bag"):
        open_sequence(path)
    with pytest.raises(DataError, match="no such folder"):
        open_sequence(tmp_path / "missing.bag")


def test_without_rosbags_the_message_is_the_line_to_type(tmp_path, monkeypatch):
    path = write(tmp_path, images(ROS1))
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(DataError, match=r"pip install 'msckf-ipnet\[bags\]'"):
        open_sequence(path)


def test_images_are_not_kept_in_memory(tmp_path):
    path: Path = write(tmp_path, images(ROS1, 10))
    first = open_sequence(path).frames[0].images[0]
    assert not any(isinstance(x, np.ndarray | bytes) for x in vars(first).values())
    one, other = first.load(), first.load()
    assert one is not other

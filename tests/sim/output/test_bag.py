"""Bags as rosbags itself reads them; what other systems expect of EuRoC's."""

import sqlite3
from contextlib import closing

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from sim.output import write_recording
from tests.sim.output.recordings import HEIGHT, WIDTH, noise_recording

ROS1_DIGESTS = {  # `rosmsg md5` of ROS 1
    "sensor_msgs/msg/Imu": "6a62c6daae103f4ff57a132d6f95cec2",
    "sensor_msgs/msg/Image": "060021388200f6f0f447d0fcd9c64743",
    "geometry_msgs/msg/PoseStamped": "d3812c3cbc69362b77dc0b19b345f8f5",
    "geometry_msgs/msg/Vector3Stamped": "7b324c7325e683bf02a9b14b01090ec7",
}
TYPES = {
    "/imu0": "sensor_msgs/msg/Imu",
    "/cam0/image_raw": "sensor_msgs/msg/Image",
    "/cam1/image_raw": "sensor_msgs/msg/Image",
    "/ground_truth/pose": "geometry_msgs/msg/PoseStamped",
    "/ground_truth/velocity": "geometry_msgs/msg/Vector3Stamped",
    "/ground_truth/gyroscope_bias": "geometry_msgs/msg/Vector3Stamped",
    "/ground_truth/accelerometer_bias": "geometry_msgs/msg/Vector3Stamped",
}
MADE = noise_recording()


@pytest.fixture(params=["ros1", "ros2"])
def reader(request, tmp_path):
    write_recording(MADE, tmp_path / "out", format=request.param)
    with AnyReader([tmp_path / "out" / "recording.bag" if request.param == "ros1" else tmp_path / "out"]) as opened:
        yield opened


def test_topics_and_types_are_eurocs_and_standard(reader):
    assert {c.topic: c.msgtype for c in reader.connections} == TYPES
    if not reader.is2:
        assert {c.msgtype: c.digest for c in reader.connections} == ROS1_DIGESTS


def test_messages_are_received_when_their_headers_say(reader):
    for connection, received_ns, data in reader.messages():
        stamp = reader.deserialize(data, connection.msgtype).header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == received_ns


def test_messages_lie_in_the_bag_in_the_order_of_time(tmp_path):
    write_recording(MADE, tmp_path / "out", format="ros2")
    with closing(sqlite3.connect(tmp_path / "out" / "recording.db3")) as database:
        stamps = [t for (t,) in database.execute("SELECT timestamp FROM messages ORDER BY id")]
    assert len(stamps) == 201 + 4 * 50 + 11
    assert stamps == sorted(stamps)


def said(reader, topic):
    wanted = [c for c in reader.connections if c.topic == topic]
    return [reader.deserialize(data, connection.msgtype) for connection, _, data in reader.messages(wanted)]


def test_the_imu_says_that_it_has_no_orientation(reader):
    messages = said(reader, "/imu0")
    assert len(messages) == len(MADE.imu)
    last = messages[-1]
    assert last.header.frame_id == "imu0"
    assert last.orientation_covariance[0] == -1.0
    assert [getattr(last.angular_velocity, x) for x in "xyz"] == MADE.imu.gyro[-1].tolist()
    assert [getattr(last.linear_acceleration, x) for x in "xyz"] == MADE.imu.accel[-1].tolist()


def test_images_are_mono8_without_padding(reader):
    messages = said(reader, "/cam1/image_raw")
    assert len(messages) == 5
    first = messages[0]
    form = (first.encoding, first.height, first.width, first.step, first.is_bigendian, first.header.frame_id)
    assert form == ("mono8", HEIGHT, WIDTH, WIDTH, 0, "cam1")
    np.testing.assert_array_equal(first.data.reshape(HEIGHT, WIDTH), MADE.frames[0].images[1].load())


def test_poses_are_xyzw(reader):
    pose = said(reader, "/ground_truth/pose")[7].pose
    assert [getattr(pose.orientation, x) for x in "xyzw"] == MADE.truth.q_WB[7].tolist()
    assert [getattr(pose.position, x) for x in "xyz"] == MADE.truth.p_WB[7].tolist()

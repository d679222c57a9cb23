"""A recording as a ROS bag: EuRoC's topics, truth and biases on topics of their own, no clock but the headers'."""

import heapq
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

from navcore.arrays import Image, Stamps, Vectors
from navcore.imu import ImuSamples
from navcore.readers import topics
from navcore.sequence import Sequence
from navcore.trajectory import Trajectory
from sim.errors import ConfigError

BAG = "recording"
"""Stem of the files of a bag."""
_INSTALL = "writing ROS bags needs rosbags: pip install 'msckf-ipnet[bags]'"
_ROS2_METADATA_VERSION = 8  # the newest with the quality of service as text, as releases before Jazzy read it
_LAST_NS = 2**31 * 10**9  # ROS 2 counts seconds in 32 bits with a sign

Item = tuple[int, str, Any]
"""Stamp [ns], topic, message."""


def check_bag(sequence: Sequence) -> None:
    """Raise unless a recording can be a bag.

    Raises:
        ConfigError: rosbags is not installed, tracks instead of images, or stamps that ROS cannot hold.
    """
    try:
        import rosbags.highlevel  # noqa: F401
    except ImportError as error:
        raise ConfigError(_INSTALL) from error
    if any(f.tracks for f in sequence.frames):
        raise ConfigError(f"{sequence.name} has tracks, which bags have no message for; write it as asl")
    stamps = [*sequence.imu.t_ns.tolist(), *(f.t_ns for f in sequence.frames)]
    if min(stamps) < 0 or max(stamps) >= _LAST_NS:
        raise ConfigError(f"stamps from {min(stamps)} to {max(stamps)} ns; bags hold 0 to {_LAST_NS - 1}")


def write_bag(sequence: Sequence, folder: Path, ros: Literal["ros1", "ros2"]) -> list[Path]:
    """Write a bag into an empty folder; its files. Images are loaded one at a time."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros == "ros1" else Stores.ROS2_HUMBLE)
    serialize = store.serialize_ros1 if ros == "ros1" else store.serialize_cdr
    path = folder / (f"{BAG}.bag" if ros == "ros1" else BAG)
    messages = _Messages(store.types)
    with Writer1(path) if ros == "ros1" else Writer2(path, version=_ROS2_METADATA_VERSION) as writer:
        connections = {t: writer.add_connection(t, kind, typestore=store) for t, kind in _types(sequence).items()}
        for t_ns, topic, message in messages.all(sequence):
            connection = connections[topic]
            writer.write(connection, t_ns, serialize(message, connection.msgtype))
    return [path] if ros == "ros1" else sorted(path.iterdir())


def _types(sequence: Sequence) -> dict[str, str]:
    """Type by topic; a camera has its topic even where it saw nothing."""
    types = {topics.IMU: "sensor_msgs/msg/Imu"}
    types |= {topics.camera(k): "sensor_msgs/msg/Image" for k in range(len(sequence.calibration.cameras))}
    if sequence.truth is not None:
        types[topics.TRUTH_POSE] = "geometry_msgs/msg/PoseStamped"
        types |= dict.fromkeys(_vectors(sequence.truth), "geometry_msgs/msg/Vector3Stamped")
    return types


def _vectors(truth: Trajectory) -> dict[str, tuple[str, Vectors]]:
    """What a truth knows beside the pose: frame and values (N, 3) by topic."""
    known = {
        topics.TRUTH_VELOCITY: ("world", truth.v_WB),
        topics.TRUTH_GYROSCOPE_BIAS: ("imu0", truth.b_g),
        topics.TRUTH_ACCELEROMETER_BIAS: ("imu0", truth.b_a),
    }
    return {topic: (frame, values) for topic, (frame, values) in known.items() if values is not None}


class _Messages:
    """Makes ROS's messages out of a recording."""

    def __init__(self, types: dict[str, Callable[..., Any]]) -> None:
        self._types = types
        self._ros1 = "seq" in getattr(types["std_msgs/msg/Header"], "__annotations__", {})

    def all(self, sequence: Sequence) -> Iterator[Item]:
        """Everything, in the order of its stamps."""
        streams = [self._imu(sequence.imu), self._images(sequence)]
        if sequence.truth is not None:
            streams.append(self._poses(sequence.truth))
            for topic, (frame, values) in _vectors(sequence.truth).items():
                streams.append(self._vector_stream(topic, frame, sequence.truth.t_ns, values))
        return heapq.merge(*streams, key=lambda item: item[0])

    def _imu(self, samples: ImuSamples) -> Iterator[Item]:
        unknown = np.zeros(9)
        no_orientation = np.array([-1.0, *([0.0] * 8)])  # as sensor_msgs/Imu wants it where there is none
        attitude = self._make("geometry_msgs", "Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        rows = zip(samples.t_ns.tolist(), samples.gyro.tolist(), samples.accel.tolist(), strict=True)
        for t_ns, gyro, accel in rows:
            message = self._make(
                "sensor_msgs",
                "Imu",
                header=self._header(t_ns, "imu0"),
                orientation=attitude,
                orientation_covariance=no_orientation,
                angular_velocity=self._vector(gyro),
                angular_velocity_covariance=unknown,
                linear_acceleration=self._vector(accel),
                linear_acceleration_covariance=unknown,
            )
            yield t_ns, topics.IMU, message

    def _images(self, sequence: Sequence) -> Iterator[Item]:
        for frame in sequence.frames:
            for index, source in sorted(frame.images.items()):
                yield frame.t_ns, topics.camera(index), self._image(frame.t_ns, index, source.load())

    def _image(self, t_ns: int, index: int, image: Image) -> Any:
        height, width = image.shape
        return self._make(
            "sensor_msgs",
            "Image",
            header=self._header(t_ns, f"cam{index}"),
            height=height,
            width=width,
            encoding="mono8",
            is_bigendian=0,
            step=width,
            data=np.ascontiguousarray(image).reshape(-1),
        )

    def _poses(self, truth: Trajectory) -> Iterator[Item]:
        for t_ns, p, q in zip(truth.t_ns.tolist(), truth.p_WB.tolist(), truth.q_WB.tolist(), strict=True):
            position = self._make("geometry_msgs", "Point", x=p[0], y=p[1], z=p[2])
            orientation = self._make("geometry_msgs", "Quaternion", x=q[0], y=q[1], z=q[2], w=q[3])
            pose = self._make("geometry_msgs", "Pose", position=position, orientation=orientation)
            message = self._make("geometry_msgs", "PoseStamped", header=self._header(t_ns, "world"), pose=pose)
            yield t_ns, topics.TRUTH_POSE, message

    def _vector_stream(self, topic: str, frame: str, stamps: Stamps, values: Vectors) -> Iterator[Item]:
        for t_ns, xyz in zip(stamps.tolist(), values.tolist(), strict=True):
            header, vector = self._header(t_ns, frame), self._vector(xyz)
            yield t_ns, topic, self._make("geometry_msgs", "Vector3Stamped", header=header, vector=vector)

    def _vector(self, xyz: list[float]) -> Any:
        return self._make("geometry_msgs", "Vector3", x=xyz[0], y=xyz[1], z=xyz[2])

    def _header(self, t_ns: int, frame_id: str) -> Any:
        stamp = self._make("builtin_interfaces", "Time", sec=t_ns // 10**9, nanosec=t_ns % 10**9)
        number = {"seq": 0} if self._ros1 else {}
        return self._make("std_msgs", "Header", stamp=stamp, frame_id=frame_id, **number)

    def _make(self, package: str, name: str, **fields: Any) -> Any:
        return self._types[f"{package}/msg/{name}"](**fields)

"""Recordings in ROS bags.

A bag has no calibration: Kalibr's files lie beside it, and what they name as `rostopic` is read. Stamps are
those of the message headers, in whole nanoseconds.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from navcore.arrays import Floats, Stamps
from navcore.calibration import Calibration, CameraMount, cameras_from_kalibr, imu_from_yaml, load_yaml
from navcore.errors import DataError
from navcore.imu import ImuSamples
from navcore.readers import asl, kalibr, topics
from navcore.readers.bag import Bag, BagImage, bags_at, stamp
from navcore.sequence import ImageSource, Sequence
from navcore.trajectory import Trajectory

_TRUTH = (topics.TRUTH_POSE, topics.TRUTH_VELOCITY, topics.TRUTH_GYROSCOPE_BIAS, topics.TRUTH_ACCELEROMETER_BIAS)
_IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")


def recognises(path: Path) -> bool:
    """Whether a path is a bag, or a folder with bags in it, by content."""
    return bool(bags_at(path))


def read(path: Path) -> Sequence:
    """The recording in a bag, or in a folder with one bag in it. Images stay in the bag until they are loaded.

    Raises:
        DataError: no rosbags to read with, several bags, no calibration beside it, a topic is missing (the
            message lists those that are there), or the bag is broken.
    """
    found = bags_at(path)
    if len(found) > 1:
        raise DataError(f"{path}: {len(found)} bags, name one of {', '.join(x.name for x in found)}")
    bag = Bag(found[0])
    places = [path.parent] if path.is_file() else [path, path.resolve().parent]
    calibration, cameras, imu_topic = _calibration(bag, places)
    seen = _read_messages(bag, calibration, cameras, imu_topic)
    imu = seen.imu(f"{path}: {imu_topic}")
    frames, notes = asl.pair(seen.images, {}, calibration, imu)
    notes = [*asl.gaps(imu.t_ns, path), *notes]
    truth = seen.trajectory(path)
    if truth is None:
        notes += [f"{path}: {x} is of a marker, not of the IMU: not read as truth" for x in topics.MARKERS if x in bag]
    name = path.resolve().stem if path.is_file() else path.resolve().name
    return Sequence(name, calibration, imu, frames, truth, tuple(notes))


class _Seen:
    """What the messages said."""

    def __init__(self) -> None:
        self.images: dict[int, dict[int, ImageSource]] = {}
        self._imu: list[tuple[int, tuple[float, ...]]] = []
        self._truth: dict[str, dict[int, tuple[float, ...]]] = {}

    def add_imu(self, message: Any) -> None:
        w, a = message.angular_velocity, message.linear_acceleration
        self._imu.append((stamp(message), (w.x, w.y, w.z, a.x, a.y, a.z)))

    def add_truth(self, topic: str, message: Any) -> None:
        if topic == topics.TRUTH_POSE:
            p, q = message.pose.position, message.pose.orientation
            values: tuple[float, ...] = (p.x, p.y, p.z, q.x, q.y, q.z, q.w)
        else:
            values = (message.vector.x, message.vector.y, message.vector.z)
        self._truth.setdefault(topic, {})[stamp(message)] = values

    def imu(self, where: str) -> ImuSamples:
        """All samples, in the order of their own stamps."""
        if not self._imu:
            raise DataError(f"{where}: no sample")
        self._imu.sort(key=lambda x: x[0])
        values = np.array([x for _, x in self._imu])
        try:
            return ImuSamples(_stamps(t for t, _ in self._imu), values[:, :3], values[:, 3:])
        except DataError as error:
            raise DataError(f"{where}: {error}") from error

    def trajectory(self, path: Path) -> Trajectory | None:
        """The truth, with what its topics know."""
        poses = self._truth.get(topics.TRUTH_POSE)
        if not poses:
            return None
        t_ns = _stamps(sorted(poses))
        values = np.array([poses[t] for t in t_ns.tolist()])
        rest = [self._vectors(topic, t_ns) for topic in _TRUTH[1:]]
        try:
            return Trajectory(t_ns, values[:, 3:], values[:, :3], *rest)
        except DataError as error:
            raise DataError(f"{path}: {topics.TRUTH_POSE}: {error}") from error

    def _vectors(self, topic: str, t_ns: Stamps) -> Floats | None:
        if topic not in self._truth:
            return None
        unknown = (np.nan, np.nan, np.nan)
        return np.array([self._truth[topic].get(t, unknown) for t in t_ns.tolist()])


def _read_messages(bag: Bag, calibration: Calibration, cameras: Mapping[str, int], imu_topic: str) -> _Seen:
    seen = _Seen()
    for topic, received_ns, message in bag.messages(imu_topic, *cameras, *_TRUTH):
        if topic == imu_topic:
            seen.add_imu(message)
        elif topic in cameras:
            index, t_ns = cameras[topic], stamp(message)
            camera = calibration.cameras[index].camera
            image = BagImage(bag, topic, received_ns, t_ns, camera.width, camera.height)
            seen.images.setdefault(t_ns, {})[index] = image
        else:
            seen.add_truth(topic, message)
    return seen


def _calibration(bag: Bag, places: list[Path]) -> tuple[Calibration, dict[str, int], str]:
    """The rig, the topics of its cameras with their index, and the topic of its IMU."""
    imu_file = kalibr.need(places, kalibr.IMU, bag.path)
    content = load_yaml(imu_file)
    imu_topic = str(content.get("imu0", content).get("rostopic", topics.IMU))
    _need(bag, imu_topic, f"{imu_file} can name another as rostopic")
    mounts: tuple[CameraMount, ...] = ()
    cameras: dict[str, int] = {}
    has_images = any(x in _IMAGE_TYPES for x in bag.types.values())
    if has_images or kalibr.find(places, kalibr.CAMERAS) is not None:
        file = kalibr.need(places, kalibr.CAMERAS, bag.path)
        mounts, content = cameras_from_kalibr(file), load_yaml(file)
        for index in range(len(mounts)):
            topic = str(content.get(f"cam{index}", {}).get("rostopic", topics.camera(index)))
            topic = topic + topics.COMPRESSED if topic not in bag and topic + topics.COMPRESSED in bag else topic
            cameras[_need(bag, topic, f"{file} can name another as rostopic")] = index
    return Calibration(imu_from_yaml(imu_file), mounts), cameras, imu_topic


def _need(bag: Bag, topic: str, remedy: str) -> str:
    if topic not in bag:
        found = ", ".join(f"{name} ({kind})" for name, kind in sorted(bag.types.items())) or "none"
        raise DataError(f"{bag.path}: no topic {topic}; {remedy}; topics found: {found}")
    return topic


def _stamps(values: Iterable[int]) -> Stamps:
    return np.array(list(values), dtype=np.int64)

"""An open ROS bag: ROS 1 files, ROS 2 folders, and single .db3 and .mcap files; and an image in it."""

import threading
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from navcore.arrays import Image
from navcore.errors import DataError
from navcore.readers.ros_image import grey

_MAGIC = (b"#ROSBAG V", b"SQLite format 3\0", b"\x89MCAP0\r\n")
_METADATA = "metadata.yaml"  # of a ROS 2 folder
_INSTALL = "reading ROS bags needs rosbags: pip install 'msckf-ipnet[bags]'"


def bags_at(path: Path) -> list[Path]:
    """The bags that a path is, by content: itself, the ROS 2 folder that it is, or the ROS 1 files in it."""
    if path.is_file():
        return [path] if _is_bag(path) else []
    metadata = path / _METADATA
    if metadata.is_file() and "rosbag2_bagfile_information" in metadata.read_text(errors="replace"):
        return [path]
    return sorted(x for x in path.glob("*.bag") if x.is_file() and _is_bag(x))


def _is_bag(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(max(map(len, _MAGIC))).startswith(_MAGIC)


class Bag:
    """An open bag; it is closed when nothing refers to it any more."""

    def __init__(self, path: Path) -> None:
        """Open a file, or a ROS 2 folder.

        Raises:
            DataError: rosbags is not installed, or the bag cannot be read.
        """
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise DataError(f"{path}: {_INSTALL}") from error
        self.path = path
        self._lock = threading.Lock()
        with _explained(path):
            self._reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
            self._reader.open()
        weakref.finalize(self, self._reader.close)
        self.types: dict[str, str] = {x.topic: x.msgtype for x in self._reader.connections}

    def __contains__(self, topic: str) -> bool:
        return topic in self.types

    def messages(self, *names: str, at_ns: int | None = None) -> Iterator[tuple[str, int, Any]]:
        """Topic, time of reception [ns] and message, in order; of all times, or of one."""
        wanted = [x for x in self._reader.connections if x.topic in names]
        end_ns = None if at_ns is None else at_ns + 1
        with self._lock, _explained(self.path):
            for connection, received_ns, data in self._reader.messages(wanted, start=at_ns, stop=end_ns):
                yield connection.topic, received_ns, self._reader.deserialize(data, connection.msgtype)


@dataclass(frozen=True)
class BagImage:
    """An image in a bag, read when asked for."""

    bag: Bag
    topic: str
    received_ns: int
    t_ns: int
    width: int
    height: int

    def load(self) -> Image:
        """The grey image; one that is corrupt or of the wrong size raises `DataError`."""
        where = f"{self.bag.path}: {self.topic} at {self.t_ns} ns"
        found = [m for _, _, m in self.bag.messages(self.topic, at_ns=self.received_ns) if stamp(m) == self.t_ns]
        if not found:
            raise DataError(f"{where}: the image is gone")
        image = grey(found[0], where)
        if image.shape != (self.height, self.width):
            h, w = image.shape
            raise DataError(f"{where}: image is {w}x{h}, calibration says {self.width}x{self.height}")
        return image


def stamp(message: Any) -> int:
    """The stamp in a message's header [ns]."""
    time = message.header.stamp
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Whatever goes wrong in a broken bag is a `DataError` that names it: rosbags raises what it runs into."""
    try:
        yield
    except DataError:
        raise
    except Exception as error:
        raise DataError(f"{path}: cannot be read as a bag: {type(error).__name__}: {error}") from error

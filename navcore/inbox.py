"""What has come and is not answered yet: IMU samples, and frames that wait for the IMU to cover them."""

from collections import deque
from dataclasses import dataclass

from navcore.errors import InputError
from navcore.imu import ImuSamples
from navcore.imu_buffer import ImuBuffer
from navcore.sequence import Frame


@dataclass(frozen=True)
class Due:
    """A frame whose turn it is, at IMU time `t_ns`; `covered` says whether the IMU reaches it."""

    frame: Frame
    t_ns: int
    covered: bool


class Inbox:
    """Takes samples and frames as they come, and hands out each frame once the IMU covers it.

    Args:
        rate_hz: of the IMU.
        max_ahead_s: a frame farther ahead of all that came before is refused, unless the next follows it.
        max_gap_s: by how much the IMU may end before a frame when no more of it comes.
    """

    def __init__(self, rate_hz: float, max_ahead_s: float, max_gap_s: float) -> None:
        self.buffer = ImuBuffer(rate_hz)
        self._max_ahead_s, self._max_gap_s = max_ahead_s, max_gap_s
        self._frames: deque[Frame] = deque()
        self._newest_ns: int | None = None
        self._refused_ns: int | None = None  # stamp of the last frame, if it was refused for being ahead

    def add_imu(self, samples: ImuSamples) -> None:
        """Take samples that follow all earlier ones in time.

        Raises:
            InputError: they do not follow; nothing is taken.
        """
        self.buffer.append(samples)

    def add_frame(self, frame: Frame) -> None:
        """Take the next frame.

        Raises:
            InputError: the frame is not newer than the last, or so far ahead that its stamp must be wrong; it is not
                taken. A second frame that follows one refused for being ahead is.
        """
        last, refused_ns = self._newest_ns, self._refused_ns
        if last is not None:
            if frame.t_ns <= last:
                raise InputError(f"frame at {frame.t_ns} ns does not follow the last, at {last} ns")
            ahead_s = (frame.t_ns - max(last, self.buffer.newest_ns or last)) * 1e-9
            confirmed = refused_ns is not None and 0.0 < (frame.t_ns - refused_ns) * 1e-9 <= self._max_ahead_s
            if ahead_s > self._max_ahead_s and not confirmed:
                self._refused_ns = frame.t_ns
                raise InputError(f"frame at {frame.t_ns} ns is {ahead_s:.1f} s ahead of all that came before")
        self._refused_ns = None
        self._newest_ns = frame.t_ns
        self._frames.append(frame)

    def next(self, offset_ns: int, *, final: bool) -> Due | None:
        """The oldest frame that waits, if its turn has come; it waits no longer.

        Args:
            offset_ns: from camera time to IMU time.
            final: no more samples come.
        """
        if not self._frames:
            return None
        t_ns = self._frames[0].t_ns + offset_ns
        newest = self.buffer.newest_ns
        covered = newest is not None and newest >= t_ns
        if not covered and not final:
            return None
        nearly = newest is not None and t_ns - newest <= round(1e9 * self._max_gap_s)
        return Due(self._frames.popleft(), t_ns, covered or nearly)

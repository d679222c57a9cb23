"""An estimator that is drawn while it runs."""

from collections import deque

from navcore.drawing.canvas import Canvas
from navcore.imu import ImuSamples
from navcore.odometry import Estimate, Following
from navcore.sequence import Frame


class Drawn:
    """The same estimator, whose answers are drawn as they come. Implements `navcore.odometry.Odometry`."""

    def __init__(self, odometry: Following, canvas: Canvas) -> None:
        self._odometry = odometry
        self._canvas = canvas
        self._frames: deque[Frame] = deque()

    def add_imu(self, samples: ImuSamples) -> list[Estimate]:
        """Take samples that follow all earlier ones in time."""
        return self._draw(self._odometry.add_imu(samples))

    def add_frame(self, frame: Frame) -> list[Estimate]:
        """Take the next frame."""
        answers = self._odometry.add_frame(frame)
        self._frames.append(frame)
        return self._draw(answers)

    def finish(self) -> list[Estimate]:
        """No more input comes: estimates for the frames that can still be answered."""
        answers = self._draw(self._odometry.finish())
        self._canvas.flush()
        return answers

    def _draw(self, estimates: list[Estimate]) -> list[Estimate]:
        """Frames are answered in their order, one estimate each; of several at once the last one's tracks are known."""
        for k, estimate in enumerate(estimates, 1):
            tracks = self._odometry.tracks if k == len(estimates) else {}
            self._canvas.add(self._frames.popleft(), estimate, tracks)
        return estimates

"""Live without ROS: drivers call back from threads of their own, one thread runs the filter.

`python examples/callbacks.py [RECORDING]`. IMU and camera need not arrive in the order of their stamps: each keeps its
own order, and a frame waits in the filter until the IMU has passed it. So the estimates are the same to the last bit,
however the threads happen to run.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from queue import Queue
from threading import Thread

import numpy as np

from msckf import Filter
from navcore.imu import ImuSamples
from navcore.odometry import Estimate
from navcore.readers import open_sequence
from navcore.sequence import Frame, Sequence
from sim.points import simulate_points


class LiveOdometry:
    """A filter on a thread of its own; drivers call `on_imu` and `on_frame`, `on_estimate` is called back."""

    def __init__(self, vio: Filter, on_estimate: Callable[[Estimate], None]) -> None:
        self._vio, self._on_estimate = vio, on_estimate
        self._inbox: Queue[ImuSamples | Frame | None] = Queue()
        self._thread = Thread(target=self._work)
        self._thread.start()

    def on_imu(self, t_ns: int, gyro: np.ndarray, accel: np.ndarray) -> None:
        """Rate (3,) rad/s and specific force (3,) m/s^2 in B; returns at once."""
        self._inbox.put(ImuSamples(np.array([t_ns]), gyro[None], accel[None]))

    def on_frame(self, frame: Frame) -> None:
        """Of a picture, (height, width) uint8: Frame(t_ns, images={0: ImageArray(picture)}); returns at once."""
        self._inbox.put(frame)

    def stop(self) -> None:
        """No more input comes; returns when all of it is answered."""
        self._inbox.put(None)
        self._thread.join()

    def _work(self) -> None:
        while (event := self._inbox.get()) is not None:
            answers = self._vio.add_frame(event) if isinstance(event, Frame) else self._vio.add_imu(event)
            for estimate in answers:
                self._on_estimate(estimate)
        for estimate in self._vio.finish():
            self._on_estimate(estimate)


def imu_driver(recording: Sequence, callback: Callable[[int, np.ndarray, np.ndarray], None]) -> None:
    """Samples in bursts, as over a serial line."""
    imu, rng = recording.imu, np.random.default_rng(1)
    for k in range(len(imu)):
        if rng.random() < 0.02:
            time.sleep(1e-3)
        callback(int(imu.t_ns[k]), imu.gyro[k], imu.accel[k])


def camera_driver(recording: Sequence, callback: Callable[[Frame], None]) -> None:
    """Frames as the exposure and the cable let them through."""
    rng = np.random.default_rng(2)
    for frame in recording.frames:
        time.sleep(rng.uniform(0.0, 1e-3))
        callback(frame)


def show(estimate: Estimate) -> None:
    """What a controller would take; quick, since the filter waits for it."""
    estimates.append(estimate)
    if estimate.state is not None and len(estimates) % 20 == 0:
        print(f"{estimate.t_ns * 1e-9:10.3f} s  {estimate.health.value}", estimate.state.p_WB.round(3))


recording = open_sequence(Path(sys.argv[1])) if len(sys.argv) > 1 else simulate_points("quadrotor", seconds=6.0)
estimates: list[Estimate] = []
live = LiveOdometry(Filter(recording.calibration), show)
drivers = [
    Thread(target=imu_driver, args=(recording, live.on_imu)),
    Thread(target=camera_driver, args=(recording, live.on_frame)),
]
for driver in drivers:
    driver.start()
for driver in drivers:
    driver.join()
live.stop()

"""Fake flights written as recordings with images."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from navcore.calibration import Calibration, CameraMount
from navcore.camera import PinholeRadtan
from navcore.sequence import Frame, ImageArray
from navcore.trajectory import Trajectory
from sim.output import write_recording
from tests.eval.fakes import FakeFlight

WIDTH, HEIGHT = 64, 48


def write_flight(folder: Path, name: str, seed: int, biases: bool = True) -> Path:
    """Ten seconds of small images, with truth."""
    flight = FakeFlight(seed, 10.0).load(folder)
    rng = np.random.default_rng(seed)
    frames = [
        Frame(f.t_ns, {0: ImageArray(rng.integers(60, 200, (HEIGHT, WIDTH)).astype(np.uint8))})
        for f in flight.frames[::5]
    ]
    camera = PinholeRadtan(WIDTH, HEIGHT, 50.0, 50.0, 0.5 * (WIDTH - 1), 0.5 * (HEIGHT - 1))
    calibration = Calibration(flight.calibration.imu, (CameraMount(camera, np.eye(4)),))
    t = flight.truth
    truth = t if biases else Trajectory(t.t_ns, t.q_WB, t.p_WB, t.v_WB)
    write_recording(replace(flight, frames=frames, calibration=calibration, truth=truth), folder / name)
    return folder / name

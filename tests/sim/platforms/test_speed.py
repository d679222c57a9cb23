"""How many seconds of motion and IMU a second of one core makes. Run with `tox -e bench`."""

import time

import numpy as np
import pytest

from sim import simulate_motion
from sim.imu import grade, simulate_imu

pytestmark = pytest.mark.bench

SECONDS, TRIES = 60.0, 5


@pytest.mark.parametrize(("platform", "least"), [("quadrotor", 100.0), ("handheld", 100.0), ("rover", 20.0)])
def test_times_real_time(platform: str, least: float) -> None:
    imu = grade("consumer")
    best = np.inf
    for _ in range(TRIES):
        start = time.process_time()
        simulate_imu(simulate_motion(platform, SECONDS), imu, np.random.default_rng(1))
        best = min(best, time.process_time() - start)
    print(f"\n{platform}: {SECONDS / best:.0f} times real time")
    assert SECONDS / best > least

"""What a frame costs. Run with `tox -e bench`; figures are printed, nothing is asserted on time but their existence."""

import dataclasses
import time

import cv2
import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from msckf import Filter, FilterConfig
from navcore.odometry import run
from navcore.readers import open_sequence
from navcore.results import summarise
from navcore.tracker import TrackerConfig
from sim.points import simulate_points

pytestmark = pytest.mark.bench


OPENVINS_MS = {1: (9.1, 9.8), 2: (12.8, 13.4)}
"""Mean CPU of a frame of OpenVINS (release build, one OpenCV thread) on the same images, least and most of its runs."""


def stage_table(sequence, cameras=1, rival_ms=()):
    cv2.setNumThreads(1)
    with threadpool_limits(1):
        vio = Filter(sequence.calibration, FilterConfig(cameras=cameras))
        summary = summarise(run(vio, sequence), sequence)
    cost = summary["cpu_ms_per_frame"]
    print(f"\n{sequence.name}, cameras {cameras}: CPU ms a frame (mean, median), decoding not in the total")
    for name, figures in [("total", cost), *cost["stages"].items()]:
        print(f"  {name:<10} {figures['mean']:7.2f} {figures['median']:7.2f}")
    for ms in rival_ms:
        print(f"  {cost['mean'] / ms:.2f} of OpenVINS's {ms} ms (measured on a quiet machine of 2 cores)")
    print(f"  {summary['frames']} frames; peak memory of the process so far {summary['peak_rss_mb']:.0f} MB")
    return cost


@pytest.mark.parametrize("cameras", [1, 2])
def test_cost_on_real_images(vio_data, cameras):
    sequence = open_sequence(vio_data / "euroc" / "MH_01_easy")
    assert stage_table(sequence, cameras, OPENVINS_MS[cameras])["mean"] > 0.0


def test_cost_in_points_mode():
    sequence = dataclasses.replace(simulate_points(seed=1, seconds=30.0), name="points, 30 s")
    assert stage_table(sequence)["mean"] > 0.0


def test_what_opencv_alone_costs(vio_data):
    """The floor: OpenCV's calls on one pair of images, with as many features as the tracker follows."""
    cv2.setNumThreads(1)
    frames = open_sequence(vio_data / "euroc" / "MH_01_easy").frames
    before, now, right = frames[100].images[0].load(), frames[101].images[0].load(), frames[100].images[1].load()
    config = TrackerConfig()
    uv = cv2.goodFeaturesToTrack(before, config.max_features, 0.01, config.min_distance).reshape(-1, 2)

    def flow(after, start, n, levels):
        size, flags = (config.window, config.window), cv2.OPTFLOW_USE_INITIAL_FLOW
        return cv2.calcOpticalFlowPyrLK(before, after, uv[:n], start[:n].copy(), None, None, size, levels, flags=flags)

    there, half = flow(now, uv, len(uv), config.levels)[0], cv2.pyrDown(before)
    calls = {
        f"flow of {len(uv)}, {config.levels} levels": lambda: flow(now, there, len(uv), config.levels),
        f"flow of {len(uv)}, one level": lambda: flow(now, there, len(uv), 1),
        f"flow of 1, {config.levels} levels": lambda: flow(now, there, 1, config.levels),
        f"flow of 40 to the other camera, {config.levels} levels": lambda: flow(right, uv, 40, config.levels),
        "pyramid, with derivatives": lambda: cv2.buildOpticalFlowPyramid(before, (config.window,) * 2, config.levels),
        "half size": lambda: cv2.pyrDown(before),
        "corners, half size": lambda: cv2.cornerMinEigenVal(half, 3),
        "grey values by a table": lambda: cv2.LUT(before, np.arange(256, dtype=np.uint8)),
    }
    print("\nOpenCV, CPU ms a call (median of 100)")
    for name, call in calls.items():
        times = []
        for _ in range(100):
            begin = time.thread_time()
            call()
            times.append(1e3 * (time.thread_time() - begin))
        print(f"  {name:<36} {np.median(times):6.3f}")
    assert len(uv) > 0

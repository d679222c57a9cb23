"""What a frame costs. Run with `tox -e bench`; figures are printed, nothing is asserted on time but their existence."""

import dataclasses

import cv2
import pytest
from threadpoolctl import threadpool_limits

from msckf import Filter
from navcore.odometry import run
from navcore.readers import open_sequence
from navcore.results import summarise
from sim.points import simulate_points

pytestmark = pytest.mark.bench


def stage_table(sequence):
    cv2.setNumThreads(1)
    with threadpool_limits(1):
        summary = summarise(run(Filter(sequence.calibration), sequence), sequence)
    cost = summary["cpu_ms_per_frame"]
    print(f"\n{sequence.name}: {summary['frames']} frames, CPU ms a frame (mean, median), decoding not in the total")
    for name, figures in [("total", cost), *cost["stages"].items()]:
        print(f"  {name:<10} {figures['mean']:7.2f} {figures['median']:7.2f}")
    print(f"  peak memory {summary['peak_rss_mb']:.0f} MB")
    return cost


def test_cost_on_real_images(vio_data):
    sequence = open_sequence(vio_data / "euroc" / "MH_01_easy")
    assert stage_table(sequence)["mean"] > 0.0


def test_cost_in_points_mode():
    sequence = dataclasses.replace(simulate_points(seed=1, seconds=30.0), name="points, 30 s")
    assert stage_table(sequence)["mean"] > 0.0

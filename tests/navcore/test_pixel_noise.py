"""The pixel noise that innovations tell: from chi-square draws, and in flight."""

import numpy as np
import pytest

from msckf.config import FilterConfig
from msckf.filter import Filter
from navcore.odometry import run
from navcore.pixel_noise import PixelNoise, PixelNoiseConfig
from sim.points import simulate_points


def learned(true_sigma, frames=400, outliers=0.0, features=15, **settings):
    """Sigma after so many frames whose features have the true noise, a share of them ten times as much."""
    rng = np.random.default_rng(1)
    noise = PixelNoise(PixelNoiseConfig(**settings))
    for _ in range(frames):
        dof = 2.0 * rng.integers(4, 12, features) - 3.0
        wrong = rng.random(features) < outliers
        noise.learn(rng.chisquare(dof) * (true_sigma / noise.sigma) ** 2 * np.where(wrong, 100.0, 1.0), dof)
    return noise.sigma


@pytest.mark.parametrize("true_sigma", [0.7, 1.0, 2.5])
def test_it_finds_the_noise_of_the_features(true_sigma):
    assert learned(true_sigma) == pytest.approx(true_sigma, rel=0.08)


def test_a_share_of_wrong_features_does_not_carry_it_away():
    """With a fifth of them wrong, the median is the 62 % quantile of the others."""
    assert 1.0 < learned(1.0, outliers=0.2) < 1.25


def test_bounds_hold():
    assert learned(0.1) == 0.5
    assert learned(20.0) == 4.0


def test_few_features_teach_nothing_nor_do_any_if_nobody_wants_to_learn():
    assert learned(2.5, features=4) == 1.0
    assert learned(2.5, adapt_noise=False) == 1.0


@pytest.mark.parametrize("pixels", [1.0, 2.0])
def test_a_flight_learns_the_noise_of_its_tracks(pixels):
    sequence = simulate_points(seed=2, seconds=15.0, pixel_noise=pixels)
    flown = Filter(sequence.calibration, FilterConfig())
    run(flown, sequence)
    assert flown._window.noise.sigma == pytest.approx(pixels, rel=0.15)

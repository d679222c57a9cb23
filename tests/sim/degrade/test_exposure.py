"""Light and what the sensor makes of it, against what physics says."""

import numpy as np
import pytest

from navcore.sequence import Sequence
from sim.camera.sensor import FULL_WELL, MAX_GAIN
from sim.degrade.exposure import AUTO_EXPOSURE, LOW_LIGHT, OVEREXPOSURE
from sim.radiance import RESPONSE_GAMMA
from tests.sim.degrade.recordings import HEIGHT, WIDTH, all_degraded, degraded, flat, scatter, turning


def electrons(image: np.ndarray, light: float, gain: float) -> np.ndarray:
    """What the sensor counted, from the grey values."""
    return (image.astype(float) / 255.0) ** RESPONSE_GAMMA * FULL_WELL / gain


def test_low_light_has_the_noise_of_its_photons() -> None:
    grey = 120
    radiance = (grey / 255.0) ** RESPONSE_GAMMA
    for severity, light in ((1, LOW_LIGHT[0]), (2, LOW_LIGHT[1])):
        gain = min(1.0 / light, MAX_GAIN)
        image = degraded(turning(flat(grey), frames=20), f"low_light:{severity}@0-1", 5)
        counted = electrons(image, light, gain)
        assert counted.mean() == pytest.approx(radiance * light * FULL_WELL, rel=0.02)
        slope = RESPONSE_GAMMA * counted.mean() / image.mean()  # electrons in a grey value
        # A flat image holds no noise, but is taken to: its share of the variance is missing from what is added.
        missing = counted.mean() * (1.0 - light) + 25.0 * (1.0 - light**2) + 1.5**2 + slope**2 / 12.0
        assert counted.var() == pytest.approx(missing, rel=0.06)


def test_noise_that_an_image_holds_is_not_added_again() -> None:
    """An image with its own shot noise, seen in less light, has the noise of that light: no more, no less."""
    rng = np.random.default_rng(3)
    radiance, light = 0.25, LOW_LIGHT[0]
    counted = rng.poisson(radiance * FULL_WELL, (HEIGHT, WIDTH)) + 5.0 * rng.standard_normal((HEIGHT, WIDTH))
    noisy = np.rint(255.0 * (counted / FULL_WELL) ** (1.0 / RESPONSE_GAMMA)).astype(np.uint8)
    seen = electrons(degraded(turning(noisy, frames=20), "low_light:1@0-1", 5), light, 1.0 / light)
    assert seen.var() == pytest.approx(radiance * light * FULL_WELL + 25.0 + 1.5**2, rel=0.08)


def test_overexposure_scales_light_until_it_saturates() -> None:
    for severity, light in enumerate(OVEREXPOSURE, start=1):
        dim = 0.5 / light
        grey = round(255.0 * dim ** (1.0 / RESPONSE_GAMMA))
        exact = light * (grey / 255.0) ** RESPONSE_GAMMA
        image = degraded(turning(flat(grey), frames=20), f"overexposure:{severity}@0-1", 5)
        assert electrons(image, 1.0, 1.0).mean() == pytest.approx(exact * FULL_WELL, rel=0.01)
        assert degraded(turning(flat(240), frames=20), f"overexposure:{severity}@0-1", 5).min() == 255


def brightness(sequence: Sequence, spec: str) -> np.ndarray:
    """Light that the images show relative to the clean ones, at every frame."""
    clean = (64 / 255.0) ** RESPONSE_GAMMA
    images = all_degraded(sequence, spec, range(len(sequence.frames)))
    return np.array([((image.astype(float) / 255.0) ** RESPONSE_GAMMA).mean() / clean for image in images])


def test_auto_exposure_follows_with_its_time_constant() -> None:
    severity = 3
    following = AUTO_EXPOSURE[severity - 1]
    stops = np.log2(brightness(turning(flat(64), frames=60, cameras=1), f"auto_exposure:{severity}@0-3"))
    assert abs(stops[0]) == pytest.approx(following.stops, abs=0.1)  # the first step is not followed yet
    rest = stops[1 : round(0.5 * following.dwell_s * 20)]  # nothing else happens for half a dwell
    expected = stops[0] * np.exp(-0.05 * np.arange(1, len(rest) + 1) / following.lag_s)
    np.testing.assert_allclose(rest, expected, atol=0.08)
    jumps = np.abs(np.diff(stops)) > 0.5 * following.stops
    assert 1 <= jumps.sum() <= 4


def test_auto_exposure_pays_for_the_dark_with_noise() -> None:
    sequence = turning(flat(64), frames=60, cameras=1)
    noise = [scatter(image) for image in all_degraded(sequence, "auto_exposure:4@0-3", range(0, 60, 2))]
    clean = scatter(degraded(sequence, "auto_exposure:1@0-3", 59))
    assert max(noise) > 1.5 * clean


def test_a_blackout_is_the_noise_of_a_covered_lens() -> None:
    bright, dark = (degraded(turning(flat(grey), frames=20), "blackout@0-1", 5) for grey in (250, 5))
    np.testing.assert_array_equal(bright, dark)  # nothing of the scene comes through
    assert 5.0 < dark.std() < 40.0
    assert np.median(dark) < 40

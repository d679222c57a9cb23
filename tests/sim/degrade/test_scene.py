"""Fog, texture, lamps, dirt, compression: what they leave of an image."""

import cv2
import numpy as np
import pytest

from sim.degrade.codec import JPEG_QUALITY
from sim.degrade.fog import FOG, Fog
from sim.degrade.lamps import LIGHT_SWITCH
from sim.radiance import RESPONSE_GAMMA
from tests.sim.degrade.recordings import HEIGHT, RATE, WIDTH, all_degraded, degraded, flat, scatter, texture, turning


def linear(image: np.ndarray) -> np.ndarray:
    return (image.astype(float) / 255.0) ** RESPONSE_GAMMA


def test_fog_lets_through_what_its_depth_says() -> None:
    """The difference of two flat images under the same fog is the transmission times their difference."""
    for severity in (1, 3):
        through = []
        for k in range(0, 60, 4):
            bright, dim = (degraded(turning(flat(g), cameras=1), f"fog:{severity}@0-3", k) for g in (220, 20))
            through.append((linear(bright) - linear(dim)).mean() / (linear(flat(220)) - linear(flat(20))).mean())
        assert np.mean(through) == pytest.approx(mean_transmission(FOG[severity - 1]), rel=0.25)
        assert np.std(through) > 0.01  # banks


def mean_transmission(fog: Fog) -> float:
    """Of a depth that is normally distributed: the mean of a log-normal variable."""
    return float(np.exp(-fog.depth + 0.5 * (fog.banks * fog.depth) ** 2))


def test_fog_banks_stay_in_the_world_while_the_rig_turns() -> None:
    """The veil of the next frame is that of this one moved by rate x time x focal length."""
    dark = turning(flat(5), cameras=1)
    one, other = (cv2.GaussianBlur(degraded(dark, "fog:1@0-3", k).astype(np.float32), (0, 0), 6.0) for k in (20, 24))
    moved = RATE * 4 * 0.05 * 150.0  # px
    best = min(range(-60, 61, 2), key=lambda s: float(np.mean((shifted(one, s) - shifted(other, 0)) ** 2)))
    assert abs(best) == pytest.approx(moved, abs=16)  # they drift on their own, too


def shifted(image: np.ndarray, by: int) -> np.ndarray:
    return image[20:-20, 64 + by : WIDTH - 64 + by]


def test_lost_texture_keeps_outlines_and_loses_grain() -> None:
    rng = np.random.default_rng(1)
    image = np.clip(
        np.where(np.arange(WIDTH) < WIDTH // 2, 60, 190) + 3.0 * rng.standard_normal((HEIGHT, WIDTH)), 0, 255
    )
    before = image.astype(np.uint8)
    after = degraded(turning(before, frames=20), "texture_loss:1@0-1", 5)
    step = after[:, WIDTH // 2 + 4].mean() - after[:, WIDTH // 2 - 5].mean()
    assert step > 0.85 * 130.0
    # Half the grain goes; the sensor adds what noise is missing to it.
    assert scatter(degraded(turning(before, frames=20), "texture_loss:3@0-1", 5)) < 0.9 * scatter(before)


def test_lamps_switch_at_once_and_return_to_what_was() -> None:
    severity = 4
    frames = 160
    sequence = turning(flat(150), frames=frames, cameras=1, rate=0.0)
    images = all_degraded(sequence, f"light_switch:{severity}@0-8", range(frames))
    means = np.array([linear(image).mean() for image in images])
    relative = means / linear(flat(150)).mean()
    assert relative.max() <= 1.02
    assert relative.min() >= 1.0 - LIGHT_SWITCH[severity - 1].lost - 0.02
    steps = np.abs(np.diff(relative))
    assert (steps > 0.05).sum() >= 3
    assert np.median(steps) < 0.005  # between switchings nothing happens


def test_dirt_stays_in_the_image_and_differs_between_cameras() -> None:
    sequence = turning()
    one, later, other = (
        degraded(sequence, "lens_dirt:4@0-3", k, c).astype(float) for k, c in ((3, 0), (50, 0), (3, 1))
    )
    assert np.abs(one - later).mean() < 4.0 < np.abs(one - other).mean()


def test_each_severity_of_dirt_covers_more() -> None:
    clear = []
    for severity in range(1, 6):
        bright, dim = (linear(degraded(turning(flat(g), frames=20), f"lens_dirt:{severity}@0-1", 5)) for g in (200, 40))
        clear.append((bright - dim).mean())
    assert clear == sorted(clear, reverse=True)
    assert clear[0] > 1.2 * clear[4]


def test_jpeg_is_opencvs() -> None:
    for severity, quality in enumerate(JPEG_QUALITY, start=1):
        _, data = cv2.imencode(".jpg", texture(), (cv2.IMWRITE_JPEG_QUALITY, quality))
        expected = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
        np.testing.assert_array_equal(degraded(turning(frames=20), f"jpeg:{severity}@0-1", 5), expected)

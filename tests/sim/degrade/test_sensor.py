import numpy as np
import pytest

from sim.camera.sensor import FULL_WELL, ImageSensor
from sim.degrade.exposure import COVERED, LOW_LIGHT
from sim.errors import ConfigError
from sim.radiance import LINEAR_MAX, RESPONSE_GAMMA


def flat(radiance: float) -> np.ndarray:
    return np.full((200, 300), round(radiance * LINEAR_MAX), dtype=np.uint16)


@pytest.fixture
def sensor() -> ImageSensor:
    return ImageSensor.of(300, 200, np.random.default_rng(1))


def test_noise_follows_the_photon_transfer_curve(sensor: ImageSensor) -> None:
    """Variance in electrons is signal + read noise^2 + pattern^2 (and the step of an 8-bit grey value)."""
    rng = np.random.default_rng(2)
    for radiance, light in ((0.3, 1.0), (0.6, 1.0), (0.4, 0.1)):
        grey = sensor.develop(flat(radiance), light, rng).astype(float)
        linear = ((grey + 0.0) / 255.0) ** RESPONSE_GAMMA
        electrons = linear * FULL_WELL * max(light, 1.0 / 24.0)
        assert electrons.mean() == pytest.approx(radiance * light * FULL_WELL, rel=0.01)
        step = RESPONSE_GAMMA * electrons.mean() / grey.mean()
        expected = radiance * light * FULL_WELL + 5.0**2 + 1.5**2 + step**2 / 12.0
        assert electrons.var() == pytest.approx(expected, rel=0.05)


def test_each_severity_is_noisier_and_the_dark_ones_are_dark(sensor: ImageSensor) -> None:
    rng = np.random.default_rng(2)
    images = [sensor.develop(flat(0.3), light, rng).astype(float) for light in (1.0, *LOW_LIGHT)]
    noise = [im.std() / im.mean() for im in images]
    assert noise == sorted(noise)
    assert images[1].mean() == pytest.approx(images[0].mean(), rel=0.02)  # gain makes up for it
    assert images[5].mean() == pytest.approx((24.0 * LOW_LIGHT[4]) ** (1.0 / 2.2) * images[0].mean(), rel=0.05)


def test_part_of_the_noise_stays_from_frame_to_frame(sensor: ImageSensor) -> None:
    rng = np.random.default_rng(2)
    a, b = (sensor.develop(flat(0.02), 0.01, rng).astype(float).ravel() for _ in range(2))
    assert 0.03 < np.corrcoef(a, b)[0, 1] < 0.3


def test_a_covered_lens_leaves_noise_around_black(sensor: ImageSensor) -> None:
    image = sensor.develop(flat(0.7), COVERED.light, np.random.default_rng(2), COVERED.gain)
    assert np.median(image) < 40


def test_impossible_light_is_refused(sensor: ImageSensor) -> None:
    for light, gain in ((-1.0, 1.0), (1.0, -1.0)):
        with pytest.raises(ConfigError, match="expected 0 or more"):
            sensor.develop(flat(0.5), light, np.random.default_rng(1), gain)

import numpy as np
import pytest

from sim.camera import LINEAR_MAX
from sim.errors import ConfigError
from sim.scene import RESPONSE_GAMMA
from sim.sensor import FULL_WELL, LIGHT, ImageSensor, light_at


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
    images = [sensor.develop(flat(0.3), light, rng).astype(float) for light in LIGHT]
    noise = [im.std() / im.mean() for im in images]
    assert noise == sorted(noise)
    assert images[1].mean() == pytest.approx(images[0].mean(), rel=0.02)  # gain makes up for it
    assert images[5].mean() < 0.35 * images[0].mean()


def test_part_of_the_noise_stays_from_frame_to_frame(sensor: ImageSensor) -> None:
    rng = np.random.default_rng(2)
    a, b = (sensor.develop(flat(0.02), 0.01, rng).astype(float).ravel() for _ in range(2))
    assert 0.03 < np.corrcoef(a, b)[0, 1] < 0.3


def test_a_covered_lens_leaves_noise_around_black(sensor: ImageSensor) -> None:
    image = sensor.develop(flat(0.0), light_at(3, dark=True), np.random.default_rng(2))
    assert light_at(3, dark=True) == 0.0
    assert np.median(image) < 40


def test_impossible_light_is_refused(sensor: ImageSensor) -> None:
    with pytest.raises(ConfigError, match=r"light is 2\.0, expected from 0 to 1"):
        sensor.develop(flat(0.5), 2.0, np.random.default_rng(1))
    with pytest.raises(ConfigError, match="severity of low_light is 6"):
        light_at(6, dark=False)

"""What is learned of a device."""

import numpy as np
import pytest

from ipnet.device import learn
from ipnet.errors import ConfigError
from ipnet.recordings import Label
from navcore.prior import load_prior
from navcore.priors.constant import learned_from

SD = np.repeat([0.004, 0.08], 3)


def labels(rng, n, mean=None):
    centre = np.zeros(6) if mean is None else mean
    return [Label(f"r{k}", centre + SD * rng.normal(size=6), 1e-12 * np.eye(6)) for k in range(n)]


@pytest.mark.parametrize("n", [2, 3, 5, 30])
def test_the_next_recording_is_inside_what_was_said(n):
    """NEES of the draw that follows, over 2000 devices: near one, and 90 % intervals hold 85 to 97 %."""
    rng = np.random.default_rng(n)
    nees, inside = [], []
    for _ in range(2000):
        *known, following = labels(rng, n + 1)
        device = learn(known)
        r = following.bias - device.mean
        nees.append(r @ np.linalg.solve(device.covariance, r) / 6.0)
        inside.append(np.abs(r) < 1.645 * np.sqrt(np.diagonal(device.covariance)))
    assert 0.85 < np.mean(inside) < 0.97
    assert 0.6 < np.mean(nees) < 1.35


def test_with_many_recordings_it_is_their_mean_and_covariance():
    drawn = labels(np.random.default_rng(1), 3000, np.arange(6.0))
    device = learn(drawn)
    np.testing.assert_allclose(device.mean, np.mean([x.bias for x in drawn], axis=0))
    np.testing.assert_allclose(np.sqrt(np.diagonal(device.covariance)), SD, rtol=0.05)


def test_the_file_is_a_constant_prior(tmp_path):
    device = learn(labels(np.random.default_rng(2), 3))
    device.write(tmp_path / "device.json")
    known = load_prior(f"constant:{tmp_path / 'device.json'}").device()
    np.testing.assert_array_equal(known.vector, device.mean)
    np.testing.assert_array_equal(known.covariance, device.covariance)
    assert learned_from(str(tmp_path / "device.json")) == device.recordings == ("r0", "r1", "r2")


def test_one_recording_says_nothing_of_a_spread():
    with pytest.raises(ConfigError, match="1 recordings"):
        learn(labels(np.random.default_rng(3), 1))


def test_one_recording_twice_is_one():
    (once,) = labels(np.random.default_rng(3), 1)
    with pytest.raises(ConfigError, match="2 recordings, 1 of them different"):
        learn([once, once])


def test_biases_that_never_differ_say_nothing_of_a_spread():
    drawn = np.random.default_rng(4).normal(size=(3, 6)) * np.repeat([0.0, 1.0], 3)
    with pytest.raises(ConfigError, match="biases of a sensor are the same in all of r0, r1, r2"):
        learn([Label(f"r{k}", bias, np.eye(6)) for k, bias in enumerate(drawn)])

"""What a few recordings say of one device: mean and spread of its biases, for its next recording."""

import json
from collections.abc import Sequence as ListLike
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ipnet.errors import ConfigError
from ipnet.files import write_text
from ipnet.recordings import Label
from navcore.arrays import Floats, frozen

_BELIEF = 7.0
"""Recordings' worth of belief that axes are independent and that those of one sensor spread alike."""


@dataclass(frozen=True)
class Device:
    """A prior on the biases of the next recording.

    Attributes:
        mean: (6,) b_g [rad/s], b_a [m/s^2].
        covariance: (6, 6) of the next draw around it.
        recordings: names of those that say so.
    """

    mean: Floats
    covariance: Floats
    recordings: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "mean", frozen("mean", self.mean, np.float64, (6,)))
        object.__setattr__(self, "covariance", frozen("covariance", self.covariance, np.float64, (6, 6)))

    def write(self, path: Path) -> None:
        """Write what `constant:FILE` reads."""
        content = {
            "b_g": self.mean[:3].tolist(),
            "b_a": self.mean[3:].tolist(),
            "covariance": self.covariance.tolist(),
            "recordings": self.recordings,
        }
        write_text(path, json.dumps(content, indent=1) + "\n")


def learn(labels: ListLike[Label]) -> Device:
    """The predictive distribution of the next bias, after n recordings.

    The scatter is joined with an inverse-Wishart prior worth seven recordings, whose scale is the scatter's own
    variance pooled over the three axes of each sensor (empirical Bayes: two recordings hold six differences, of which
    three tell of each sensor). The next draw is Student's t around the mean (Gelman et al., "Bayesian data analysis",
    3rd ed., section 3.6); the Gaussian given here has its covariance, (1 + 1/n) for the mean's own error included.

    Raises:
        ConfigError: fewer than two recordings, which say nothing of a spread, or a sensor's biases never differ.
    """
    names = tuple(label.sequence for label in labels)
    n = len({*names})
    if n < 2 or n < len(names):
        raise ConfigError(
            f"{len(names)} recordings, {n} of them different; a device's spread needs two or more, each once"
        )
    bias = np.array([label.bias for label in labels])
    mean = bias.mean(axis=0)
    scatter = (bias - mean).T @ (bias - mean)  # (6, 6), n - 1 degrees of freedom
    pooled = np.repeat(np.diagonal(scatter).reshape(2, 3).mean(axis=1), 3) / (n - 1)
    if pooled.min() <= 0.0:
        raise ConfigError(f"biases of a sensor are the same in all of {', '.join(names)}; expected some spread")
    spread = (scatter + _BELIEF * np.diag(pooled)) / (n - 1 + _BELIEF)
    freedom = 3.0 * (n - 1)  # behind a sensor's pooled variance
    tails = freedom / (freedom - 2.0)  # variance of Student's t
    return Device(mean, spread * (1.0 + 1.0 / n) * tails, names)

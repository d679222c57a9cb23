"""How noisy the features' positions are, as their innovations tell (docs/filter.md, section 4.7)."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Floats
from navcore.chi_square import chi_square_quantile

_FEATURES = 5  # at a frame, fewer tell nothing
_SLOWEST = 0.02  # share that a frame has in the estimate, in the long run
_QUICKEST = 0.2  # and at the beginning
_LARGEST = 1.0  # step of log(NIS) that is believed of one frame


@dataclass(frozen=True)
class PixelNoiseConfig:
    """What is believed of a feature's position."""

    pixel_noise: float = 1.0  # px, standard deviation of a feature's position in one image, to begin with
    adapt_noise: bool = True  # follow it by the innovations
    least_noise: float = 0.5  # px, bounds of that
    most_noise: float = 4.0


class PixelNoise:
    """Follows the standard deviation under which the median NIS of the features is what it should be.

    The median, since a share of features is always on things that move or follow the wrong point.
    """

    def __init__(self, config: PixelNoiseConfig) -> None:
        self._config = config
        self._frames = 0
        self.sigma = config.pixel_noise  # px

    def learn(self, nis: Floats, dof: Floats, *, only_up: bool = False) -> None:
        """Take what one frame's features (N,) showed, refused ones included, at the present noise.

        `only_up`: they may show that it is too small, not that it is too large.
        """
        c = self._config
        if not c.adapt_noise or len(nis) < _FEATURES:
            return
        surprise = float(np.log(np.median(nis / chi_square_quantile(0.5, dof)) + 1e-9))
        if only_up and surprise <= 0.0:
            return
        self._frames += 1
        share = max(_SLOWEST, _QUICKEST / np.sqrt(self._frames))
        step = 0.5 * share * float(np.clip(surprise, -_LARGEST, _LARGEST))
        self.sigma = float(np.clip(self.sigma * np.exp(step), c.least_noise, c.most_noise))

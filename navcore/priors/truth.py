"""`truth[:SIGMA_G,SIGMA_A]`: the recording's true biases: what a very good prior gives."""

import numpy as np

from navcore.arrays import Mask, Stamps
from navcore.errors import ConfigError
from navcore.prior import BiasPrior, BiasPriorSource
from navcore.priors.listed import ListedPrior
from navcore.sequence import Sequence
from navcore.trajectory import Trajectory

_DEFAULT_SIGMAS = (2e-4, 0.02)  # rad/s, m/s^2
_INTERVAL_NS = 1_000_000_000
_EXPECTED = "truth or truth:SIGMA_G,SIGMA_A (rad/s, m/s^2), both positive"


def make(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """A source that gives the true biases once a second with a stated sigma, each at its own time.

    The values are exact: sigma says how much weight they get. Nothing is constant about their error.

    Raises:
        ConfigError: the sigmas are not two positive numbers, or the recording has no truth with biases.
    """
    sigma_g, sigma_a = _sigmas(argument)
    known = _with_biases(sequence)
    covariance = np.diag(np.repeat([sigma_g**2, sigma_a**2], 3))
    stamps: Stamps = np.arange(known.t_ns[0], known.t_ns[-1] + 1, _INTERVAL_NS, dtype=np.int64)
    stamps = stamps[known.covers(stamps, _INTERVAL_NS)]
    biases = known.at(stamps)
    assert biases.b_g is not None and biases.b_a is not None
    rows = zip(stamps.tolist(), biases.b_g, biases.b_a, strict=True)
    return ListedPrior([BiasPrior(t, b_g, b_a, covariance) for t, b_g, b_a in rows])


def _sigmas(argument: str) -> tuple[float, float]:
    if not argument:
        return _DEFAULT_SIGMAS
    try:
        sigma_g, sigma_a = (float(x) for x in argument.split(","))
    except ValueError as error:
        raise ConfigError(f"bias prior truth:{argument}; expected {_EXPECTED}") from error
    if not (np.isfinite([sigma_g, sigma_a]).all() and min(sigma_g, sigma_a) > 0.0):
        raise ConfigError(f"bias prior truth:{argument}; expected {_EXPECTED}")
    return sigma_g, sigma_a


def _with_biases(sequence: Sequence | None) -> Trajectory:
    """Truth where its biases are finite."""
    if sequence is None:
        raise ConfigError("bias prior 'truth' needs a recording; there is none in live use")
    truth = sequence.truth
    if truth is None:
        raise ConfigError(f"bias prior 'truth': recording {sequence.name} has no truth")
    if truth.b_g is None or truth.b_a is None:
        raise ConfigError(f"bias prior 'truth': the truth of recording {sequence.name} has no biases")
    finite: Mask = np.asarray(np.isfinite(np.hstack([truth.b_g, truth.b_a])).all(axis=1))
    known = truth[finite]
    if len(known) == 0:
        raise ConfigError(f"bias prior 'truth': the truth of recording {sequence.name} has no finite biases")
    return known

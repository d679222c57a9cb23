"""`none`: no prior, the arm that everything is compared with."""

from navcore.errors import ConfigError
from navcore.prior import BiasPriorSource
from navcore.priors.listed import ListedPrior
from navcore.sequence import Sequence


def make(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """A source that knows nothing.

    Raises:
        ConfigError: there is an argument.
    """
    if argument:
        raise ConfigError(f"bias prior 'none' takes no argument, got {argument!r}")
    return ListedPrior()

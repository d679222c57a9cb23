"""`corrector:NAME`: a network that corrects the IMU's samples; its mean correction is its statement."""

from ipnet.network_source import NetworkPrior
from ipnet.rivals.shipped import find
from ipnet.weights import Card
from navcore.prior import BiasPriorSource
from navcore.sequence import Sequence


def make(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """The source with the weights of that name or in that folder.

    Raises:
        ConfigError: there are none; the message lists the names.
    """
    folder = find("corrector", argument)
    return NetworkPrior(folder, Card.read(folder))

"""What sources were made from: where they are scored on that, a score says so."""

from collections.abc import Callable, Iterable

from ipnet import joined, weights
from ipnet.motion import store
from ipnet.rivals import learned, window_mean
from navcore.prior import split_prior
from navcore.priors import constant


def seen_by(spec: str) -> frozenset[str]:
    """Names of the recordings that the sources in a spec were trained, chosen or calibrated by.

    Sources that are made from none have seen none; nor has `constant:FILE` where its file does not say.

    Raises:
        ConfigError: a source has nothing of the name in the spec.
        DataError: a device's file is missing or wrong.
    """
    parts = [part.partition(":") for part in split_prior(spec)]
    return frozenset(name for source, _, argument in parts if source in _SEEN for name in _SEEN[source](argument))


def _network(argument: str) -> Iterable[str]:
    card = weights.Card.read(weights.find(argument))
    return card.training + card.validation


def _motion(argument: str) -> Iterable[str]:
    card = store.MotionCard.read(store.find(argument))
    return card.training + card.validation


def _joined(argument: str) -> Iterable[str]:
    join = joined.find(argument)
    return frozenset(join.recordings).union(*(seen_by(spec) for spec in join.specs))


def _window_mean(argument: str) -> Iterable[str]:
    return window_mean.load(argument).recordings


def _learned(rival: str) -> Callable[[str], Iterable[str]]:
    def seen(argument: str) -> Iterable[str]:
        card = learned.RivalCard.read(learned.find(rival, argument))
        return card.training + card.validation

    return seen


_SEEN: dict[str, Callable[[str], Iterable[str]]] = {
    "constant": constant.learned_from,
    "ipnet": _network,
    "motion": _motion,
    "ipnet+motion": _joined,
    "window-mean": _window_mean,
    "recursive": _learned("recursive"),
    "corrector": _learned("corrector"),
}

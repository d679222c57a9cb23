"""What a bias prior had to show, and what it did: the best learned prior against bars that were set beforehand."""

from collections.abc import Iterable
from dataclasses import dataclass

from eval.tables import NOTHING, Table, percent
from eval.verdict import Lost, Verdict

_LEARNED = ("motion", "ipnet", "ipnet+motion")
"""Arms that infer biases by what was learned from other recordings, with the model of their error."""
_PLAIN, _TRUTH = "paper-plain", "truth"
_DEGRADED, _CLEAN, _SHARE, _BETTER, _NEES = 0.54, 1.02, 0.5, 0.9, (0.75, 1.3)


@dataclass(frozen=True)
class _Column:
    """What is said of one estimator: the best learned prior, the true biases, the network as the paper weighs it."""

    best: Verdict
    truth: Verdict
    plain: Verdict


def claims_table(found: Iterable[Verdict]) -> Table | None:
    """A row for each claim, its bar, and what came of it with each estimator; None without a learned prior.

    The best learned prior of an estimator has the lowest ratio in degraded cells. Beside it stand the true biases,
    which say what there was to gain, and the network as the paper weighs it.
    """
    by_arm = {(v.estimator, v.arm): v for v in found}
    columns = {}
    for name in dict.fromkeys(estimator for estimator, _ in by_arm):
        ratios = {arm: by_arm[name, arm].ratio for arm in _LEARNED if (name, arm) in by_arm}
        known = {arm: ratio for arm, ratio in ratios.items() if ratio is not None}
        if known:
            shown = (min(known, key=lambda arm: known[arm]), _TRUTH, _PLAIN)
            columns[name] = _Column(*(by_arm.get((name, arm), Verdict(name, arm)) for arm in shown))
    if not columns:
        return None
    told = columns.values()
    rows = (
        ("best learned prior", "", *(c.best.arm for c in told)),
        ("degraded cells: ATE with it", percent(_DEGRADED), *(_degraded(c.best) for c in told)),
        ("… with the true biases", "", *(_change(c.truth) for c in told)),
        ("… with the network, weighted as the paper does", "", *(_change(c.plain) for c in told)),
        ("… runs that only it saves / loses", "", *(_lost(c.best.lost) for c in told)),
        ("… that the network so weighted does", "", *(_lost(c.plain.lost) for c in told)),
        ("clean cells: mean ATE with it", f"≤ {percent(_CLEAN)}", *(_clean(c.best) for c in told)),
        ("… cells that are worse", "0", *(_worse(c.best) for c in told)),
        ("share of the true biases' gain, where certain", f"≥ {_SHARE:.0%}", *(_share(c.best) for c in told)),
        ("… there better than the device's memory", f"≥ {_BETTER:.0%}", *(_better(c.best) for c in told)),
        ("clean cells: NEES of b_g, b_a with it", "0.75…1.3", *(_nees(c.best) for c in told)),
        ("… with the network, weighted as the paper does", "", *(_pair(c.plain) for c in told)),
    )
    return Table("What was to be shown, and what came of it", ("", "bar", *columns), rows)


def _held(text: str, met: bool) -> str:
    return text if met else f"{text}: not met"


def _change(v: Verdict) -> str:
    if v.ratio is None:
        return NOTHING
    interval = f" ({percent(v.low)} … {percent(v.high)})" if v.low is not None and v.high is not None else ""
    return f"{percent(v.ratio)}{interval}"


def _degraded(v: Verdict) -> str:
    return _held(_change(v), v.ratio is not None and v.ratio <= _DEGRADED)


def _lost(lost: Lost) -> str:
    return f"{lost.rescued} / {lost.spoilt}"


def _clean(v: Verdict) -> str:
    if v.clean is None:
        return NOTHING
    return _held(f"{100.0 * (v.clean - 1.0):+.1f} %".replace("-", "−"), v.clean <= _CLEAN)


def _worse(v: Verdict) -> str:
    return _held(f"{v.worse[0]} of {v.worse[1]}", v.worse[0] == 0) if v.worse[1] else NOTHING


def _share(v: Verdict) -> str:
    if v.share is None:
        return NOTHING
    return _held(f"{v.share:.0%} of {v.certain} cells".replace("-", "−"), v.share >= _SHARE)


def _better(v: Verdict) -> str:
    return _held(f"{v.beats_constant:.0%}", v.beats_constant >= _BETTER) if v.beats_constant is not None else NOTHING


def _pair(v: Verdict) -> str:
    return ", ".join(f"{n:.2f}" if n is not None else NOTHING for n in v.nees)


def _nees(v: Verdict) -> str:
    known = [n for n in v.nees if n is not None]
    return _held(_pair(v), all(_NEES[0] <= n <= _NEES[1] for n in known)) if known else NOTHING

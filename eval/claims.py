"""What a bias prior had to show, and what it did: the best learned prior against bars that were set beforehand."""

from collections.abc import Iterable
from dataclasses import dataclass

from eval.tables import NOTHING, Table, percent
from eval.verdict import Lost, Verdict, change, clean_change, honesty, portion

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
    least, most = _NEES
    rows = (
        ("best learned prior", "", *(c.best.arm for c in told)),
        ("degraded cells: ATE with it", percent(_DEGRADED), *(_degraded(c.best) for c in told)),
        ("… with the true biases", "", *(change(c.truth) for c in told)),
        ("… with the network, weighted as the paper does", "", *(change(c.plain) for c in told)),
        ("… runs that only it saves / loses", "", *(_lost(c.best.lost) for c in told)),
        ("… that the network so weighted does", "", *(_lost(c.plain.lost) for c in told)),
        ("clean cells: mean ATE with it", f"≤ {percent(_CLEAN)}", *(_clean(c.best) for c in told)),
        ("… cells that are worse", "0", *(_worse(c.best) for c in told)),
        ("share of the true biases' gain, where certain", f"≥ {portion(_SHARE)}", *(_share(c.best) for c in told)),
        ("… there better than the device's memory", f"≥ {portion(_BETTER)}", *(_better(c.best) for c in told)),
        ("clean cells: NEES of b_g, b_a with it", f"{least}…{most}", *(_nees(c.best) for c in told)),
        ("… with the network, weighted as the paper does", "", *(honesty(c.plain) for c in told)),
    )
    return Table("What was to be shown, and what came of it", ("", "bar", *columns), rows)


def _held(text: str, met: bool | None) -> str:
    """What came of a claim; `met` is None if nothing did."""
    return NOTHING if met is None else text if met else f"{text}: not met"


def _degraded(v: Verdict) -> str:
    return _held(change(v), None if v.ratio is None else v.ratio <= _DEGRADED)


def _lost(lost: Lost) -> str:
    return f"{lost.rescued} / {lost.spoilt}"


def _clean(v: Verdict) -> str:
    return _held(clean_change(v), None if v.clean is None else v.clean <= _CLEAN)


def _worse(v: Verdict) -> str:
    worse, cells = v.worse
    return _held(f"{worse} of {cells}", worse == 0 if cells else None)


def _share(v: Verdict) -> str:
    return _held(f"{portion(v.share)} of {v.certain} cells", None if v.share is None else v.share >= _SHARE)


def _better(v: Verdict) -> str:
    return _held(portion(v.beats_constant), None if v.beats_constant is None else v.beats_constant >= _BETTER)


def _nees(v: Verdict) -> str:
    known = [n for n in v.nees if n is not None]
    return _held(honesty(v), all(_NEES[0] <= n <= _NEES[1] for n in known) if known else None)

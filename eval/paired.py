"""Is one arm better than another? The ratio of ATE seed by seed, with an interval; divergence apart."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import binom, wilcoxon

from eval.alignment import align
from eval.errors import StudyError
from eval.records import Record
from navcore.arrays import Floats

CONFIDENCE = 0.95
GROUP = ["platform", "regime", "condition", "estimator"]
_CELL = ["platform", "regime", "condition", "level", "axis", "seed", "estimator", "arm"]
_SHOWN = [*_CELL, "recording"]


@dataclass(frozen=True)
class Paired:
    """An arm against the base, over the seeds of one group.

    Attributes:
        platform, regime, condition, estimator: the group.
        arm, base: what is compared.
        seeds: those where both arms gave a result that did not diverge.
        log_ratios: (N,) ln(ATE of the arm / ATE of the base), both on the samples that both have.
        median: exp of the median log-ratio; below 1 the arm is better. None without any pair.
        low, high: its interval at 95 %; None with fewer than six pairs, where there is none.
        p_value: Wilcoxon's signed-rank test, two-sided; None likewise.
        diverged, base_diverged, failed: runs that are left out of the ratio.
    """

    platform: str
    regime: str
    condition: str
    estimator: str
    arm: str
    base: str
    seeds: tuple[int, ...]
    log_ratios: Floats
    median: float | None
    low: float | None
    high: float | None
    p_value: float | None
    diverged: int
    base_diverged: int
    failed: int

    @property
    def group(self) -> tuple[str, str, str, str]:
        """Whose runs are compared."""
        return self.platform, self.regime, self.condition, self.estimator


def share(pair: Paired, truth: Paired) -> float | None:
    """The gain of an arm as a share of that of the truth (logarithms); None where one of them is not known."""
    if pair.median is None or truth.median is None:
        return None
    return float(np.log(pair.median) / np.log(truth.median))


def frame(records: Iterable[Record]) -> pd.DataFrame:
    """All records as a table: a row for each cell with its names, its failure and its scores.

    A run without any pose has an infinite ATE, so that medians do not forget it.

    Raises:
        StudyError: two records are of the same cell.
    """
    rows = [
        {name: r.config[name] for name in _SHOWN} | {"key": r.key, "failure": r.failure} | r.scores for r in records
    ]
    table = pd.DataFrame(rows, columns=None if rows else [*_SHOWN, "key", "failure"])
    for name in ("ate_m", "ate_deg", "diverged", "completeness"):
        if name not in table:
            table[name] = np.nan
    table.loc[(table.diverged == 1.0) & table.ate_m.isna(), "ate_m"] = np.inf
    twice = table[table.duplicated(_CELL)]
    if len(twice):
        raise StudyError(f"two records of one cell: {dict(twice.iloc[0][_CELL])}")
    return table


def paired(records: Iterable[Record], base: str) -> list[Paired]:
    """Every arm against `base`, group by group, in the order in which they come."""
    records = list(records)
    table, by_key = frame(records), {r.key: r for r in records}
    result = []
    for _, group in table.groupby(GROUP, sort=False):
        at_base = group[group.arm == base].set_index("seed")
        for arm in [a for a in group.arm.unique() if a != base]:
            result.append(_compare(group[group.arm == arm].set_index("seed"), at_base, base, by_key))
    return result


def common_ates(first: Record, second: Record) -> tuple[float, float] | None:
    """ATE [m] of two runs of one flight on the stamps at which both have a pose, each aligned by itself.

    None without such a stamp.
    """
    if first.series.empty or second.series.empty:
        return None
    stamps = first.series["t_ns"].to_numpy(), second.series["t_ns"].to_numpy()
    _, i, j = np.intersect1d(stamps[0], stamps[1], return_indices=True)
    estimates = first.column("p_WB")[i], second.column("p_WB")[j]
    truths = first.column("true_p_WB")[i], second.column("true_p_WB")[j]
    good = np.isfinite(np.hstack([*estimates, *truths])).all(axis=1)
    if not good.any():
        return None
    a, b = (_ate(e[good], t[good]) for e, t in zip(estimates, truths, strict=True))
    return a, b


def median_interval(values: Floats) -> tuple[float, float] | None:
    """An interval that holds the median with at least 95 %, by order statistics, for any distribution.

    None where so few values cannot give one (fewer than six).
    Source: Conover, "Practical nonparametric statistics" (1999), section 3.2.
    """
    below = int(binom.ppf(0.5 * (1.0 - CONFIDENCE), len(values), 0.5)) if len(values) else 0
    if below == 0:
        return None
    ordered = np.sort(values)
    return float(ordered[below - 1]), float(ordered[-below])


def _compare(rows: pd.DataFrame, at_base: pd.DataFrame, base: str, by_key: dict[str, Record]) -> Paired:
    seeds, ratios = [], []
    for seed in rows.index.intersection(at_base.index):
        pair = rows.loc[seed], at_base.loc[seed]
        if any(isinstance(x.failure, str) or x.diverged != 0.0 for x in pair):
            continue
        ates = common_ates(by_key[pair[0].key], by_key[pair[1].key])
        if ates is not None and min(ates) > 0.0:
            seeds.append(int(seed))
            ratios.append(np.log(ates[0] / ates[1]))
    values = np.array(ratios)
    interval = median_interval(values)
    first = rows.iloc[0]
    failed = int(rows.failure.notna().sum() + at_base.failure.notna().sum())
    return Paired(
        platform=first.platform,
        regime=first.regime,
        condition=first.condition,
        estimator=first.estimator,
        arm=first.arm,
        base=base,
        seeds=tuple(seeds),
        log_ratios=values,
        median=float(np.exp(np.median(values))) if len(values) else None,
        low=float(np.exp(interval[0])) if interval else None,
        high=float(np.exp(interval[1])) if interval else None,
        p_value=float(wilcoxon(values).pvalue) if interval and np.any(values != 0.0) else None,
        diverged=int((rows.diverged == 1.0).sum()),
        base_diverged=int((at_base.diverged == 1.0).sum()),
        failed=failed,
    )


def _ate(p_VB: Floats, p_WB: Floats) -> float:
    alignment = align(p_VB, p_WB)
    errors = p_VB @ alignment.R_WV.T + alignment.p_WV - p_WB
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))

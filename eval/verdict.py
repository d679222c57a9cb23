"""What a study says of priors as a whole: where vision is bad and where it is clean, against nothing, the device's
memory and the truth, for each estimator apart."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from eval.arms import BASE
from eval.paired import CONFIDENCE, Paired, frame, paired
from eval.records import Record
from eval.tables import NOTHING, Table, percent
from navcore.arrays import Floats

CONSTANT, TRUTH = "constant", "truth"
BIASES = ("b_g", "b_a")
_DRAWS = 2000
_FEWEST = 6  # groups of runs, fewer give no interval


@dataclass(frozen=True)
class Verdict:
    """One arm of one estimator over all cells of a study, which were chosen by design.

    Attributes:
        estimator, arm: whose.
        runs: pairs with the base in degraded cells, neither of which diverged.
        ratio: median of ATE over that of the base in them; None without any.
        low, high: its interval at 95 %, by drawing flights anew (all cells that share a flight's noise together).
        rescued, spoilt: degraded runs in which only the base diverged, and only the arm.
        clean: mean (of logarithms) of the same ratio over the clean cells' medians.
        worse: clean cells whose whole interval is above 1, and of how many.
        share: median over those degraded cells in which the gain of the truth is certain, of this arm's gain as a share
            of it (logarithms); None without such a cell.
        certain: how many cells those are.
        beats_constant: share of the paired runs in these cells that are better than with the device's memory.
        nees: mean by degree of freedom of b_g and of b_a over the runs of clean cells that have one.
    """

    estimator: str
    arm: str
    runs: int
    ratio: float | None
    low: float | None
    high: float | None
    rescued: int
    spoilt: int
    clean: float | None
    worse: tuple[int, int]
    share: float | None
    certain: int
    beats_constant: float | None
    nees: tuple[float | None, float | None]


def verdicts(records: Iterable[Record], base: str = BASE) -> list[Verdict]:
    """All arms but the base, estimator by estimator; empty where no cell counts as degraded or as clean."""
    records = [r for r in records if r.config.get("kind", "other") != "other"]
    kinds = {_place(r.config): str(r.config["kind"]) for r in records}
    pairs, beside_constant = paired(records, base), paired(records, CONSTANT)
    honest = [r for r in records if r.config["kind"] == "clean"]
    table = frame(records)
    found = []
    for estimator in table.estimator.unique():
        own = [p for p in pairs if p.estimator == estimator]
        sure = {p.group: p for p in own if p.arm == TRUTH and p.high is not None and p.high < 1.0}
        for arm in dict.fromkeys(p.arm for p in own):
            mine = [p for p in own if p.arm == arm]
            degraded = [p for p in mine if kinds[_of(p)] == "degraded"]
            clean = [p for p in mine if kinds[_of(p)] == "clean"]
            ratio, low, high = _pooled(degraded)
            runs = table[(table.estimator == estimator) & table.arm.isin((base, arm))]
            rescued, spoilt = _survival(runs[[kinds[_place(row)] == "degraded" for _, row in runs.iterrows()]], arm)
            known = [p for p in degraded if p.group in sure and p.median is not None]
            against = [p for p in beside_constant if p.estimator == estimator and p.arm == arm and p.group in sure]
            found.append(
                Verdict(
                    estimator=str(estimator),
                    arm=arm,
                    runs=sum(len(p.seeds) for p in degraded),
                    ratio=ratio,
                    low=low,
                    high=high,
                    rescued=rescued,
                    spoilt=spoilt,
                    clean=_mean(clean),
                    worse=(sum(p.low is not None and p.low > 1.0 for p in clean), len(clean)),
                    share=float(np.median([_share(p, sure[p.group]) for p in known])) if known else None,
                    certain=len(known),
                    beats_constant=_better(against),
                    nees=_nees([r for r in honest if (r.config["estimator"], r.config["arm"]) == (estimator, arm)]),
                )
            )
    return found


def verdict_table(found: Iterable[Verdict]) -> Table:
    """A row for each estimator and arm."""
    columns = (
        *("estimator", "arm", "degraded: ATE (95 %)", "pairs", "rescued / spoilt", "clean: ATE", "clean cells worse"),
        *("share of truth's gain", "cells where that is certain", "better than constant", "NEES b_g, b_a"),
    )
    rows = []
    for v in found:
        interval = f" ({percent(v.low)} … {percent(v.high)})" if v.low is not None and v.high is not None else ""
        rows.append(
            (
                *(v.estimator, v.arm),
                f"{percent(v.ratio)}{interval}" if v.ratio is not None else NOTHING,
                *(str(v.runs), f"{v.rescued} / {v.spoilt}"),
                f"{100.0 * (v.clean - 1.0):+.1f} %".replace("-", "−") if v.clean is not None else NOTHING,
                f"{v.worse[0]} of {v.worse[1]}",
                f"{v.share:.0%}".replace("-", "−") if v.share is not None else NOTHING,
                str(v.certain),
                f"{v.beats_constant:.0%}" if v.beats_constant is not None else NOTHING,
                ", ".join(f"{n:.2f}" if n is not None else NOTHING for n in v.nees),
            )
        )
    return Table("What each prior does, over all cells", columns, tuple(rows), labels=2)


def _pooled(pairs: list[Paired]) -> tuple[float | None, float | None, float | None]:
    """Median ratio over the pairs of all cells, with an interval by a bootstrap of whole flights."""
    flights: dict[tuple[str, int], list[float]] = {}
    for p in pairs:
        for seed, value in zip(p.seeds, p.log_ratios, strict=True):
            flights.setdefault((p.platform, seed), []).append(float(value))
    if not flights:
        return None, None, None
    groups = [np.array(values) for values in flights.values()]
    median = float(np.exp(np.median(np.concatenate(groups))))
    if len(groups) < _FEWEST:
        return median, None, None
    rng = np.random.default_rng(0)
    drawn = rng.integers(len(groups), size=(_DRAWS, len(groups)))
    medians = [np.median(np.concatenate([groups[k] for k in row])) for row in drawn]
    low, high = np.quantile(medians, [0.5 * (1.0 - CONFIDENCE), 0.5 * (1.0 + CONFIDENCE)])
    return median, float(np.exp(low)), float(np.exp(high))


def _mean(pairs: list[Paired]) -> float | None:
    """Of the medians' logarithms."""
    medians = np.array([p.median for p in pairs if p.median is not None])
    return float(np.exp(np.mean(np.log(medians)))) if len(medians) else None


def _survival(runs: pd.DataFrame, arm: str) -> tuple[int, int]:
    """Runs in which only the base diverged, and only the arm."""
    wide = runs.pivot_table(
        index=["platform", "regime", "condition", "seed"], columns="arm", values="diverged", aggfunc="max"
    )
    if len(wide.columns) < 2:
        return 0, 0
    mine, other = wide[arm], wide[next(name for name in wide.columns if name != arm)]
    return int(((other == 1.0) & (mine == 0.0)).sum()), int(((mine == 1.0) & (other == 0.0)).sum())


def _share(pair: Paired, truth: Paired) -> float:
    assert pair.median is not None and truth.median is not None
    return float(np.log(pair.median) / np.log(truth.median))


def _better(pairs: list[Paired]) -> float | None:
    ratios = np.concatenate([p.log_ratios for p in pairs]) if pairs else np.zeros(0)
    return float(np.mean(ratios < 0.0)) if len(ratios) else None


def _nees(records: list[Record]) -> tuple[float | None, float | None]:
    """Mean by degree of freedom over the moments of each run, then over runs, of the biases."""
    means: list[float | None] = []
    for name in BIASES:
        column = f"nees_{name}"
        runs: list[Floats] = [r.series[column].to_numpy() for r in records if column in r.series]
        values = [float(np.nanmean(run)) for run in runs if np.isfinite(run).any()]
        means.append(float(np.mean(values)) / 3.0 if values else None)
    return means[0], means[1]


def _place(config: "pd.Series | dict[str, object]") -> tuple[str, str, str]:
    return str(config["platform"]), str(config["regime"]), str(config["condition"])


def _of(pair: Paired) -> tuple[str, str, str]:
    return pair.platform, pair.regime, pair.condition

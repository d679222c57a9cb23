"""What a study says of priors as a whole: where vision is bad and where it is clean, against nothing, the device's
memory and the truth, for each estimator apart."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from eval.arms import BASE
from eval.paired import CONFIDENCE, GROUP, Paired, frame, paired, share
from eval.records import Record
from eval.tables import NOTHING, Table, percent
from navcore.arrays import Floats

_CONSTANT, _TRUTH = "constant", "truth"
_BIASES = ("db_g", "db_a")
_CELL = GROUP[:-1]  # but for the estimator
_DRAWS = 2000
_FEWEST = 6  # seeds, fewer give no interval


@dataclass(frozen=True)
class Lost:
    """Runs that only one of two arms lost: it diverged or raised, and the other did not."""

    rescued: int = 0  # only the base
    spoilt: int = 0  # only the arm


@dataclass(frozen=True)
class Verdict:
    """One arm of one estimator over all cells of a study, which were chosen by design.

    Attributes:
        estimator, arm: whose; of the base only what it says of itself.
        runs: pairs with the base in degraded cells, neither of which diverged.
        ratio: median of ATE over that of the base in them; None without any.
        low, high: its interval at 95 %, by drawing seeds anew: all runs of a seed share their IMU's noise.
        lost, clean_lost: runs that only one of them lost, in degraded cells and in clean ones.
        clean: mean (of logarithms) of the same ratio over the clean cells' medians.
        worse: clean cells whose whole interval is above 1, and of how many.
        share: median over those degraded cells in which the gain of the truth is certain, of this arm's gain as a share
            of it (logarithms); None without such a cell.
        certain: how many cells those are.
        beats_constant: share of the paired runs in these cells that are better than with the device's memory.
        nees: mean by degree of freedom of b_g and of b_a over the runs of clean cells that know it and did not diverge.
    """

    estimator: str
    arm: str
    runs: int = 0
    ratio: float | None = None
    low: float | None = None
    high: float | None = None
    lost: Lost = Lost()
    clean_lost: Lost = Lost()
    clean: float | None = None
    worse: tuple[int, int] = (0, 0)
    share: float | None = None
    certain: int = 0
    beats_constant: float | None = None
    nees: tuple[float | None, float | None] = (None, None)


def verdicts(records: Iterable[Record], base: str = BASE) -> list[Verdict]:
    """All arms, estimator by estimator; runs that regimes share count once. Empty if no cell is degraded or clean."""
    counted, seen = [], set()
    for record in records:
        arm = record.config["arm"]
        if record.config.get("kind", "other") != "other" and (arm == base or (record.key, arm) not in seen):
            counted.append(record)  # what is compared with the base may stand beside it in another regime
            seen.add((record.key, arm))
    if not counted:
        return []
    kinds = {tuple(str(r.config[n]) for n in _CELL): str(r.config["kind"]) for r in counted}
    pairs, beside_constant = paired(counted, base), paired(counted, _CONSTANT)
    table = frame(counted)
    table["kind"] = [r.config["kind"] for r in counted]
    found = []
    for estimator in table.estimator.unique():
        own = [p for p in pairs if p.estimator == estimator]
        runs = table[table.estimator == estimator]
        gains = [p for p in own if p.arm == _TRUTH and kinds[p.group[:-1]] == "degraded"]
        sure = {p.group: p for p in gains if p.high is not None and p.high < 1.0}
        for arm in runs.arm.unique():
            honest = [r for r in counted if (r.config["estimator"], r.config["arm"]) == (estimator, arm)]
            alone = {r.key: r for r in honest if r.config["kind"] == "clean" and r.scores.get("diverged") == 0.0}
            nees = _nees(alone.values())
            if arm == base:
                found.append(Verdict(str(estimator), arm, nees=nees))
                continue
            mine = [p for p in own if p.arm == arm]
            degraded, clean = ([p for p in mine if kinds[p.group[:-1]] == kind] for kind in ("degraded", "clean"))
            ratio, low, high = _pooled(degraded)
            shares = [share(p, sure[p.group]) for p in degraded if p.group in sure]
            known = [x for x in shares if x is not None]
            against = [p for p in beside_constant if p.estimator == estimator and p.arm == arm and p.group in sure]
            found.append(
                Verdict(
                    estimator=str(estimator),
                    arm=arm,
                    runs=sum(len(p.seeds) for p in degraded),
                    ratio=ratio,
                    low=low,
                    high=high,
                    lost=_lost(runs[runs.kind == "degraded"], arm, base),
                    clean_lost=_lost(runs[runs.kind == "clean"], arm, base),
                    clean=_mean(clean),
                    worse=(sum(p.low is not None and p.low > 1.0 for p in clean), len(clean)),
                    share=float(np.median(known)) if known else None,
                    certain=len(known),
                    beats_constant=_better(against),
                    nees=nees,
                )
            )
    return found


def verdict_table(found: Iterable[Verdict]) -> Table:
    """A row for each estimator and arm."""
    columns = (
        *("estimator", "arm", "degraded: ATE (95 %)", "pairs", "rescued / spoilt"),
        *("clean: ATE", "clean cells worse", "rescued / spoilt"),
        *("share of truth's gain", "cells where that is certain", "better than constant", "NEES b_g, b_a"),
    )
    rows = []
    for v in found:
        told = (
            *(change(v), str(v.runs), f"{v.lost.rescued} / {v.lost.spoilt}"),
            *(clean_change(v), f"{v.worse[0]} of {v.worse[1]}", f"{v.clean_lost.rescued} / {v.clean_lost.spoilt}"),
            *(portion(v.share), str(v.certain), portion(v.beats_constant)),
        )
        known = told if v.runs or v.worse[1] else (NOTHING,) * len(told)
        rows.append((v.estimator, v.arm, *known, honesty(v)))
    return Table("What each prior does, over all cells", columns, tuple(rows), labels=2)


def change(v: Verdict) -> str:
    """The ratio in degraded cells as a change, with its interval."""
    if v.ratio is None:
        return NOTHING
    interval = f" ({percent(v.low)} … {percent(v.high)})" if v.low is not None and v.high is not None else ""
    return f"{percent(v.ratio)}{interval}"


def clean_change(v: Verdict) -> str:
    """The mean ratio of clean cells as a change."""
    return f"{100.0 * (v.clean - 1.0):+.1f} %".replace("-", "−") if v.clean is not None else NOTHING


def portion(value: float | None) -> str:
    """A share in percent."""
    return f"{value:.0%}".replace("-", "−") if value is not None else NOTHING


def honesty(v: Verdict) -> str:
    """NEES of both biases."""
    return ", ".join(f"{n:.2f}" if n is not None else NOTHING for n in v.nees)


def _pooled(pairs: list[Paired]) -> tuple[float | None, float | None, float | None]:
    """Median ratio over the pairs of all cells, with an interval by a bootstrap of whole seeds."""
    seeds: dict[int, list[float]] = {}
    for p in pairs:
        for seed, value in zip(p.seeds, p.log_ratios, strict=True):
            seeds.setdefault(seed, []).append(float(value))
    if not seeds:
        return None, None, None
    groups = [np.array(values) for values in seeds.values()]
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


def _lost(runs: pd.DataFrame, arm: str, base: str) -> Lost:
    """Runs that only one of the two lost."""
    bad = runs.assign(bad=(runs.diverged == 1.0) | runs.failure.notna())
    mine, other = (bad[bad.arm == name].set_index([*_CELL, "seed"])["bad"] for name in (arm, base))
    both = mine.index.intersection(other.index)
    lost, base_lost = mine[both].to_numpy(dtype=bool), other[both].to_numpy(dtype=bool)
    return Lost(int((base_lost & ~lost).sum()), int((lost & ~base_lost).sum()))


def _better(pairs: list[Paired]) -> float | None:
    ratios = np.concatenate([p.log_ratios for p in pairs]) if pairs else np.zeros(0)
    return float(np.mean(ratios < 0.0)) if len(ratios) else None


def _nees(records: Iterable[Record]) -> tuple[float | None, float | None]:
    """Mean by degree of freedom over the moments of each run, then over runs, of the biases."""
    records, means = list(records), []
    for name in _BIASES:
        column = f"nees_{name}"
        runs: list[Floats] = [r.series[column].to_numpy() for r in records if column in r.series]
        values = [float(np.nanmean(run)) for run in runs if np.isfinite(run).any()]
        means.append(float(np.mean(values)) / 3.0 if values else None)
    return means[0], means[1]

"""The headline over all cells, from records whose errors are known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from eval.records import Record
from eval.verdict import Lost, verdict_table, verdicts
from navcore.odometry import BLOCKS

T_NS = np.arange(40) * 200_000_000
WAVE = np.array([[np.sin(0.7 * k), np.cos(1.1 * k), np.sin(0.4 * k)] for k in range(40)])


def record(arm, error_m, seed=1, condition="10 s", kind="degraded", estimator="msckf", diverged=0.0, nees=3.0):
    """A run whose aligned ATE is proportional to `error_m`."""
    true = 5.0 * WAVE[:, ::-1]
    series = pd.DataFrame({"t_ns": T_NS, "t_s": T_NS * 1e-9})
    for k, axis in enumerate("xyz"):
        series[f"true_p_WB_{axis}"] = true[:, k]
        series[f"p_WB_{axis}"] = true[:, k] + 1e-3 * error_m * WAVE[:, k]
    for name in BLOCKS[3:]:
        series[f"nees_{name}"] = nees
    config = {"platform": "robot", "regime": "outage", "condition": condition, "level": 1.0, "axis": "", "seed": seed}
    config |= {"estimator": estimator, "arm": arm, "recording": f"seed {seed}", "kind": kind, "prior": arm}
    scores = {"ate_m": error_m, "diverged": diverged}
    return Record(f"{estimator} {arm} {condition} {seed}", "", config, {}, scores, None, series)


def runs(arm, factor, seeds=range(1, 9), **options):
    return [record(arm, factor * (1.0 + 0.1 * seed), seed, **options) for seed in seeds]


def by_arm(records):
    return {v.arm: v for v in verdicts(records)}


def test_ratios_are_paired_and_shares_are_of_logarithms():
    found = by_arm(
        [*runs("none", 1.0), *runs("constant", 0.8), *runs("motion", 0.5), *runs("truth", 0.25), *runs("worse", 2.0)]
    )
    for arm, ratio, share in (("motion", 0.5, 0.5), ("truth", 0.25, 1.0), ("worse", 2.0, -0.5)):
        v = found[arm]
        assert v.ratio == pytest.approx(ratio, rel=2e-3) and v.share == pytest.approx(share, abs=5e-3)
        assert v.low == pytest.approx(v.ratio, rel=2e-3) and v.high == pytest.approx(v.ratio, rel=2e-3)
        assert (v.runs, v.certain, v.beats_constant) == (8, 1, float(ratio < 0.8))
        assert v.clean is None and v.worse == (0, 0)
    assert found["none"].ratio is None and found["none"].runs == 0


def test_the_interval_takes_whole_seeds():
    """Two conditions of a seed that err together are no two seeds, nor are two platforms: they share their IMU."""
    ratios = np.array([0.4, 0.5, 0.6, 0.7, 1.5, 1.6, 1.7])

    def drawn(conditions):
        records = []
        for condition in conditions:
            records += [record("none", 1.0, seed, condition) for seed in range(1, 8)]
            records += [record("motion", r, seed, condition) for seed, r in enumerate(ratios, 1)]
        return by_arm(records)["motion"]

    once, twice = drawn(["10 s"]), drawn(["10 s", "20 s"])
    assert once.ratio == pytest.approx(0.7, rel=1e-2) and (once.low, once.high) == (twice.low, twice.high)
    assert once.low < 0.55 and once.high > 1.4
    assert by_arm([*runs("none", 1.0, range(1, 4)), *runs("motion", 0.5, range(1, 4))])["motion"].low is None


def test_clean_cells_are_a_mean_and_no_part_of_the_degraded():
    records = [*runs("none", 1.0), *runs("motion", 0.5)]
    for condition, factor in (("a", 1.1), ("b", 0.95)):
        records += runs("none", 1.0, condition=condition, kind="clean")
        records += runs("motion", factor, condition=condition, kind="clean")
    records += [*runs("none", 1.0, condition="5 s", kind="other"), *runs("motion", 9.0, condition="5 s", kind="other")]
    v = by_arm(records)["motion"]
    assert v.ratio == pytest.approx(0.5, rel=2e-3)
    assert v.clean == pytest.approx(np.sqrt(1.1 * 0.95), rel=2e-3) and v.worse == (1, 2)
    assert v.share is None and v.certain == 0 and v.beats_constant is None  # nobody was told the truth


def test_runs_that_diverge_are_counted_apart():
    records = [*runs("none", 1.0, range(1, 6)), *runs("motion", 0.5, range(1, 6))]
    records += [record("none", 1e3, s, diverged=1.0) for s in (6, 7)] + [record("motion", 0.5, s) for s in (6, 7)]
    records += [record("none", 1.0, 8), record("motion", 1e3, 8, diverged=1.0)]
    v = by_arm(records)["motion"]
    assert (v.runs, v.lost, v.clean_lost) == (5, Lost(2, 1), Lost())
    clean = [replace(r, config=r.config | {"kind": "clean"}) for r in records]
    assert by_arm(clean)["motion"].clean_lost == Lost(2, 1)
    raised = [replace(r, failure="no luck", scores={}) for r in runs("motion", 0.5, range(1, 5))]
    assert by_arm([*raised, *runs("none", 1.0, range(1, 5))])["motion"].lost.spoilt == 4


def test_what_regimes_share_counts_once():
    records = [*runs("none", 1.0), *runs("motion", 0.5)]
    again = [replace(r, config=r.config | {"regime": "again"}) for r in records]
    assert verdicts([*records, *again]) == verdicts(records)
    heavy = [replace(r, config=r.config | {"regime": "again"}) for r in runs("heavy", 2.0)]
    found = by_arm([*records, *again, *heavy])
    assert (found["motion"].runs, found["heavy"].runs) == (8, 8)
    assert found["heavy"].ratio == pytest.approx(2.0, rel=2e-3)


def test_only_degraded_cells_count_against_the_devices_memory():
    records = [*runs("none", 1.0), *runs("constant", 0.8), *runs("motion", 0.5), *runs("truth", 0.25)]
    both = {"condition": "clean", "kind": "clean"}
    clean = [*runs("none", 1.0, **both), *runs("constant", 0.5, **both), *runs("motion", 0.9, **both)]
    v = by_arm([*records, *clean, *runs("truth", 0.25, **both)])["motion"]
    assert (v.beats_constant, v.certain) == (1.0, 1)


def test_each_estimator_has_its_own_base_and_its_own_honesty():
    records = []
    for estimator, base, nees in (("msckf", 1.0, 3.0), ("factor", 2.0, 6.0)):
        both = {"condition": "clean", "kind": "clean", "estimator": estimator}
        records += [*runs("none", base, **both), *runs("motion", 1.0, nees=nees, **both)]
    found = {v.estimator: v for v in verdicts(records) if v.arm == "motion"}
    assert found["msckf"].clean == pytest.approx(1.0) and found["factor"].clean == pytest.approx(0.5, rel=2e-3)
    assert found["msckf"].nees == pytest.approx((1.0, 1.0)) and found["factor"].nees == pytest.approx((2.0, 2.0))
    table = verdict_table(verdicts(records))
    names = [(e, arm) for e in ("msckf", "factor") for arm in ("none", "motion")]
    assert [row[:2] for row in table.rows] == names
    assert table.rows[3][5] == "−50.0 %" and table.rows[3][-1] == "2.00, 2.00"
    assert set(table.rows[2][2:-1]) == {"–"} and table.rows[2][-1] == "1.00, 1.00"


def test_a_study_without_such_cells_has_no_verdict():
    assert verdicts([*runs("none", 1.0, kind="other"), *runs("motion", 0.5, kind="other")]) == []

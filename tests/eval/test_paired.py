import numpy as np
import pytest
from scipy.stats import quantile_test

from eval.errors import StudyError
from eval.paired import common_ates, frame, median_interval, paired
from eval.records import Record, path_of, read
from eval.work import run_cell
from tests.eval.test_study import MADE_WITH, cell


def measured(folder, seed, arm, **overrides):
    return read(path_of(folder, run_cell(cell(seed, arm, **overrides), MADE_WITH, folder)))


@pytest.fixture(scope="module")
def family(tmp_path_factory):
    """Eight seeds; `better` has half the errors of `none`, in two seeds one of them diverges or raises."""
    folder = tmp_path_factory.mktemp("family")
    runs = [measured(folder, s, "none", draw=s) for s in range(1, 9)]
    runs += [measured(folder, s, "better", draw=100 + s, scale=0.5) for s in range(1, 9)]
    runs += [measured(folder, 9, "none"), measured(folder, 9, "better", scale=1000.0)]
    runs += [measured(folder, 10, "none", fail="x"), measured(folder, 10, "better")]
    return runs


def test_half_the_error_is_half_the_ratio_and_the_interval_says_so(family):
    (found,) = paired(family, "none")
    assert (found.arm, found.base, found.condition) == ("better", "none", "clean")
    assert found.seeds == tuple(range(1, 9))
    assert found.median == pytest.approx(0.5, rel=0.1)
    assert found.low < found.median < found.high < 0.6
    assert found.p_value == pytest.approx(2.0 / 2**8)  # all eight agree
    assert (found.diverged, found.base_diverged, found.failed) == (1, 0, 1)


def test_an_arm_against_its_equal_shows_no_difference(family):
    runs = [r for r in family if r.config["arm"] == "none"]
    twins = [Record(r.key + "x", r.title, r.config | {"arm": "twin"}, {}, r.scores, r.failure, r.series) for r in runs]
    (found,) = paired(runs + twins, "none")
    assert found.median == 1.0 and found.low == 1.0 and found.high == 1.0 and found.p_value is None


def test_few_seeds_give_no_interval(family):
    (found,) = paired([r for r in family if r.config["seed"] <= 5], "none")
    assert len(found.seeds) == 5
    assert found.median is not None and found.low is None and found.p_value is None


@pytest.mark.parametrize("n", range(6, 40))
def test_the_interval_of_the_median_is_scipys(n):
    values = np.random.default_rng(n).normal(size=n)
    oracle = quantile_test(values, q=0.0, p=0.5).confidence_interval(0.95)
    assert median_interval(values) == pytest.approx((oracle.low, oracle.high))


def test_no_interval_for_fewer_than_six():
    assert median_interval(np.arange(5.0)) is None
    assert median_interval(np.zeros(0)) is None


def test_both_arms_are_scored_on_the_samples_that_both_have(tmp_path):
    whole = measured(tmp_path, 1, "none", scale=0.0)
    short = measured(tmp_path, 1, "short", blind_after=200)
    ates = common_ates(short, whole)
    assert ates[1] == pytest.approx(0.0, abs=1e-5)
    assert ates[0] == pytest.approx(0.1 * np.sqrt(3.0), rel=0.25)
    late = measured(tmp_path, 1, "blind", blind_after=0)
    assert common_ates(whole, late) is None
    (found,) = paired([whole, late], "none")
    assert found.median is None and found.diverged == 1


def test_the_ate_of_the_series_is_that_of_the_run(family):
    run = family[0]
    assert common_ates(run, run)[0] == pytest.approx(run.scores["ate_m"], rel=0.1)


def test_one_cell_has_one_record(family):
    table = frame(family)
    assert len(table) == 20 and table.failure.notna().sum() == 1
    with pytest.raises(StudyError, match="two records of one cell"):
        frame([family[0], family[0]])

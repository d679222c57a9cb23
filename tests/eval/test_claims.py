"""What a prior had to show, from verdicts that are made up."""

from eval.claims import claims_table
from eval.verdict import Lost, Verdict

BASE = Verdict("msckf", "none", nees=(1.0, 1.0))
IPNET = Verdict("msckf", "ipnet", 60, 0.7, 0.6, 0.8)
MOTION = Verdict(
    *("msckf", "motion", 60, 0.5, 0.4, 0.6),
    lost=Lost(3, 1),
    clean=1.01,
    worse=(0, 4),
    share=0.6,
    certain=9,
    beats_constant=0.95,
    nees=(0.8, 1.2),
)
TRUTH = Verdict("msckf", "truth", 60, 0.3, 0.2, 0.4)
PLAIN = Verdict("msckf", "paper-plain", 57, 2.0, lost=Lost(0, 7), nees=(5.0, 8.0))
POOR = Verdict(
    *("factor", "ipnet", 60, 0.9, 0.8, 1.1),
    clean=1.03,
    worse=(1, 4),
    share=-0.1,
    certain=2,
    beats_constant=0.5,
    nees=(1.0, 1.4),
)


def column(found, estimator):
    table = claims_table(found)
    assert table is not None
    k = table.columns.index(estimator)
    return [row[k] for row in table.rows]


def test_the_best_learned_prior_is_held_against_each_bar():
    told = column([BASE, IPNET, TRUTH, PLAIN, MOTION, Verdict("factor", "none"), POOR], "msckf")
    assert told == [
        *("motion", "−50 % (−60 % … −40 %)", "−70 % (−80 % … −60 %)", "+100 %", "3 / 1", "0 / 7"),
        *("+1.0 %", "0 of 4", "60% of 9 cells", "95%", "0.80, 1.20", "5.00, 8.00"),
    ]


def test_what_misses_its_bar_is_said_to_and_what_was_not_run_is_left_open():
    told = column([BASE, IPNET, TRUTH, PLAIN, MOTION, Verdict("factor", "none"), POOR], "factor")
    assert told == [
        *("ipnet", "−10 % (−20 % … +10 %): not met", "–", "–", "0 / 0", "0 / 0"),
        *(
            "+3.0 %: not met",
            "1 of 4: not met",
            "−10% of 2 cells: not met",
            "50%: not met",
            "1.00, 1.40: not met",
            "–, –",
        ),
    ]
    assert column([BASE, IPNET], "msckf")[5:] == ["0 / 0", *"–––––", "–, –"]


def test_nothing_is_claimed_without_a_learned_prior():
    assert claims_table([BASE, TRUTH, PLAIN]) is None
    assert claims_table([BASE, Verdict("msckf", "motion", clean=1.0, worse=(0, 1))]) is None  # no degraded cell

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.degrade.schedule import GRADED, Degradation, Schedule
from sim.errors import ConfigError


def test_items_are_read_and_answer_for_their_span() -> None:
    schedule = Schedule.parse("low_light:3@20-35, blackout@40-45.5")
    assert schedule.degradations == (
        Degradation("low_light", 20.0, 35.0, 3),
        Degradation("blackout", 40.0, 45.5),
    )
    assert [schedule.severity("low_light", t) for t in (19.99, 20.0, 34.99, 35.0)] == [0, 3, 3, 0]
    assert schedule.severity("blackout", 42.0) == 5
    assert schedule.severity("motion_blur", 42.0) == 0


def test_the_worst_of_overlapping_ones_counts() -> None:
    schedule = Schedule.parse("motion_blur:2@0-10,motion_blur:4@5-6")
    assert [schedule.severity("motion_blur", t) for t in (1.0, 5.5, 7.0)] == [2, 4, 2]


@given(st.sampled_from(GRADED), st.integers(1, 5), st.integers(0, 500), st.integers(1, 500))
def test_what_is_written_is_read(kind: str, severity: int, start: int, length: int) -> None:
    (found,) = Schedule.parse(f"{kind}:{severity}@{start}-{start + length}").degradations
    assert found == Degradation(kind, start, start + length, severity)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("smog:3@1-2", "known are blackout, motion_blur, texture_loss, .*, time_offset"),
        ("low_light:6@1-2", "severity of low_light is 6, expected 1 to 5"),
        ("low_light@1-2", "needs a severity from 1 to 5"),
        ("blackout:2@1-2", "a blackout has no severity"),
        ("blackout@5-2", "expected 0 <= start < end"),
        ("blackout", "KIND one of blackout, motion_blur, texture_loss"),
        ("low_light:x@1-2", "not of the form"),
        ("blackout@1.2.3-5", "not of the form"),
    ],
)
def test_faults_are_named_with_what_is_valid(spec: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Schedule.parse(spec)


def test_an_empty_text_is_a_clean_schedule() -> None:
    assert Schedule.parse("") == Schedule()

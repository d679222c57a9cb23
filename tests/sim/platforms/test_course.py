import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.errors import ConfigError
from sim.platforms.course import Course, Going, random_course

BRISK = Going((2.7, 1.6), 1.5, 0.65, 2.0, 0.3)
REST_S = 2.0


def course_of(seed: int, seconds: float = 60.0) -> Course:
    return random_course(BRISK, seconds, np.random.default_rng(seed), REST_S)


@settings(max_examples=20)
@given(st.integers(0, 10_000))
def test_turns_lead_out_of_the_area_by_two_radii_at_most(seed: int) -> None:
    place = course_of(seed).place(np.arange(0.0, 60.0, 0.02))
    over = np.abs(place).max(axis=0) - BRISK.half_area
    assert over.max() < 2.0 * BRISK.turning_radius + 0.1


def test_it_goes_where_it_points_as_fast_as_it_says_and_first_of_all_rests() -> None:
    course = course_of(4)
    t = np.arange(0.0, 60.0, 0.013)
    heading, speed = course.heading(t), course.speed(t)
    velocity = speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    np.testing.assert_allclose(course.place(t, 1), velocity, atol=0.02)
    assert np.abs(speed[t < REST_S - 0.1]).max() < 1e-3
    assert speed.min() > -1e-2
    assert 1.0 < speed[t > 4.0].mean() < 1.8


def test_it_is_slower_in_curves_and_pauses_at_some_goals() -> None:
    paused = []
    for seed in range(4):
        course, t = course_of(seed), np.arange(4.0, 60.0, 0.02)
        speed, rate = course.speed(t), course.heading(t, 1)
        assert np.percentile(np.abs(speed * rate), 90) < 1.05 * BRISK.sideways
        assert np.abs(rate).max() < 1.05 * BRISK.speed * 1.25 / BRISK.turning_radius
        paused.append(float(np.mean(speed < 0.02)))
    assert 0.01 < np.mean(paused) < 0.3


def test_circles_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"circles of 1\.0 m do not fit"):
        Going((2.7, 1.6), 1.5, 1.0, 2.0, 0.3)
    with pytest.raises(ConfigError, match=r"speed is 9\.0"):
        Going((2.7, 1.6), 9.0, 0.7, 2.0, 0.3)

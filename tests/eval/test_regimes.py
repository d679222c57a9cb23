import numpy as np
import pytest

from eval.regimes import Setting, difficulties, graded, grades, kind_of, outage, start_in_motion
from sim.degrade import Schedule
from sim.degrade.spec import Spec
from sim.imu import GRADES
from sim.platforms import DIFFICULTIES


def test_an_outage_begins_when_it_says_and_lasts_by_its_level():
    regime = outage("outage", 25.0, (0.0, 5.0, 20.0), Setting(60.0, imu="cheap"))
    assert [(c.name, c.level, c.setting.degrade) for c in regime.conditions] == [
        ("clean", 0.0, ""),
        ("5 s", 5.0, "blackout@25-30"),
        ("20 s", 20.0, "blackout@25-45"),
    ]
    assert {(c.setting.seconds, c.setting.imu) for c in regime.conditions} == {(60.0, "cheap")}
    assert regime.axis == "length of the outage [s]"


def test_a_kind_grows_worse_in_the_middle_of_the_flight():
    regime = graded("wrong vision", "moving_objects", base=Setting(40.0))
    assert [c.level for c in regime.conditions] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    (worst,) = Schedule.parse(regime.conditions[-1].setting.degrade).degradations
    assert (worst.kind, worst.severity, worst.start_s, worst.end_s) == ("moving_objects", 5, 12.0, 32.0)


def test_starts_in_motion_have_fewer_and_fewer_features():
    regime = start_in_motion((100, 12))
    assert [(c.setting.features, c.setting.moving_start, c.level) for c in regime.conditions] == [
        (100, True, 100.0),
        (12, True, 12.0),
    ]
    points = regime.conditions[1].setting.points("quadrotor", 3)
    assert points.max_features == 12 and points.flight.moving_start and points.flight.seed == 3


def test_an_outage_of_ten_seconds_counts_however_its_schedule_is_rounded():
    spec = Spec.load("v1")
    lengths = np.random.default_rng(1).uniform(60.0, 200.0, 200)
    kinds = {kind_of(spec.schedule("outage-10-early", float(s)).degradations) for s in lengths}
    assert kinds == {"degraded"}
    assert {kind_of(spec.schedule("outage-5-early", float(s)).degradations) for s in lengths} == {"other"}
    assert kind_of(spec.schedule("crowd", 100.0).degradations) == "degraded"
    assert kind_of(spec.schedule("clean", 100.0).degradations) == "clean"


@pytest.mark.parametrize(
    ("regime", "names", "field"),
    [(grades(10.0, 5.0), tuple(GRADES), "imu"), (difficulties(10.0, 5.0), DIFFICULTIES, "difficulty")],
)
def test_each_grade_and_each_difficulty_goes_through_the_same_outage(regime, names, field):
    assert tuple(c.name for c in regime.conditions) == tuple(names)
    assert [getattr(c.setting, field) for c in regime.conditions] == list(names)
    assert {c.setting.degrade for c in regime.conditions} == {"blackout@10-15"}
    assert {c.level for c in regime.conditions} == {None} and regime.axis == ""

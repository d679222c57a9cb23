"""What the filter says of itself: why it is lost, blind, or not as good as it could be."""

import numpy as np
import pytest

from msckf.config import HealthConfig
from msckf.health import HealthMonitor
from msckf.state import FilterState
from msckf.visual import VisualOutcome
from navcore.frontend import Observations
from navcore.odometry import Health
from tests.msckf.scenes import ONE, filter_state, start_state

CONFIG = HealthConfig()
S = 1_000_000_000


def seen(n, *faults):
    return Observations(np.arange(n), np.zeros(n, dtype=np.int64), np.zeros((n, 2)), np.zeros((n, 3)), faults)


def monitor():
    started = HealthMonitor(CONFIG)
    started.started(0)
    return started


def test_vision_that_corrects_is_tracking():
    verdict = monitor().judge(filter_state(), S, seen(50), VisualOutcome(used=10), still=False)
    assert (verdict.health, verdict.reasons) == (Health.TRACKING, ())
    still = monitor().judge(filter_state(), S, seen(50), VisualOutcome(), still=True)
    assert (still.health, still.reasons) == (Health.TRACKING, ("standing still",))


def test_without_correction_it_is_inertial_only_after_a_while():
    judge, state = monitor().judge, filter_state()
    soon = judge(state, round(0.5 * S), seen(50), VisualOutcome(), still=False)
    assert soon.health is Health.TRACKING
    late = judge(state, round(0.7 * S), seen(50), VisualOutcome(), still=False)
    assert (late.health, late.reasons) == (Health.INERTIAL_ONLY, ("no visual correction for 0.7 s",))
    again = judge(state, 3 * S, seen(50), VisualOutcome(used=5), still=False)
    assert again.health is Health.TRACKING


def test_what_is_wrong_with_vision_is_told():
    judge, state = monitor().judge, filter_state()
    few = judge(state, 0, seen(3, "image dark, camera 0"), VisualOutcome(), still=False)
    assert (few.health, few.reasons) == (Health.INERTIAL_ONLY, ("image dark, camera 0", "3 features followed"))
    refused = judge(state, 0, seen(50), VisualOutcome(used=5, rejected=11), still=False)
    assert (refused.health, refused.reasons) == (Health.TRACKING, ("11 features refused",))
    some = judge(state, 0, seen(50), VisualOutcome(used=5, rejected=9), still=False)
    assert some.reasons == ()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda s: setattr(s, "v_WB", np.array([0.0, 31.0, 0.0])), "speed 31.0 m/s is past 30.0"),
        (lambda s: s.propagated(6, 11.0), "velocity is known to 11.0 m/s only"),
        (lambda s: s.propagated(3, 51.0), "position was lost by 51.0 m"),
        (lambda s: setattr(s, "p_WB", np.array([np.nan, 0.0, 0.0])), "state is not finite"),
    ],
    ids=["speed", "velocity", "position", "nan"],
)
def test_a_state_that_is_not_to_be_trusted_is_lost(change, reason):
    class Told(FilterState):
        def propagated(self, k, sigma):
            """The error state `k` is known to `sigma` only."""
            self._P[k, k] = sigma**2

    state = Told(start_state(), ONE)
    change(state)
    verdict = monitor().judge(state, S, seen(50, "image dark, camera 0"), VisualOutcome(), still=False)
    assert (verdict.health, verdict.reasons) == (Health.LOST, (reason, "image dark, camera 0"))


def test_a_long_way_makes_no_loss():
    """Position drifts without bounds; only what was added since vision last corrected counts."""
    state = filter_state()
    state._P[3, 3] = 80.0**2
    watch = monitor()
    assert watch.judge(state, S, seen(50), VisualOutcome(used=5), still=False).health is Health.TRACKING
    state._P[3, 3] = 80.0**2 + 49.0**2
    assert watch.judge(state, 2 * S, seen(50), VisualOutcome(), still=False).health is Health.INERTIAL_ONLY
    state._P[3, 3] = 80.0**2 + 51.0**2
    assert watch.judge(state, 2 * S, seen(50), VisualOutcome(), still=False).health is Health.LOST


def told(judge, state, t_s, used, refused):
    """Whether it is contradicted after a frame at that time."""
    outcome = VisualOutcome(used=used, rejected=refused)
    verdict = judge(state, round(t_s * S), seen(50), outcome, still=False)
    return "vision contradicts the state" in verdict.reasons


def test_what_vision_has_contradicted_is_doubted_until_it_agrees():
    watch, state = monitor(), filter_state()
    for k in range(20):
        assert not told(watch.judge, state, 0.05 * k, used=30, refused=0)
    doubted = [told(watch.judge, state, 1.0 + 0.05 * k, used=1, refused=10) for k in range(20)]
    assert doubted == sorted(doubted)
    assert 5 < doubted.index(True) < 12
    undecided = [told(watch.judge, state, 2.0 + 0.05 * k, used=8, refused=12) for k in range(60)]
    assert all(undecided)
    agreed = [told(watch.judge, state, 5.0 + 0.05 * k, used=12, refused=8) for k in range(30)]
    assert agreed == sorted(agreed, reverse=True)
    assert not agreed[-1]


def test_another_estimate_doubts_and_confirms_too():
    watch, state = monitor(), filter_state()
    watch.contradict(0)
    assert told(watch.judge, state, 0.5, used=30, refused=0)
    watch.confirm()
    assert not told(watch.judge, state, 0.6, used=30, refused=0)

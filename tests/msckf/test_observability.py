"""Position and yaw cannot be observed; a filter that linearises as FEJ does knows that it does not know them."""

from dataclasses import dataclass, field

import numpy as np
import pytest

import msckf.state
from msckf.blocks import IMU_SIZE, POSITION, THETA, VELOCITY
from msckf.config import FilterConfig
from msckf.filter import Filter
from msckf.state import FilterState
from navcore import so3
from navcore.odometry import run
from sim.points import simulate_points

E_Z = np.array([0.0, 0.0, 1.0])
POSE_ONLY = {"vision.landmarks": 0, "vision.extrinsics": False, "standstill.enabled": False, "start.mode": "moving"}


def directions(R_WB, p_WB, v_WB=None):
    """Errors of a pose (and velocity) when the world moves by x, y, z or turns about z: (6 or 9, 4)."""
    N = np.zeros((9, 4))
    N[THETA, 3] = R_WB.T @ E_Z
    N[POSITION, :3] = np.eye(3)
    N[POSITION, 3] = so3.hat(E_Z) @ p_WB
    if v_WB is None:
        return N[:6]
    N[VELOCITY, 3] = so3.hat(E_Z) @ v_WB
    return N


def state_directions(state: FilterState):
    """The same of everything in the state, at the points where the filter linearises: (size, 4)."""
    R_lin, p_lin = state.linearisation_clones
    clones = [directions(R, p) for R, p in zip(R_lin, p_lin, strict=True)]
    landmarks = [np.column_stack([np.eye(3), so3.hat(E_Z) @ p]) for p in state.linearisation_landmarks]
    imu = np.zeros((state.clone_start, 4))
    imu[:9] = directions(*state._first)
    return np.vstack([imu, *clones, *landmarks])


@dataclass
class Recorder:
    """Transitions, and measurements with where the clones were that they speak of."""

    Phi: list = field(default_factory=list)
    starts: list = field(default_factory=list)  # state that each transition begins from
    made_at: dict = field(default_factory=dict)  # clone stamp to number of transitions before it
    measurements: list = field(default_factory=list)  # (H, stamps of the clones)


@pytest.fixture
def recorder(monkeypatch):
    """Listens to the filter without changing what it does."""
    heard = Recorder()
    real_transition, real_clone, real_update = msckf.state.transition, FilterState.add_clone, FilterState.update

    def transition(increment, start, end):
        heard.Phi.append(real_transition(increment, start, end))
        heard.starts.append(start)
        return heard.Phi[-1]

    def add_clone(self, t_ns):
        heard.made_at[t_ns] = len(heard.Phi)
        real_clone(self, t_ns)

    def update(self, H, columns, r, R):
        heard.measurements.append((H.copy(), columns.copy(), self.clones.t_ns.copy(), self.clone_start))
        real_update(self, H, columns, r, R)

    monkeypatch.setattr(msckf.state, "transition", transition)
    monkeypatch.setattr(FilterState, "add_clone", add_clone)
    monkeypatch.setattr(FilterState, "update", update)
    return heard


def observability(heard: Recorder, since: int):
    """Stacked H Phi of the measurements whose clones all came after transition `since`, by the state there."""
    rows = []
    for H, columns, stamps, first in heard.measurements:
        at = [heard.made_at[t] for t in stamps.tolist()]
        if at[0] < since or not np.array_equal(columns, np.arange(first, first + 6 * len(at))):
            continue
        chain, upto, poses = np.eye(IMU_SIZE), since, []
        for k in at:
            for Phi in heard.Phi[upto:k]:
                chain = Phi @ chain
            upto = k
            poses.append(chain[:6])
        rows.append(H @ np.vstack(poses))
    return np.vstack(rows)


def fly(fej, seconds=6.0, **settings):
    sequence = simulate_points(seed=5, seconds=seconds, moving_start=True)
    overrides = POSE_ONLY | {"vision.fej": fej} | settings
    run(Filter(sequence.calibration, FilterConfig().with_overrides(overrides)), sequence)


def share_lost(heard: Recorder, since):
    """How much each of the four directions shows in the measurements, as a share of what a turn like it would."""
    stacked = observability(heard, since)
    assert len(stacked) > 200
    R, p, v = heard.starts[since]
    N = np.zeros((IMU_SIZE, 4))
    N[:9] = directions(R, p - p, v)  # the world is turned about where the body was: lengths of order one
    visible = np.zeros((IMU_SIZE, 4))
    visible[POSITION, :3], visible[THETA, 3] = np.eye(3), R.T @ [1.0, 0.0, 0.0]  # a tilt instead of a yaw
    scale = np.array([*np.linalg.norm(stacked[:, VELOCITY], axis=0), np.linalg.norm(stacked @ visible[:, 3])])
    return np.linalg.norm(stacked @ N, axis=0) / scale


def test_with_first_estimates_all_four_directions_stay_unobserved(recorder):
    """Over a second and a half of flight, in which updates move every estimate."""
    fly(fej=True)
    assert share_lost(recorder, since=20).max() < 1e-9


def test_without_first_estimates_yaw_is_lost_and_position_stays(recorder):
    fly(fej=False)
    lost = share_lost(recorder, since=20)
    assert lost[:3].max() < 1e-9
    assert lost[3] > 1e-4


def test_every_transition_carries_the_directions_on(monkeypatch):
    """Phi N(x_k) = N(x_k+1), with x_k the estimate before the measurements at k and x_k+1 the prediction."""
    real, worst = msckf.state.transition, []

    def transition(increment, start, end):
        Phi = real(increment, start, end)
        N = [np.vstack([directions(*state), np.zeros((6, 4))]) for state in (start, end)]
        worst.append(np.abs(Phi @ N[0] - N[1]).max())
        return Phi

    monkeypatch.setattr(msckf.state, "transition", transition)
    fly(fej=True, seconds=5.0)
    assert len(worst) > 40
    assert max(worst) < 1e-9


def test_landmarks_and_extrinsics_say_nothing_of_the_directions_either(monkeypatch):
    """Every measurement of a flight with both in the state, at the points where it was linearised."""
    real, shares, kinds = FilterState.update, [], set()

    def update(self, H, columns, r, R):
        N = state_directions(self)[columns]
        N[:, 3] -= N[:, :3] @ (so3.hat(E_Z) @ self.p_WB)  # turn about the body
        shares.append(np.abs(H @ N).max() / np.abs(H).max())
        kinds.add(bool(columns.max() >= self.clone_stop))
        real(self, H, columns, r, R)

    monkeypatch.setattr(FilterState, "update", update)
    fly(fej=True, **{"vision.landmarks": 40, "vision.extrinsics": True})
    assert kinds == {False, True}
    assert max(shares) < 1e-9

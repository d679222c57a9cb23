"""Position and yaw cannot be observed; a filter that linearises as FEJ does knows that it does not know them."""

from dataclasses import dataclass, field

import numpy as np
import pytest

import msckf.state
import msckf.visual
from msckf.blocks import IMU_SIZE, POSITION, THETA, VELOCITY
from msckf.config import FilterConfig
from msckf.filter import Filter
from msckf.state import FilterState
from msckf.window import VisualWindow
from navcore import so3
from navcore.odometry import run
from sim.points import simulate_points

E_Z = np.array([0.0, 0.0, 1.0])
POSE_ONLY = {
    "vision.landmarks": 0,
    "calibration.extrinsics": False,
    "standstill.enabled": False,
    "start.mode": "moving",
    "vision.unsure_velocity": 100.0,  # iterated updates choose new points
}
EVERYTHING = {
    "vision.landmarks": 40,
    "calibration.extrinsics": True,
    "calibration.time_offset": True,
    "calibration.intrinsics": True,
}


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
    """The same of everything in the state, at the points where the filter linearises: (size, 4).

    A landmark has no part: its anchor moves with the world, and it is described from there.
    """
    N = np.zeros((state.size, 4))
    N[:9] = directions(*state._first)
    for k, pose in enumerate(zip(*state.linearisation_clones, strict=True)):
        N[state.clone(k)] = directions(*pose)
    return N


def about_the_body(N, state: FilterState):
    """The turn about the body instead of about the world's origin: lengths of order one."""
    N[:, 3] -= N[:, :3] @ (so3.hat(E_Z) @ state.p_WB)
    return N


@dataclass
class Recorder:
    """Transitions, and measurements with where the clones were that they speak of."""

    Phi: list = field(default_factory=list)
    starts: list = field(default_factory=list)  # state that each transition begins from
    made_at: dict = field(default_factory=dict)  # clone stamp to number of transitions before it
    measurements: list = field(default_factory=list)  # (H, stamps of the clones)


@pytest.fixture
def recorder(monkeypatch):
    """Listens to the filter; all rows of the measurements are kept, since compression rounds to half the digits."""
    heard = Recorder()
    monkeypatch.setattr(msckf.visual, "compress", lambda r, H: (r, H))
    monkeypatch.setattr(msckf.state, "_FAR_OFF", (3.0, 10.0, 0.0))  # giving them up would choose new points
    real_transition, real_clone, real_update = msckf.state.transition, FilterState.add_clone, FilterState.update

    def transition(increment, start, end):
        heard.Phi.append(real_transition(increment, start, end))
        heard.starts.append(start)
        return heard.Phi[-1]

    def add_clone(self, t_ns, omega_B):
        heard.made_at[t_ns] = len(heard.Phi)
        real_clone(self, t_ns, omega_B)

    def update(self, H, columns, r, R):
        heard.measurements.append((H.copy(), columns.copy(), self.clones.t_ns.copy(), self.clone_start))
        return real_update(self, H, columns, r, R)

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


def fly(fej, seconds=6.0, cameras=1, **settings):
    sequence = simulate_points(seed=5, seconds=seconds, moving_start=True, cameras=cameras)
    overrides = POSE_ONLY | {"vision.fej": fej, "cameras": cameras} | settings
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


@pytest.fixture
def trying(monkeypatch):
    """Says by its length whether an iterated update is being tried out: what is taken back tells the state nothing."""
    inside, settled = [], VisualWindow._settled

    def listen(self, *arguments):
        inside.append(True)
        try:
            return settled(self, *arguments)
        finally:
            inside.pop()

    monkeypatch.setattr(VisualWindow, "_settled", listen)
    return inside


@pytest.fixture
def leaks(monkeypatch, trying):
    """How much of the four directions every measurement of a flight has, and every state that joins or changes.

    As a share of the largest entry; by what happened.
    """
    monkeypatch.setattr(msckf.visual, "compress", lambda r, H: (r, H))
    heard = {"window": [], "landmarks": [], "new": [], "moved": [], "clone": []}
    real = {name: getattr(FilterState, name) for name in ("update", "seen_through", "add_landmarks", "add_clone")}

    def update(self, H, columns, r, R):
        if trying:
            return real["update"](self, H, columns, r, R)
        N = about_the_body(state_directions(self), self)
        heard["window"].append(np.abs(H @ N[columns]).max() / np.abs(H).max())
        return real["update"](self, H, columns, r, R)

    def seen_through(self, H, columns):
        N = about_the_body(state_directions(self), self)
        heard["moved" if H.shape[1] == 3 else "landmarks"].append(np.abs(H @ N[columns]).max() / np.abs(H).max())
        return real["seen_through"](self, H, columns)

    def add_landmarks(self, landmarks, by_seen, covariance):
        N = about_the_body(state_directions(self), self)
        heard["new"].append(np.abs(by_seen @ N[self.seen_columns]).max() / np.abs(by_seen).max())
        real["add_landmarks"](self, landmarks, by_seen, covariance)

    def add_clone(self, t_ns, omega_B):
        real["add_clone"](self, t_ns, omega_B)
        new = state_directions(self)[self.clone(len(self.clones) - 1)]
        heard["clone"].append(np.abs(new - directions(*self._first[:2])).max())

    for function in (update, seen_through, add_landmarks, add_clone):
        monkeypatch.setattr(FilterState, function.__name__, function)
    return heard


@pytest.mark.parametrize("cameras", [1, 2])
def test_landmarks_and_calibration_say_nothing_of_the_directions_either(leaks, cameras, monkeypatch):
    """Everything that happens in a flight with all of them in the state, at the points where it was linearised."""
    fly(fej=True, cameras=cameras, **EVERYTHING)
    assert min(len(shares) for shares in leaks.values()) > 10
    assert {what for what, shares in leaks.items() if max(shares) > 1e-9} == set()


def test_compression_tells_no_position_that_would_matter(monkeypatch, trying):
    """Its rounding is information along the four directions; after ten minutes of it they would be known to this."""
    real, information = FilterState.update, np.zeros((4, 4))

    def update(self, H, columns, r, R):
        if not trying:
            along = H @ about_the_body(state_directions(self), self)[columns]
            information[:] += along.T @ along / R[0, 0]
        return real(self, H, columns, r, R)

    monkeypatch.setattr(FilterState, "update", update)
    seconds = 6.0
    fly(fej=True, seconds=seconds, **EVERYTHING)
    sigma = 1.0 / np.sqrt(np.diagonal(information) * 600.0 / seconds)
    assert sigma[:3].min() > 10.0  # m
    assert sigma[3] > 3.0  # rad

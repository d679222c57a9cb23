"""The smoother over flights in points mode: accuracy, what leaves the window, trouble, the prior."""

from dataclasses import replace
from types import SimpleNamespace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, V, X
from scipy.spatial.transform import Rotation

from eval.metrics import score
from factor import Smoother, SmootherConfig
from factor.smoother import make
from factor.window import Window
from navcore.errors import ConfigError, InputError
from navcore.odometry import Health, State, TimedState, run
from navcore.prior import BiasPrior, Paced, load_prior
from navcore.priors.listed import ListedPrior
from navcore.sequence import Frame, Tracks
from sim.points import simulate_points
from tests.msckf.flights import seconds, states, without_imu


def smooth(sequence, prior=None, start=None, **settings):
    """The smoother over a recording; settings by dotted name with two underscores for the dot."""
    overrides = {name.replace("__", "."): value for name, value in settings.items()}
    return run(Smoother(sequence.calibration, SmootherConfig().with_overrides(overrides), prior, start), sequence)


def told(sequence, sigma=1e-4, bias_sigma=None):
    """The state of the truth at the first frame."""
    t_ns = sequence.frames[0].t_ns
    s = sequence.truth.at(np.array([t_ns]))
    P = np.diag(np.r_[np.full(9, sigma), np.full(6, bias_sigma or sigma)] ** 2)
    R_WB = Rotation.from_quat(s.q_WB[0]).as_matrix()
    return TimedState(t_ns, State(R_WB, s.p_WB[0], s.v_WB[0], s.b_g[0], s.b_a[0], P))


@pytest.fixture(scope="module")
def flight():
    return simulate_points(seed=2, seconds=12.0, cameras=2)


@pytest.fixture(scope="module")
def clean():
    return simulate_points(seed=3, seconds=8.0, pixel_noise=0.0, noisy_imu=False, moving_start=True)


def position_errors(result, sequence):
    """(M,) m, without any alignment."""
    t_ns = result.trajectory.t_ns
    return np.linalg.norm(result.trajectory.p_WB - sequence.truth.at(t_ns).p_WB, axis=1)


def test_without_noise_it_is_where_it_is(clean):
    result = smooth(clean, start=told(clean))
    assert result.completeness == 1.0
    assert position_errors(result, clean).max() < 0.0012


def test_samples_that_are_not_turned_half_show(clean, monkeypatch):
    """The same with the attitude held over each sample, as GTSAM does: the test above would fail."""
    monkeypatch.setattr("factor.inertia._turned_half", lambda cells, bias: cells.accel)
    assert position_errors(smooth(clean, start=told(clean)), clean).max() > 0.003


@pytest.mark.parametrize("cameras", [1, 2])
def test_a_flight(flight, cameras):
    result = smooth(flight, cameras=cameras)
    scores = score(result.trajectory, flight.truth)
    assert scores["ate_m"] < 0.03 and scores["ate_deg"] < 0.8
    assert result.completeness > 0.9
    healths = {e.health for e in result.estimates if e.state is not None}
    assert healths == {Health.TRACKING}
    errors = np.abs(result.trajectory.b_a - flight.truth.at(result.trajectory.t_ns).b_a)[-1]
    assert (errors < 4.0 * result.sigmas[-1, 4]).all()


def test_the_same_every_time(flight):
    brief = flight.span(0.0, 4.0)
    np.testing.assert_array_equal(states(smooth(brief)), states(smooth(brief)))


def test_what_leaves_the_window_is_not_forgotten(clean, monkeypatch):
    """With four keyframes it knows nearly what it knows with thirty; without what had left it knows much less."""
    few, many = (smooth(clean, start=told(clean, 1e-2), window__keyframes=n) for n in (4, 30))
    assert position_errors(few, clean).max() < 0.02
    known = few.sigmas[-1, 3:].mean() / many.sigmas[-1, 3:].mean()
    assert 0.8 < known < 1.6

    let_go = Window._let_go

    def forget(self):
        let_go(self)
        self._before = gtsam.NonlinearFactorGraph()
        loose = gtsam.noiseModel.Isotropic.Sigma(6, 1e-2)
        k = self._keyframes[0].k
        self._before.push_back(gtsam.PriorFactorPose3(X(k), self._values.atPose3(X(k)), loose))
        velocity = gtsam.noiseModel.Isotropic.Sigma(3, 1e-2)
        self._before.push_back(gtsam.PriorFactorVector(V(k), self._values.atVector(V(k)), velocity))
        self._before.push_back(gtsam.PriorFactorConstantBias(B(k), self._values.atConstantBias(B(k)), loose))

    monkeypatch.setattr(Window, "_let_go", forget)
    forgetful = smooth(clean, start=told(clean, 1e-2), window__keyframes=4)
    assert forgetful.sigmas[-1, 3].mean() > 3.0 * few.sigmas[-1, 3].mean()


def test_through_darkness_and_back():
    dark = simulate_points(seed=5, seconds=16.0, blackouts=((6.0, 9.0),))
    result = smooth(dark)
    t = seconds(dark, result)
    assert all(e.health is Health.INERTIAL_ONLY for e, s in zip(result.estimates, t, strict=True) if 7.0 < s < 9.0)
    assert all(e.state is not None for e, s in zip(result.estimates, t, strict=True) if s > 6.0)
    assert [e.health for e in result.estimates][-40:] == [Health.TRACKING] * 40
    assert np.isfinite(states(result)).all()
    assert score(result.trajectory, dark.truth)["ate_m"] < 0.3


def test_an_imu_gap_that_cannot_be_bridged_is_a_loss_and_it_goes_on_from_there(flight):
    gap = without_imu(flight, 5.0, 7.0)
    away = [f for f in gap.frames if not 5.0 < (f.t_ns - gap.frames[0].t_ns) * 1e-9 < 7.0]
    broken = replace(gap, frames=away)
    result = smooth(broken)
    lost = [e for e in result.estimates if e.health is Health.LOST]
    assert lost and "IMU gap" in lost[0].reasons[0]
    assert result.estimates[-1].health is Health.TRACKING
    t = seconds(broken, result)
    p = [e.state.p_WB for e in result.estimates if e.state is not None]
    k = int(np.sum([e.state is not None for e, s in zip(result.estimates, t, strict=True) if s < 6.0]))
    assert np.linalg.norm(p[k] - p[k - 1]) < 0.5  # where it was last, as far as anybody knows


def test_short_gaps_are_bridged_and_said(flight):
    result = smooth(without_imu(flight.span(0.0, 6.0), 4.0, 4.2))
    assert any("IMU gap of 0.0" in reason for e in result.estimates for reason in e.reasons)
    assert not any(e.health is Health.LOST for e in result.estimates)


def test_standing_still_is_seen_and_holds_it(flight):
    """A quadrotor stands on the ground first; without its noise it is known to stand better than vision tells."""
    still = flight.span(0.0, 1.9)
    result = smooth(still)
    assert sum("standing still" in e.reasons for e in result.estimates) > 10
    assert np.linalg.norm(result.trajectory.v_WB[-1]) < 0.01
    assert result.sigmas[-1, 2].max() < 0.01


def test_a_second_standstill_is_not_where_the_first_was():
    """Still, then moved a little, then still again: the pose is not tied to that of the first."""
    window = SmootherConfig().window
    keyframes = [SimpleNamespace(k=0, directions={}, still=True)]
    stub = SimpleNamespace(_config=window, _keyframes=keyframes, newest=0)
    assert Window._at_rest(stub, 1).size() == 2
    keyframes[0].still = False  # as a frame that does not stand still leaves it
    assert Window._at_rest(stub, 1).size() == 1
    assert Window._is_keyframe(stub, None, still=True)


@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_noisy_features_are_used_and_their_noise_is_learned(noise):
    sequence = simulate_points(seed=4, seconds=5.0, pixel_noise=noise)
    vio = Smoother(sequence.calibration, start=told(sequence, 1e-3))
    result = run(vio, sequence)
    assert vio._window._sides.noise.sigma == pytest.approx(noise, rel=0.2)
    assert np.median([e.used for e in result.estimates[60:]]) > 60
    assert position_errors(result, sequence).max() < 0.02 * noise


def test_features_that_a_frame_does_not_see_are_no_vision(flight):
    """One stray feature in an otherwise blind frame corrects nothing."""
    t = np.array([f.t_ns - flight.frames[0].t_ns for f in flight.frames]) * 1e-9
    stray = {0: Tracks(np.array([10**6]), np.array([[300.0, 200.0]]))}
    frames = [f if s < 5.0 else Frame(f.t_ns, tracks=stray) for f, s in zip(flight.frames, t, strict=True)]
    result = smooth(replace(flight, frames=frames).span(0.0, 7.0))
    after = [e for e, s in zip(result.estimates, t, strict=False) if s > 5.7]
    assert {e.health for e in after} == {Health.INERTIAL_ONLY} and max(e.used for e in after) == 0


def test_of_measurements_that_share_samples_one_a_window_counts(flight):
    t_ns = np.arange(flight.imu.t_ns[0] + 10**9, flight.imu.t_ns[-1], 10**8)
    priors = [BiasPrior(int(t), np.zeros(3), np.zeros(3), np.eye(6)) for t in t_ns]
    counted = {}
    for mode in ("modelled", "plain"):
        paced = Paced(ListedPrior(priors, None, 1.0, np.zeros((6, 6))), thinned=mode == "modelled")
        paced.add_imu(flight.imu)
        counted[mode] = len(paced.said(int(flight.imu.t_ns[-1])))
    assert counted["plain"] > len(priors) - 10 and counted["modelled"] == pytest.approx(len(priors) / 10, abs=1.0)


def test_what_ends_before_it_starts_ends_well(flight):
    brief = flight.span(0.0, 0.3)
    short = replace(brief, imu=brief.imu.between(0, brief.frames[-1].t_ns - 4_000_000))
    result = smooth(short)
    assert [e.health for e in result.estimates] == [Health.INITIALISING] * len(brief.frames)


@pytest.mark.parametrize("settings", [{}, {"prior__mode": "plain"}, {"prior__preintegration": "prior"}])
def test_a_prior_that_knows_the_biases_helps(settings):
    poor = simulate_points(seed=4, seconds=10.0, pixel_noise=2.0, max_features=25, track_life_s=0.7)
    begin = told(poor, 1e-2, 0.1)
    none = smooth(poor, start=begin)
    t_ns = np.arange(poor.imu.t_ns[0] + 10**9, poor.imu.t_ns[-1], 10**9)
    true = poor.truth.at(t_ns)
    priors = [BiasPrior(int(t), g, a, np.eye(6) * 1e-6) for t, g, a in zip(t_ns, true.b_g, true.b_a, strict=True)]
    said = smooth(poor, ListedPrior(priors, None, 1.0, np.eye(6) * 1e-8), begin, **settings)

    def bias_error(result):
        at = result.trajectory.t_ns
        return np.linalg.norm(result.trajectory.b_a - poor.truth.at(at).b_a, axis=1)[len(at) // 2 :].mean()

    assert bias_error(said) < 0.5 * bias_error(none)


def test_bad_input_is_refused_and_costs_nothing(flight):
    vio = Smoother(flight.calibration)
    vio.add_imu(flight.imu[:100])
    with pytest.raises(InputError, match="does not follow"):
        vio.add_imu(flight.imu[50:60])
    vio.add_frame(flight.frames[0])
    with pytest.raises(InputError, match="does not follow"):
        vio.add_frame(flight.frames[0])


def test_it_is_made_by_name_and_unknown_things_are_named(flight):
    made = make(flight.calibration, load_prior("none"), {"cameras": 2, "window.keyframes": 5})
    assert made.config.cameras == 2 and made.config.window.keyframes == 5
    with pytest.raises(ConfigError, match="3 cameras"):
        make(flight.calibration, load_prior("none"), {"cameras": 3})
    with pytest.raises(ConfigError, match="'lens'"):
        make(flight.calibration, load_prior("none"), {"lens": 3})

"""Is the filter as good as it says? Over many seeded flights, with the bounds of `eval.consistency`.

Each flight is a quadrotor's with EuRoC-like noise, in points mode. Run with -s to see the tables.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from multiprocessing import get_context

import numpy as np
import pytest

from eval.consistency import MEAN_PER_DOF, Consistency, judge, judge_nis, nees
from eval.metrics import score
from msckf.config import CalibrationConfig, FilterConfig
from msckf.filter import Filter
from navcore import so3
from navcore.odometry import Health
from navcore.prior import BiasPrior, load_prior
from navcore.priors.listed import ListedPrior
from navcore.sequence import Frame, Sequence
from sim.points import simulate_points
from tests.msckf.flights import fly

SEEDS = range(1, 51)
TAKE_OFF_S = 4.0  # of the flight, after which everything can be observed

pytestmark = pytest.mark.slow


def over_seeds(worker: Callable, seeds=SEEDS):
    """The worker's answer for every seed, on two processes."""
    with get_context("fork").Pool(2) as pool:
        return pool.map(worker, seeds, chunksize=1)


def of_block(verdict: Consistency, *blocks: str):
    """What is wrong with some of the blocks."""
    return [reason for reason in verdict.reasons if reason.startswith(tuple(f"{block}:" for block in blocks))]


def calibrated(sequence: Sequence, seed: int) -> Sequence:
    """The recording with a calibration that is as wrong about where the camera sits as the filter takes it to be."""
    config, rng = CalibrationConfig(), np.random.default_rng([seed, 2])
    (camera,) = sequence.calibration.cameras
    T_BC = camera.T_BC.copy()
    T_BC[:3, :3] = T_BC[:3, :3] @ so3.exp(config.rotation_sigma * rng.standard_normal(3))
    T_BC[:3, 3] += config.position_sigma * rng.standard_normal(3)
    return replace(sequence, calibration=replace(sequence.calibration, cameras=(replace(camera, T_BC=T_BC),)))


def flight_of(seed, platform="quadrotor"):
    """Of one flight: NEES, ATE as a share of the path, and how often it was lost."""
    sequence = calibrated(simulate_points(platform, seed=seed, seconds=60.0), seed)
    result = fly(sequence)
    scores = score(result.trajectory, sequence.truth)
    lost = sum(e.health is Health.LOST for e in result.estimates)
    return nees(result, sequence.truth, skip_s=TAKE_OFF_S), scores["ate_m"] / scores["path_m"], lost


def test_fifty_flights_are_consistent_and_none_diverges():
    values, shares, lost = zip(*over_seeds(flight_of), strict=True)
    verdict = judge(values)
    print(f"\n{verdict}\nATE {100 * np.mean(shares):.4f} % of the path, worst {100 * max(shares):.4f} %")
    assert sum(lost) == 0
    assert max(shares) < 0.0015
    assert verdict.passed, str(verdict)


@pytest.mark.parametrize("platform", ["rover", "handheld"])
def test_fifty_runs_of_other_platforms_neither_diverge_nor_are_too_sure(platform):
    values, shares, lost = zip(*over_seeds(partial(flight_of, platform=platform)), strict=True)
    verdict = judge(values)
    print(f"\n{platform}\n{verdict}\nATE {100 * np.mean(shares):.4f} % of the path, worst {100 * max(shares):.4f} %")
    assert sum(lost) == 0
    assert max(shares) < 0.0015
    if platform == "handheld" and verdict.mean_per_dof.max() >= MEAN_PER_DOF[1]:
        pytest.xfail("too sure when it sets off gently: docs/filter.md, section 9")
    assert verdict.mean_per_dof.max() < MEAN_PER_DOF[1]


def test_fifty_more_flights_do_not_diverge():
    _, shares, lost = zip(*over_seeds(flight_of, range(51, 101)), strict=True)
    assert sum(lost) == 0
    assert max(shares) < 0.0015


def innovations_of(seed):
    """NIS of what vision and a prior said in one flight: two triples of times, values, degrees of freedom."""
    sequence = calibrated(simulate_points(seed=seed, seconds=30.0), seed)
    settings = FilterConfig().with_overrides({"vision.adapt_noise": False})
    prior = network_like(sequence, np.random.default_rng([seed, 1]))
    vio, vision, said = Filter(sequence.calibration, settings, prior), [], []
    advance = vio._window.advance

    def listen(state, t_ns, *rest):
        outcome = advance(state, t_ns, *rest)
        if outcome.nis is not None:
            vision.append((np.full(len(outcome.nis), t_ns), outcome.nis, outcome.dof))
        return outcome

    vio._window.advance = listen
    applied = 0
    for event in sequence.events():
        for estimate in vio.add_frame(event) if isinstance(event, Frame) else vio.add_imu(event):
            known = vio.prior
            if known.applied > applied:
                applied = known.applied
                said.append((estimate.t_ns, known.nis, 6.0))
    start = sequence.frames[0].t_ns + TAKE_OFF_S * 1e9
    out = []
    for t, nis, dof in (map(np.concatenate, zip(*vision, strict=True)), np.array(said).T):
        flying = t > start
        out.append(((t[flying] - start) * 1e-9, nis[flying], dof[flying]))
    return out


def test_innovations_of_vision_and_prior_are_as_large_as_they_should_be():
    """Features of one frame share the error of the window, and a prior its constant: means, not chi-square tests."""
    for name, of_flights in zip(("vision", "prior"), zip(*over_seeds(innovations_of), strict=True), strict=True):
        verdict = judge_nis(*zip(*of_flights, strict=True))
        print(f"\n{name}\n{verdict}")
        assert MEAN_PER_DOF[0] < verdict.mean_per_dof[0] < MEAN_PER_DOF[1]


def flight_without_first_estimates(seed):
    sequence = calibrated(simulate_points(seed=seed, seconds=60.0), seed)
    return nees(fly(sequence, vision__fej=False), sequence.truth, skip_s=TAKE_OFF_S)


@pytest.mark.xfail(reason="consistent since all of one frame is linearised at the same: docs/filter.md, section 1")
def test_without_first_estimates_yaw_is_overconfident():
    verdict = judge(over_seeds(flight_without_first_estimates, SEEDS[:30]))
    print(f"\n{verdict}")
    assert of_block(verdict, "dtheta")
    assert verdict.mean_per_dof[0] > 1.3


# -- a prior that is wrong by a constant, and repeats its noise -------------------------------------------------

WINDOW_S, EVERY_S = 5.0, 0.5
SIGMA_C = np.repeat([0.003, 0.008], 3)
SIGMA_E = np.repeat([0.003, 0.01], 3)
POOR_VISION = {"pixel_noise": 2.0, "max_features": 25, "track_life_s": 0.7}


def network_like(sequence: Sequence, rng: np.random.Generator) -> ListedPrior:
    """z = b + c + e at overlapping windows: c once a run, e the mean of white noise over each window."""
    t_ns = np.arange(sequence.imu.t_ns[0], sequence.imu.t_ns[-1], round(EVERY_S * 1e9))
    share = round(WINDOW_S / EVERY_S)
    white = rng.standard_normal((len(t_ns) + share, 6)) * np.sqrt(share)
    e = np.array([white[k : k + share].mean(axis=0) for k in range(len(t_ns))]) * SIGMA_E
    true = sequence.truth.at(t_ns)
    z = np.hstack([true.b_g, true.b_a]) + SIGMA_C * rng.standard_normal(6) + e
    first = round(0.5 * WINDOW_S / EVERY_S)  # the first whole window
    measurements = [BiasPrior(int(t), v[:3], v[3:], np.diag(SIGMA_E**2)) for t, v in zip(t_ns, z, strict=True)]
    return ListedPrior(measurements[first:], None, WINDOW_S, np.diag(SIGMA_C**2))


def arms_of(seed):
    """NEES of one flight under poor vision by arm."""
    sequence = calibrated(simulate_points(seed=seed, seconds=20.0, **POOR_VISION), seed)
    arms = {}
    for arm, prior in (("none", False), ("modelled", True), ("plain", True)):
        source = network_like(sequence, np.random.default_rng([seed, 1])) if prior else None
        mode = {"prior__mode": arm} if prior else {}
        result = fly(sequence, source, vision__pixel_noise=2.0, **mode)
        arms[arm] = nees(result, sequence.truth, skip_s=TAKE_OFF_S), result.sigmas[-1, 3:].mean(axis=1)
    return arms


def test_a_prior_is_consistent_as_modelled_and_overconfident_as_plain():
    flights = over_seeds(arms_of)
    verdicts = {arm: judge([f[arm][0] for f in flights]) for arm in flights[0]}
    sigmas = {arm: np.mean([f[arm][1] for f in flights], axis=0) for arm in flights[0]}
    for arm, verdict in verdicts.items():
        print(f"\n{arm}: sigma at the end {sigmas[arm][0]:.2e} rad/s, {sigmas[arm][1]:.2e} m/s^2\n{verdict}")
    assert of_block(verdicts["plain"], "db_a")
    assert verdicts["plain"].mean_per_dof[4] > 1.3
    both = verdicts["none"], verdicts["modelled"]
    assert max(v.mean_per_dof[3:].max() for v in both) < MEAN_PER_DOF[1]
    if min(v.mean_per_dof[3] for v in both) <= MEAN_PER_DOF[0]:
        pytest.xfail("b_g is stated too carefully, with and without a prior: a start at rest doubts that it is still")
    assert not any(of_block(v, "db_g", "db_a") for v in both)


# -- priors that were learned -----------------------------------------------------------------------------------

LEARNED = {
    "none": ("none", "modelled"),
    "ipnet": ("ipnet:sim-quadrotor", "modelled"),
    "motion": ("motion:sim-quadrotor", "modelled"),
    "ipnet, plain": ("ipnet:sim-quadrotor", "plain"),
}  # these saw flights with seeds from 100001 on


def told(seed):
    """NEES of one flight by what the filter is told of its biases."""
    sequence = calibrated(simulate_points(seed=seed, seconds=60.0), seed)
    return {
        arm: nees(fly(sequence, load_prior(spec, sequence), prior__mode=mode), sequence.truth, skip_s=TAKE_OFF_S)
        for arm, (spec, mode) in LEARNED.items()
    }


def test_biases_are_consistent_with_a_learned_prior():
    flights = over_seeds(told)
    verdicts = {arm: judge([flight[arm] for flight in flights]) for arm in LEARNED}
    for arm, verdict in verdicts.items():
        print(f"\n{arm}\n{verdict}")
    for arm in ("none", "ipnet", "motion"):
        assert not of_block(verdicts[arm], "db_g", "db_a")

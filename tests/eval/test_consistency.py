import numpy as np
import pytest
from filterpy.stats import NEES
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from eval.consistency import (
    Nees,
    chi_square_bounds,
    errors_in_start_gauge,
    judge,
    judge_nis,
    nees,
)
from eval.errors import ScoreError
from navcore import so3
from navcore.odometry import BLOCKS, Estimate, Health, Run, RunRecorder, State
from navcore.trajectory import Trajectory
from tests.eval.paths import flight

SIGMA = np.repeat([0.01, 0.1, 0.05, 1e-3, 0.02], 3)


def honest_run(truth: Trajectory, rng: np.random.Generator, inflate: float = 1.0, yaw: float = 0.0) -> Run:
    """Estimates whose errors are drawn from their covariance, in a world turned by `yaw`; the first is exact.

    `inflate` multiplies the errors, not the covariance.
    """
    R_VW = Rotation.from_euler("z", yaw).as_matrix()
    recorder = RunRecorder()
    A = rng.normal(size=(15, 15)) * 0.3 + np.eye(15)
    P = (SIGMA[:, None] * A) @ (SIGMA[:, None] * A).T
    root, R_WB = np.linalg.cholesky(P), truth.R_WB
    for k in range(0, len(truth), 4):
        e = inflate * root @ rng.standard_normal(15) if k else np.zeros(15)
        state = State(
            R_VW @ R_WB[k] @ so3.exp(-e[:3]),  # R = R_hat Exp(e)
            R_VW @ truth.p_WB[k] + [1.0, 2.0, 3.0] - e[3:6],
            R_VW @ truth.v_WB[k] - e[6:9],
            truth.b_g[k] - e[9:12],
            truth.b_a[k] - e[12:],
            P,
        )
        recorder.add([Estimate(int(truth.t_ns[k]), Health.TRACKING, state=state)])
    return recorder.result()


@pytest.fixture(scope="module")
def truth():
    return flight(np.random.default_rng(5), seconds=20.0)


def family(truth, count=50, **options):
    return [nees(honest_run(truth, np.random.default_rng(s), **options), truth) for s in range(count)]


def test_nees_is_filterpys(truth):
    run = honest_run(truth, np.random.default_rng(6), yaw=1.0)
    found = nees(run, truth, skip_s=1.0)
    errors = errors_in_start_gauge(run.trajectory, truth)
    keep = run.trajectory.seconds >= 1.0
    for k in range(5):
        oracle = NEES(errors[keep, k], np.zeros((keep.sum(), 3)), run.covariances[keep, k])
        np.testing.assert_allclose(found.values[:, k], oracle, rtol=1e-6)


def test_the_gauge_is_that_of_the_start(truth):
    run = honest_run(truth, np.random.default_rng(7), inflate=0.0, yaw=2.5)
    np.testing.assert_allclose(errors_in_start_gauge(run.trajectory, truth), 0.0, atol=1e-7)


def test_a_tilt_at_the_start_is_an_error_and_a_yaw_is_not(truth):
    path = truth[::4]
    tilt, yaw = Rotation.from_rotvec([0.02, -0.01, 0.0]), Rotation.from_euler("z", -3.0)
    q = (yaw * tilt * Rotation.from_quat(path.q_WB)).as_quat()
    turned = Trajectory(path.t_ns, q, path.p_WB, path.v_WB, path.b_g, path.b_a)
    errors = errors_in_start_gauge(turned, truth)
    R_hat = Rotation.from_quat(q[0]).as_matrix()
    in_V = R_hat @ errors[0, 0]
    np.testing.assert_allclose(np.linalg.norm(in_V), np.hypot(0.02, 0.01), rtol=1e-6)
    assert in_V[2] == pytest.approx(0.0, abs=1e-9)


def test_errors_are_truth_less_estimate_in_the_world_of_the_estimate(truth):
    path = truth[::4]
    shift = np.zeros((len(path), 3))
    shift[5:] = [0.5, 0.0, 0.0]
    R_VW = Rotation.from_euler("z", 0.5 * np.pi).as_matrix()
    q = so3.to_quaternion(R_VW @ path.R_WB)
    estimate = Trajectory(path.t_ns, q, path.p_WB @ R_VW.T + shift, path.v_WB @ R_VW.T, path.b_g - 1e-3, path.b_a)
    errors = errors_in_start_gauge(estimate, truth)
    np.testing.assert_allclose(errors[5:, 1], np.tile([-0.5, 0.0, 0.0], (len(path) - 5, 1)), atol=1e-9)
    np.testing.assert_allclose(errors[:, 3], 1e-3, atol=1e-12)


def test_an_honest_estimator_passes(truth):
    result = judge(family(truth, yaw=0.7))
    assert result.passed, str(result)
    assert result.runs == 50
    np.testing.assert_allclose(result.mean_per_dof, 1.0, atol=0.1)


@pytest.mark.parametrize("inflate", [0.7, 1.3])
def test_one_that_is_too_sure_or_too_modest_fails(truth, inflate):
    result = judge(family(truth, inflate=inflate))
    assert not result.passed
    np.testing.assert_allclose(result.mean_per_dof, inflate**2, rtol=0.1)
    assert all(any(name in reason for reason in result.reasons) for name in BLOCKS)
    assert "NOT consistent" in str(result)


def test_a_fault_that_comes_and_goes_is_found_at_its_checkpoint(truth):
    runs = family(truth)
    for run in runs:
        run.values[np.abs(run.t_s - run.t_s[-1]) < 0.5, 2] *= 2.5
    result = judge(runs)
    assert [r.split(":")[0] for r in result.reasons] == ["dv"]
    assert "1 of 10 checkpoints" in result.reasons[0]


def test_the_family_keeps_its_level():
    """Of many perfect families 99.9 % pass all their tests, by simulation at a level that can be counted."""
    rng = np.random.default_rng(8)
    low, high = chi_square_bounds(np.array(150.0), tests=50, level=0.9)
    sums = rng.chisquare(150.0, size=(4000, 50)) / 150.0
    held = np.mean(np.all((sums > low) & (sums < high), axis=1))
    assert 0.89 < held < 0.93
    single = chi_square_bounds(np.array(150.0), tests=1, level=0.95)
    np.testing.assert_allclose(single, chi2.interval(0.95, 150.0) / np.array(150.0))


def test_nis_of_right_innovations_passes_and_of_reused_ones_fails():
    rng = np.random.default_rng(9)
    t_s = [np.arange(0.0, 30.0, 0.05)] * 20
    dof = [rng.integers(1, 40, 600).astype(float) for _ in t_s]
    nis = [rng.chisquare(d) for d in dof]
    assert judge_nis(t_s, nis, dof).passed
    assert not judge_nis(t_s, [0.6 * x for x in nis], dof).passed
    assert judge_nis(t_s, nis, dof).mean_per_dof[0] == pytest.approx(1.0, abs=0.02)


def test_what_cannot_be_judged_is_said(truth):
    run = honest_run(truth, np.random.default_rng(10))
    with pytest.raises(ScoreError, match="truth lacks b_g, b_a"):
        nees(run, Trajectory(truth.t_ns, truth.q_WB, truth.p_WB, truth.v_WB))
    with pytest.raises(ScoreError, match="truth at every pose"):
        nees(run, truth[:100])
    with pytest.raises(ScoreError, match="none"):
        judge([])
    with pytest.raises(ScoreError, match="no common time"):
        judge([Nees(np.array([0.0, 1.0]), np.ones((2, 5))), Nees(np.array([2.0, 3.0]), np.ones((2, 5)))])
    with pytest.raises(ScoreError, match="differ in length"):
        judge_nis([np.zeros(2)], [np.zeros(3)], [np.ones(3)])
    singular = Run(run.estimates, np.zeros_like(run.covariances), run.has_state)
    with pytest.raises(ScoreError, match="not positive definite"):
        nees(singular, truth)

"""Is an estimator as good as it says? Errors against its own covariance (NEES), innovations too (NIS)."""

from collections.abc import Sequence as ListLike
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from eval.errors import ScoreError
from navcore import so3
from navcore.arrays import Floats
from navcore.odometry import BLOCKS, Run
from navcore.trajectory import Trajectory

MEAN_PER_DOF = (0.75, 1.3)
"""What the mean over runs and time may be, per degree of freedom."""
FAMILY_LEVEL = 0.999
"""A perfect estimator passes all chi-square tests of one family together with at least this probability."""
_DOF = 3


@dataclass(frozen=True)
class Nees:
    """Normalised squared errors of one run.

    Attributes:
        t_s: (M,) seconds since the truth begins.
        values: (M, 5) e^T P^-1 e by block, in the order of `BLOCKS`; three expected.
    """

    t_s: Floats
    values: Floats


@dataclass(frozen=True)
class Consistency:
    """The judgement over many independent runs.

    Attributes:
        names: (K,) what was judged.
        runs: how many runs.
        mean_per_dof: (K,) over all runs and times.
        t_s: (T,) checkpoints [s].
        per_dof: (T, K) mean over the runs at each checkpoint.
        low, high: (T, K) bounds of `per_dof`, two-sided, `FAMILY_LEVEL` for all T x K together.
        reasons: why it did not pass, a line each.
    """

    names: tuple[str, ...]
    runs: int
    mean_per_dof: Floats
    t_s: Floats
    per_dof: Floats
    low: Floats
    high: Floats
    reasons: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether nothing was found wrong."""
        return not self.reasons

    @property
    def table(self) -> list[dict[str, str | float]]:
        """A row for each block: mean over time, smallest and largest checkpoint, their bounds."""
        return [
            {
                "block": name,
                "mean": float(self.mean_per_dof[k]),
                "lowest": float(self.per_dof[:, k].min()),
                "highest": float(self.per_dof[:, k].max()),
                "low": float(self.low[:, k].max()),
                "high": float(self.high[:, k].min()),
            }
            for k, name in enumerate(self.names)
        ]

    def __str__(self) -> str:
        head = f"{self.runs} runs, {len(self.t_s)} checkpoints: " + ("consistent" if self.passed else "NOT consistent")
        rows = [
            f"  {r['block']:<8} mean {r['mean']:.3f}  checkpoints {r['lowest']:.3f} .. {r['highest']:.3f}"
            f"  allowed {r['low']:.3f} .. {r['high']:.3f}"
            for r in self.table
        ]
        return "\n".join([head, *rows, *(f"  {reason}" for reason in self.reasons)])


def errors_in_start_gauge(estimate: Trajectory, truth: Trajectory) -> Floats:
    """(M, 5, 3) errors by block, in the order of `BLOCKS`, in the world in which the estimate began.

    A VIO cannot know its position and yaw: they are chosen at its first pose, so there the truth is moved
    onto the estimate, in position and in yaw (the twist about z that the first orientation error contains).
    From then on R_WB = R_hat Exp(dtheta) defines the orientation error, all others are truth less estimate.

    Args:
        estimate: with velocity and biases, every pose inside truth's span.
        truth: with velocity and biases.

    Raises:
        ScoreError: velocity or a bias is missing, or truth does not cover a pose.
    """
    columns = ("v_WB", "b_g", "b_a")
    for path, name in ((estimate, "estimate"), (truth, "truth")):
        missing = [c for c in columns if getattr(path, c) is None]
        if missing:
            raise ScoreError(f"consistency needs {', '.join(columns)}; the {name} lacks {', '.join(missing)}")
    covered = truth.covers(estimate.t_ns)
    if len(estimate) == 0 or not covered.all():
        outside = "has no pose" if len(estimate) == 0 else f"at {estimate.t_ns[np.argmin(covered)]} ns is outside"
        raise ScoreError(f"consistency needs truth at every pose; the estimate {outside}")
    true = truth.at(estimate.t_ns)
    R_hat, R_true = estimate.R_WB, true.R_WB
    _, _, z, w = so3.to_quaternion(R_true[0] @ R_hat[0].T)
    R_WV = so3.exp(np.array([0.0, 0.0, 2.0 * np.arctan2(z, w)]))  # V: the world of the estimate
    errors = np.empty((len(estimate), len(BLOCKS), 3))
    errors[:, 0] = so3.log(np.swapaxes(R_hat, 1, 2) @ R_WV.T @ R_true)
    errors[:, 1] = (true.p_WB - true.p_WB[0]) @ R_WV - (estimate.p_WB - estimate.p_WB[0])
    for k, name in enumerate(columns, 2):
        value = getattr(true, name)
        errors[:, k] = (value @ R_WV if name == "v_WB" else value) - getattr(estimate, name)
    return errors


def nees(run: Run, truth: Trajectory, *, skip_s: float = 1.0) -> Nees:
    """The normalised errors of a run, in the gauge of its start.

    Args:
        run: with covariances. truth: with velocity and biases.
        skip_s: left out after the first pose, where position and yaw are certain by definition.

    Raises:
        ScoreError: as `errors_in_start_gauge`; a covariance that is not positive definite; nothing left.
    """
    estimate = run.trajectory
    errors = errors_in_start_gauge(estimate, truth)
    keep = estimate.seconds >= skip_s
    if not keep.any():
        raise ScoreError(f"the run has no pose later than {skip_s} s after its first")
    P, e = run.covariances[keep], errors[keep]
    try:
        whitened = np.linalg.solve(np.linalg.cholesky(P), e[..., None])[..., 0]
    except np.linalg.LinAlgError as error:
        raise ScoreError("a covariance block of the run is not positive definite") from error
    t_s = (estimate.t_ns[keep] - truth.t_ns[0]) * 1e-9
    return Nees(t_s, np.sum(whitened**2, axis=-1))


def chi_square_bounds(dof: Floats, tests: int, level: float = FAMILY_LEVEL) -> tuple[Floats, Floats]:
    """Two-sided bounds of a chi-square sum, by degree of freedom, so that `tests` of them hold with `level`.

    Bonferroni: each test gets an equal share of 1 - level, so the tests may depend on each other.
    """
    share = (1.0 - level) / tests
    dof = np.asarray(dof, dtype=np.float64)
    return chi2.ppf(0.5 * share, dof) / dof, chi2.isf(0.5 * share, dof) / dof


def judge(runs: ListLike[Nees], checkpoints: int = 10) -> Consistency:
    """Whether the errors of independent runs fit their covariances.

    At each checkpoint the sum over N runs is chi-square with 3 N degrees of freedom; the mean over time is
    not, as errors at neighbouring times depend on each other, and is held to `MEAN_PER_DOF`.
    Source: Bar-Shalom, Li, Kirubarajan, "Estimation with applications to tracking and navigation" (2001),
    section 5.4.2.

    Raises:
        ScoreError: no runs, or runs without a common stretch of time.
    """
    if not runs:
        raise ScoreError("consistency needs at least one run, got none")
    start, end = max(r.t_s[0] for r in runs), min(r.t_s[-1] for r in runs)
    if end <= start:
        raise ScoreError(f"the runs have no common time: the last begins at {start:.2f} s, one ends at {end:.2f} s")
    t_s = np.linspace(start, end, checkpoints)
    at = np.array([r.values[np.abs(r.t_s[:, None] - t_s).argmin(axis=0)] for r in runs])  # (N, T, 5)
    mean = np.mean([r.values.mean(axis=0) for r in runs], axis=0) / _DOF
    dof = np.full(at.shape[1:], float(_DOF * len(runs)))
    return _judged(BLOCKS, len(runs), mean, t_s, at.sum(axis=0), dof)


def judge_nis(t_s: ListLike[Floats], nis: ListLike[Floats], dof: ListLike[Floats], bins: int = 10) -> Consistency:
    """Whether the innovations of runs fit their covariances.

    Innovations of a right filter are independent, so those of all runs in one bin of time add up to a
    chi-square sum. Give those from before gating and weighting, made without noise adaptation.

    Args:
        t_s, nis, dof: for each run (M,) times [s], innovations squared and normalised, their degrees.

    Raises:
        ScoreError: no innovation, or lengths that differ.
    """
    if [len(x) for x in t_s] != [len(x) for x in nis] or [len(x) for x in nis] != [len(x) for x in dof]:
        raise ScoreError("times, NIS and degrees of freedom differ in length")
    t, values, degrees = (np.concatenate([*x, np.zeros(0)]) for x in (t_s, nis, dof))
    if len(t) == 0:
        raise ScoreError("consistency needs at least one innovation, got none")
    edges = np.linspace(t.min(), t.max(), bins + 1)
    place = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, bins - 1)
    sums, sizes = (np.bincount(place, x, bins).astype(np.float64) for x in (values, degrees))
    held = sizes > 0
    middles = 0.5 * (edges[:-1] + edges[1:])[held]
    mean = np.array([values.sum() / degrees.sum()])
    return _judged(("nis",), len(nis), mean, middles, sums[held, None], sizes[held, None])


def _judged(names: tuple[str, ...], runs: int, mean: Floats, t_s: Floats, sums: Floats, dof: Floats) -> Consistency:
    """Compare means with `MEAN_PER_DOF`, and (T, K) sums with their chi-square bounds."""
    per_dof = sums / dof
    low, high = chi_square_bounds(dof, sums.size)
    reasons = []
    for k, name in enumerate(names):
        if not MEAN_PER_DOF[0] <= mean[k] <= MEAN_PER_DOF[1]:
            reasons.append(f"{name}: mean {mean[k]:.3f} is outside {MEAN_PER_DOF[0]} .. {MEAN_PER_DOF[1]}")
        outside = np.flatnonzero(~((low[:, k] <= per_dof[:, k]) & (per_dof[:, k] <= high[:, k])))
        if len(outside):
            j = outside[0]
            first = f"{per_dof[j, k]:.3f}, allowed {low[j, k]:.3f} .. {high[j, k]:.3f}"
            count = f"{len(outside)} of {len(t_s)} checkpoints outside their bounds"
            reasons.append(f"{name}: {count}, first at {t_s[j]:.1f} s: {first}")
    return Consistency(names, runs, mean, t_s, per_dof, low, high, tuple(reasons))

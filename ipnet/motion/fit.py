"""A motion model from recordings whose path and biases are known."""

from collections.abc import Sequence as ListLike
from dataclasses import dataclass

import numpy as np

from ipnet.errors import LabelError
from ipnet.motion.intervals import FEATURES, FORCE, PLACE, RATE, SPEED, TURNS, UP, Intervals, noise_shake
from ipnet.motion.model import EFFECTS, ROWS, MotionModel
from ipnet.preintegration import coverage, preintegrate
from ipnet.recordings import Recording
from navcore.arrays import Floats, Mask, Stamps
from navcore.imu import GRAVITY

G_W = np.array([0.0, 0.0, -GRAVITY])
_RIDGE = 1e-2  # of a coefficient of features scaled to one, in samples
_MAX_GAP_NS = 100_000_000
_ROUNDS = 10
_LOUD = 0.8  # log10: from here on the platform is heard through the noise
_LEAST = 60  # intervals in motion that a run must have, and 4 runs' worth in all


@dataclass(frozen=True)
class Path:
    """A run in features.

    Attributes:
        u: (N, 15); turns: (N, 9); still, shake: (N,).
        joins: (N - 1,) whether an interval is followed by the next without a gap in the truth.
    """

    u: Floats
    turns: Floats
    still: Mask
    shake: Floats
    joins: Mask


def path(recording: Recording, interval_s: float) -> Path:
    """Features along the truth of a recording; places are from the mean position.

    Raises:
        LabelError: it has no truth.
    """
    truth = recording.truth
    if truth is None:
        raise LabelError(f"{recording.name}: has no truth; a motion model is learned along one")
    first, last = coverage(recording.imu)
    edges: Stamps = np.arange(
        max(first, int(truth.t_ns[0])), min(last, int(truth.t_ns[-1])), round(interval_s * 1e9), dtype=np.int64
    )
    there = truth.at(edges)
    bias = recording.bias_at(edges[:-1])
    whole = truth.covers(edges, _MAX_GAP_NS)
    R = there.R_WB[:-1]
    inc = preintegrate(recording.imu, edges, bias[:, :3], bias[:, 3:])
    T = inc.dt[:, None]
    # Velocity from two positions and what lies between: no derivative of a position is taken.
    v_W = (np.diff(there.p_WB, axis=0) - 0.5 * G_W * T**2 - (R @ inc.delta_p[..., None])[..., 0]) / T
    from_middle = there.p_WB[:-1] - there.p_WB.mean(axis=0)
    in_B = [np.einsum("nji,nj->ni", R, x) for x in (np.tile(G_W, (len(R), 1)), v_W, from_middle)]
    intervals = Intervals.of(recording.imu, edges, bias[:, :3], bias[:, 3:], recording.noise)
    good = whole[:-1] & whole[1:]
    u = intervals.features(np.hstack([*in_B, bias]))
    return Path(u, intervals.turns, intervals.still, intervals.shake, good[:-1] & good[1:])


@dataclass(frozen=True)
class _Rows:
    """All pairs of successive intervals in motion: features before and after, turns before and after, and whose."""

    u: Floats
    u_next: Floats
    turns: Floats
    turns_next: Floats
    run: Stamps

    @staticmethod
    def of(paths: ListLike[Path], gate: float | None) -> "_Rows":
        parts = []
        for p in paths:
            own = ~p.still if gate is None else ~p.still & (p.shake > gate)
            use = p.joins & own[1:] & own[:-1]
            if use.sum() >= _LEAST:
                parts.append((p.u[:-1][use], p.u[1:][use], p.turns[:-1][use], p.turns[1:][use]))
        if sum(len(part[0]) for part in parts) < 4 * _LEAST:
            raise LabelError(f"too little motion to learn from: expected {4 * _LEAST} intervals, {_LEAST} in a run")
        run = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
        u, u_next, turns, turns_next = (np.vstack(x) for x in zip(*parts, strict=True))
        return _Rows(u, u_next, turns, turns_next, run)


def fit(recordings: ListLike[Recording], interval_s: float = 0.5, dof: float = 5.0) -> MotionModel:
    """The model under which the recordings are most likely, resting apart.

    Force is drag and lever arm, and what is left of it decays; velocity decays and is pulled to the middle; tilt and
    rate decay. (With every row depending on every feature, simulated flights are inferred no better, and real ones,
    of which there are few, worse.) Slopes are common, constants each run's own; then what differs from run to run is
    measured.

    Raises:
        LabelError: there is too little motion to learn from.
    """
    paths = [path(r, interval_s) for r in recordings]
    gate = _gate(recordings, paths)
    rows = _Rows.of(paths, gate)
    weight = np.ones(len(rows.u))
    rho = np.zeros(3)
    for _ in range(_ROUNDS):
        A, B, C, D = _slopes(rows, weight, rho)
        rho = np.diag(A)[:3].copy()
        off = rows.u_next[:, :ROWS] - rows.u @ A.T - rows.turns_next @ B.T - rows.turns @ C.T
        off[:, FORCE] -= rows.u_next[:, SPEED] @ D.T
        w = _centred(off, rows.run, weight)
        Q = (weight[:, None] * w).T @ w / len(w)
        Q *= np.kron(np.eye(4), np.ones((3, 3)))
        distance = np.sum(w * np.linalg.solve(Q, w.T).T, axis=1)
        weight = (dof + ROWS) / (dof + distance)
    c = _run_means(off, rows.run, weight).mean(axis=0)
    everything = np.vstack([rows.u, rows.u_next])
    effects = _effects(rows, weight, off - c, Q)
    mean, spread = everything.mean(axis=0), np.cov(everything.T)
    return MotionModel(interval_s, A, B, C, c, D, Q, effects, mean, spread, dof, gate)


def _gate(recordings: ListLike[Recording], paths: ListLike[Path]) -> float | None:
    """Half-way (of logarithms) between what noise shakes and what the platform shakes, where these are far apart."""
    usual = float(np.median(np.concatenate([p.shake[~p.still] for p in paths])))
    noise = float(np.median([noise_shake(r.noise) for r in recordings]))
    return 0.5 * (usual + noise) if usual - noise > _LOUD else None


def _slopes(rows: _Rows, weight: Floats, rho: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """A, B, C, D with force by velocity and turns, its rest decaying by `rho`; the others by their own last values."""
    A, B, C, D = np.zeros((ROWS, FEATURES)), np.zeros((ROWS, TURNS)), np.zeros((ROWS, TURNS)), np.zeros((3, 3))
    cause = np.hstack([rows.u[:, SPEED], rows.turns])
    cause_next = np.hstack([rows.u_next[:, SPEED], rows.turns_next])
    for i in range(3):
        y, y_next = rows.u[:, [i]], rows.u_next[:, [i]]
        slope = _regress(cause_next - rho[i] * cause, y_next - rho[i] * y, rows.run, weight)[0]
        D[i], B[i] = slope[:3], slope[3:]
        rest, rest_next = y - cause @ slope[:, None], y_next - cause_next @ slope[:, None]
        A[i, i] = np.clip(_regress(rest, rest_next, rows.run, weight)[0, 0], 0.0, 0.99)
        A[i, SPEED], C[i] = -A[i, i] * D[i], -A[i, i] * B[i]
    pulled = np.hstack([rows.u[:, SPEED], rows.u[:, PLACE]])
    slope = _regress(pulled, rows.u_next[:, SPEED], rows.run, weight)
    A[SPEED, SPEED], A[SPEED, PLACE] = slope[:, :3], slope[:, 3:]
    for part in (UP, RATE):
        A[part, part] = _regress(rows.u[:, part], rows.u_next[:, part], rows.run, weight)
    return A, B, C, D


def _regress(X: Floats, Y: Floats, run: Stamps, weight: Floats) -> Floats:
    """(y, x) slopes of Y by X within runs, weighted, with a touch of ridge."""
    Xc, Yc = _centred(X, run, weight), _centred(Y, run, weight)
    scale = Xc.std(axis=0) + 1e-9
    Z = Xc / scale
    normal = Z.T @ (weight[:, None] * Z) + _RIDGE * np.eye(Z.shape[1])
    slopes: Floats = np.linalg.solve(normal, Z.T @ (weight[:, None] * Yc)).T / scale
    return slopes


def _effects(rows: _Rows, weight: Floats, rest: Floats, Q: Floats) -> Floats:
    """(21, 21) covariance between runs: what the constants and drags of single runs scatter beyond chance."""
    runs = range(int(rows.run.max()) + 1)
    found, chance = np.zeros((len(runs), EFFECTS)), np.zeros((len(runs), EFFECTS))
    for k in runs:
        mine = rows.run == k
        v, own, W = rows.u_next[mine][:, SPEED], rest[mine], weight[mine][:, None]
        Z = np.hstack([np.ones((len(v), 1)), v])
        inverse = np.linalg.inv(Z.T @ (W * Z) + 1e-6 * np.eye(4))
        slopes = inverse @ Z.T @ (W * own[:, FORCE])  # (4, 3)
        found[k, :ROWS] = (W * own).sum(axis=0) / W.sum()
        found[k, ROWS:] = slopes[1:].T.ravel()
        chance[k, :ROWS] = np.diag(Q) / W.sum()
        chance[k, ROWS:] = np.outer(np.diag(Q)[FORCE], np.diag(inverse)[1:]).ravel()
    variance = np.mean(found**2, axis=0) * len(runs) / max(len(runs) - 1, 1) - chance.mean(axis=0)
    return np.diag(np.maximum(variance, 0.1 * chance.mean(axis=0)))


def _run_means(values: Floats, run: Stamps, weight: Floats) -> Floats:
    """(runs, columns) weighted."""
    sums = np.stack([np.bincount(run, weight * v) for v in values.T], axis=1)
    means: Floats = sums / np.bincount(run, weight)[:, None]
    return means


def _centred(values: Floats, run: Stamps, weight: Floats) -> Floats:
    """Less the weighted mean of each run."""
    return values - _run_means(values, run, weight)[run]

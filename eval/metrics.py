"""How far an estimate is from the truth: ATE, RPE, bias errors, drift, divergence."""

from dataclasses import dataclass

import numpy as np

from eval.alignment import Mode, align
from eval.errors import ScoreError
from navcore import so3
from navcore.arrays import Floats, Rotations, Stamps, Vectors
from navcore.trajectory import Trajectory

SEGMENT_LENGTHS_M = (8.0, 16.0, 24.0, 32.0, 40.0)
INITIAL_PHASE_S = 10.0
DIVERGED_SHARE_OF_PATH = 0.1
DIVERGED_AT_LEAST_M = 0.5
_SEGMENT_TOLERANCE = 0.2  # a segment may be longer than asked by this share


@dataclass(frozen=True)
class Association:
    """Estimate and truth at the same stamps.

    Attributes:
        estimate: the estimated poses that truth covers.
        truth: the truth interpolated at their stamps.
        index: (M,) place of each pose in the whole estimate.
    """

    estimate: Trajectory
    truth: Trajectory
    index: Stamps

    def __len__(self) -> int:
        return len(self.index)

    def aligned(self, mode: Mode) -> "Association":
        """The same with the estimate moved onto the truth."""
        moved = align(self.estimate.p_WB, self.truth.p_WB, mode).apply(self.estimate)
        return Association(moved, self.truth, self.index)

    def first(self, seconds: float) -> "Association":
        """The part within `seconds` of the first pose."""
        n = int(np.searchsorted(self.estimate.seconds, seconds, side="right"))
        return Association(self.estimate[:n], self.truth[:n], self.index[:n])


def associate(estimate: Trajectory, truth: Trajectory) -> Association:
    """The estimated poses that truth covers; poses outside truth's span or in its gaps do not count."""
    index = np.flatnonzero(truth.covers(estimate.t_ns))
    found = estimate[index]
    return Association(found, truth.at(found.t_ns) if len(found) else found, index)


def position_errors(pair: Association) -> Floats:
    """(M,) distances between estimate and truth [m]."""
    errors: Floats = np.linalg.norm(pair.estimate.p_WB - pair.truth.p_WB, axis=1)
    return errors


def orientation_errors(pair: Association) -> Floats:
    """(M,) angles between estimate and truth [rad]."""
    return _angles(np.swapaxes(pair.truth.R_WB, 1, 2) @ pair.estimate.R_WB)


def relative_errors(pair: Association, first: Stamps, last: Stamps) -> tuple[Floats, Floats]:
    """Angles [rad] and distances [m] between true and estimated motion from poses `first` to poses `last`.

    Source: Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems" (2012), eq. (2).
    """
    R_truth, p_truth = _motion(pair.truth, first, last)
    R_estimate, p_estimate = _motion(pair.estimate, first, last)
    angles = _angles(np.swapaxes(R_truth, 1, 2) @ R_estimate)
    distances: Floats = np.linalg.norm(p_estimate - p_truth, axis=1)
    return angles, distances


def segments(truth: Trajectory, length_m: float) -> tuple[Stamps, Stamps]:
    """First and last pose of the stretches of true path that are `length_m` long, one from every pose.

    A stretch ends at the first pose at or past that length, and counts if it is at most 20 % longer.
    Source: Zhang, Scaramuzza, "A tutorial on quantitative trajectory evaluation" (2018), section IV-D.
    """
    steps = np.linalg.norm(np.diff(truth.p_WB, axis=0), axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    first = np.arange(len(truth))
    last = np.searchsorted(travelled, travelled + length_m)
    first, last = first[last < len(truth)], last[last < len(truth)]
    good = travelled[last] - travelled[first] <= (1.0 + _SEGMENT_TOLERANCE) * length_m
    return first[good], last[good]


def still_drift(estimate: Trajectory, seconds: float) -> float:
    """The largest distance between any two positions of the last `seconds` of a path [m].

    It means drift where the rig is known to have stood still then; no alignment changes it.

    Raises:
        ScoreError: the path is empty.
    """
    if len(estimate) == 0:
        raise ScoreError("an empty trajectory has no last seconds to measure drift in")
    p_WB = estimate[estimate.seconds >= estimate.seconds[-1] - seconds].p_WB
    return max(float(np.linalg.norm(p_WB - p, axis=1).max()) for p in p_WB)


def has_diverged(ate_m: float, path_m: float) -> bool:
    """Whether an ATE counts as divergence: more than 10 % of the path and more than 0.5 m."""
    return ate_m > max(DIVERGED_SHARE_OF_PATH * path_m, DIVERGED_AT_LEAST_M)


def score(estimate: Trajectory, truth: Trajectory, *, alignment: Mode = "yaw") -> dict[str, float]:
    """All measures of one run; what cannot be had is left out, and nothing is NaN.

    Keys:
        poses: poses that were compared. diverged: 1 or 0; a run without any pose to compare has diverged.
        path_m: true path between the first and the last of them [m].
        ate_m, ate_deg: RMSE of position [m] and orientation [deg] after alignment.
        initial_ate_m, initial_ate_deg: the same over the 10 s from the first pose, aligned over these alone.
        rpe_rad, rpe_m: RMSE of rotation [rad] and translation [m] from frame to frame.
        rpe_8m_deg, rpe_8m_m, ... 40m: medians over stretches of true path of that length.
        b_g_rmse, b_g_end, b_a_rmse, b_a_end: norm of the bias error [rad/s, m/s^2], RMSE and at the end.
    """
    pair = associate(estimate, truth)
    if len(pair) == 0:
        return {"poses": 0.0, "diverged": 1.0}
    result = {"poses": float(len(pair)), "path_m": pair.truth.length}
    for prefix, part in (("", pair), ("initial_", pair.first(INITIAL_PHASE_S))):
        moved = part.aligned(alignment)
        result[f"{prefix}ate_m"] = _rms(position_errors(moved))
        result[f"{prefix}ate_deg"] = float(np.degrees(_rms(orientation_errors(moved))))
    result["diverged"] = float(has_diverged(result["ate_m"], result["path_m"]))
    return result | _frame_rpe(pair) | _segment_rpe(pair) | _bias_errors(pair)


def _frame_rpe(pair: Association) -> dict[str, float]:
    """Over estimates that follow each other, as evo's default; a hole in the truth is not spanned."""
    first = np.flatnonzero(np.diff(pair.index) == 1)
    if len(first) == 0:
        return {}
    angles, distances = relative_errors(pair, first, first + 1)
    return {"rpe_rad": _rms(angles), "rpe_m": _rms(distances)}


def _segment_rpe(pair: Association) -> dict[str, float]:
    result = {}
    for length in SEGMENT_LENGTHS_M:
        first, last = segments(pair.truth, length)
        if len(first):
            angles, distances = relative_errors(pair, first, last)
            result[f"rpe_{length:.0f}m_deg"] = float(np.degrees(np.median(angles)))
            result[f"rpe_{length:.0f}m_m"] = float(np.median(distances))
    return result


def _bias_errors(pair: Association) -> dict[str, float]:
    result: dict[str, float] = {}
    for name in ("b_g", "b_a"):
        estimate, truth = getattr(pair.estimate, name), getattr(pair.truth, name)
        if estimate is None or truth is None:
            continue
        norms = np.linalg.norm(estimate - truth, axis=1)
        norms = norms[np.isfinite(norms)]
        if len(norms):
            result |= {f"{name}_rmse": _rms(norms), f"{name}_end": float(norms[-1])}
    return result


def _motion(path: Trajectory, first: Stamps, last: Stamps) -> tuple[Rotations, Vectors]:
    """Rotations and translations of the motions between poses, in the frame of the first."""
    R_WB = path.R_WB
    R_WB_first_T = np.swapaxes(R_WB[first], 1, 2)
    shift = path.p_WB[last] - path.p_WB[first]
    return R_WB_first_T @ R_WB[last], (R_WB_first_T @ shift[..., None])[..., 0]


def _angles(R: Rotations) -> Floats:
    angles: Floats = np.linalg.norm(so3.log(R), axis=-1)
    return angles


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))

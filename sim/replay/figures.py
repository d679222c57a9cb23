"""How well a replay's path agrees with the real IMU and with the truth that it came from."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from navcore import so3
from navcore.arrays import Floats, Stamps, Vectors
from navcore.sequence import Sequence
from sim.replay import increments
from sim.replay.chain import THETA, V
from sim.replay.knots import g_W, second_integral, turned
from sim.replay.smoothed import SmoothedTruth

RECKONING_S = 5.0
"""How long dead reckoning lasts that is compared with the path."""

_SLOW_S = 1.0  # of the means in which noise no longer hides a wrong path
_OUTLIER = 0.25  # robust weight below which a pose is not believed


@dataclass(frozen=True)
class Figures:
    """Figures of a smoothed truth.

    Attributes:
        turn_offset_s, shift_offset_s: time offsets of truth's attitude and position.
        tilt_rad, turn_rad: of truth's world against gravity, of its body against the IMU.
        turn_rms_rad, shift_rms_m: truth against the path, per axis.
        shift_max_m: the largest along an axis.
        outliers: share of positions or attitudes that are not believed.
        bridged_s, left_out_s: longest gap that is bridged, time that is left out.
        sd_max_m: largest standard deviation of the position where it is known.
        frame_px_rms, frame_px_max: turn of camera 0 from frame to frame, bias-corrected gyro against the path.
        gyro_ratio, accelerometer_ratio: rms residual of samples over that of their calibrated white noise.
        force_slow: m/s^2, rms difference of path and accelerometer less bias, in means over a second.
        reckoning_m: m, median distance from the path of what the samples say alone after `RECKONING_S`, begun at
            the path's own states, biases too, every second; None where the path is nowhere known for so long.
    """

    turn_offset_s: float
    shift_offset_s: float
    tilt_rad: float
    turn_rad: float
    turn_rms_rad: float
    shift_rms_m: float
    shift_max_m: float
    outliers: float
    bridged_s: float
    left_out_s: float
    sd_max_m: float
    frame_px_rms: float
    frame_px_max: float
    gyro_ratio: float
    accelerometer_ratio: float
    force_slow: float
    reckoning_m: float | None


def figures(recording: Sequence, path: SmoothedTruth, frames_ns: Stamps) -> Figures:
    """Measure a smoothed truth; `frames_ns` (N,) are stamps of frames, IMU time, at which the path is known."""
    found, noise = path.smoothed, recording.calibration.imu
    m = found.mounting
    gyro, force = _residuals(path)
    px = recording.calibration.cameras[0].camera.focal * _frame_turns(recording, path, frames_ns)
    root = np.sqrt(noise.rate_hz)
    sd = np.sqrt(np.linalg.eigvalsh(found.covariance[:, 3:6, 3:6])[:, -1])
    doubted = (found.attitudes.weights(found.turn_sd) < _OUTLIER) | (found.positions.weights(found.shift_sd) < _OUTLIER)
    spans = [np.diff(x, axis=1).ravel() * 1e-9 for x in (path.bridged_ns, path.left_out_ns)]
    n = round(_SLOW_S * noise.rate_hz)
    slow = force[: len(force) // n * n].reshape(-1, n, 3).mean(axis=1)
    return Figures(
        turn_offset_s=m.turn_offset_s,
        shift_offset_s=m.shift_offset_s,
        tilt_rad=m.tilt_rad,
        turn_rad=m.turn_rad,
        turn_rms_rad=_rms(found.attitudes.r),
        shift_rms_m=_rms(found.positions.r),
        shift_max_m=float(np.abs(found.positions.r).max()),
        outliers=float(doubted.mean()),
        bridged_s=float(spans[0].max(initial=0.0)),
        left_out_s=float(spans[1].sum()),
        sd_max_m=float(sd[path.known(found.intervals.t_ns)].max()),
        frame_px_rms=_rms(px),
        frame_px_max=float(px.max()),
        gyro_ratio=_rms(gyro) / (noise.gyroscope_noise_density * root),
        accelerometer_ratio=_rms(force) / (noise.accelerometer_noise_density * root),
        force_slow=_rms(slow),
        reckoning_m=_reckoning(path),
    )


def _residuals(path: SmoothedTruth) -> tuple[Vectors, Vectors]:
    """(N, 3) rad/s and (N, 3) m/s^2: mean rate and force between knots, less those of the samples."""
    intervals = path.smoothed.intervals
    inside = path.known(intervals.t_ns[:-1]) & path.known(intervals.t_ns[1:])
    r = increments.residuals(path.smoothed.knots, intervals)[inside] / intervals.h[inside, None]
    return r[:, THETA], r[:, V]


def _reckoning(path: SmoothedTruth) -> float | None:
    """See `Figures.reckoning_m`."""
    knots, intervals = path.smoothed.knots, path.smoothed.intervals
    step_s = float(np.median(intervals.h))
    n, every = round(RECKONING_S / step_s), round(1.0 / step_s)
    known = path.known(intervals.t_ns)
    starts = np.array([k for k in range(0, len(intervals.h) - n, every) if known[k : k + n + 1].all()], dtype=np.int64)
    if len(starts) == 0:
        return None
    R, p, v = knots.R_WB[starts], knots.p_WB[starts], knots.v_WB[starts]
    for k in range(n):
        h = intervals.h[starts + k, None]
        phi = (intervals.imu.gyro[starts + k] - knots.b_g[starts]) * h
        force = intervals.imu.accel[starts + k] - knots.b_a[starts]
        p = p + v * h + (turned(R @ second_integral(phi), force) + 0.5 * g_W) * h**2
        v = v + (turned(R @ so3.left_jacobian(phi), force) + g_W) * h
        R = R @ so3.exp(phi)
    return float(np.median(np.linalg.norm(p - knots.p_WB[starts + n], axis=1)))


def _frame_turns(recording: Sequence, path: SmoothedTruth, frames_ns: Stamps) -> Floats:
    """(M,) rad: between neighbouring frames, how far the integrated gyro is from the path's turn."""
    found = path.smoothed
    intervals, imu = found.intervals, found.intervals.imu
    rate = imu.gyro - found.knots.b_g[:-1]
    R = [Rotation.identity()]
    for step in Rotation.from_rotvec(rate * intervals.h[:, None]):
        R.append(R[-1] * step)
    k, tau = intervals.locate(frames_ns)
    by_gyro = Rotation.concatenate(R)[k] * Rotation.from_rotvec(rate[k] * tau[:, None])
    by_path = Rotation.from_matrix(path.motion.at(frames_ns).R_WB)
    apart = (by_gyro[:-1].inv() * by_gyro[1:]).inv() * (by_path[:-1].inv() * by_path[1:])
    near = np.diff(frames_ns) < 2.5 * np.median(np.diff(frames_ns))
    turns: Floats = np.atleast_1d(apart.magnitude())[near]
    return turns


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(x * x)))

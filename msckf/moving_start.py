"""Start in motion: guessed, refined, and accepted if it is known well enough (docs/filter.md, section 6)."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from msckf.blocks import ACCEL_BIAS, GYRO_BIAS, POSITION, VELOCITY
from msckf.config import StartConfig
from msckf.start_guess import closed_form, rotation_bias
from msckf.start_inertia import Path, Window
from msckf.start_refinement import Refined, refine
from navcore import so3
from navcore.arrays import Floats, Vectors
from navcore.imu import ImuNoise
from navcore.odometry import State

_LEAST_FEATURES = 8


@dataclass(frozen=True)
class StartResult:
    """A start, or the reason why there is none.

    Attributes:
        state: at the window's last pose, which is the origin and has yaw 0; or None.
        reason: empty if there is a state.
        b_g: (3,) rad/s, what the window says of the gyro's bias, if it says something: a guess for the next one.
        rough: the same as `state`, of a window that fits but tells too little.
    """

    state: State | None
    reason: str = ""
    b_g: Vectors | None = None
    rough: State | None = None


def moving_start(
    window: Window, config: StartConfig, pixel_noise: float, earlier: Vectors | None = None
) -> StartResult:
    """Find the state at the end of a window of a moving rig.

    Args:
        window: what was seen and measured; its noise is the calibration's.
        config: what is accepted.
        pixel_noise: px.
        earlier: (3,) rad/s, what an earlier window said of the gyro's bias.
    """
    if window.views.seen[:, -len(window.views.rig) :].any(axis=1).sum() < _LEAST_FEATURES:
        return StartResult(None, "too few features are followed")
    window = replace(window, noise=in_motion(window.noise, config))
    refined: Refined | str = ""
    for guess in _guesses(window, earlier):
        refined = _from(window, guess, pixel_noise)
        if isinstance(refined, Refined) and _fits(refined, config):
            break
    if isinstance(refined, str):
        return StartResult(None, refined)
    if not _fits(refined, config):
        return StartResult(
            None, f"features and IMU disagree: cost {refined.cost / refined.dof:.1f} per degree of freedom"
        )
    state, reason = _last_state(refined, window), _objection(refined, window, config)
    return StartResult(None, reason, refined.path.b_g, state) if reason else StartResult(state, b_g=refined.path.b_g)


def _guesses(window: Window, earlier: Vectors | None) -> Iterator[Vectors]:
    """Gyro biases to begin with, one after the other if those before lead nowhere."""
    if earlier is not None:
        yield earlier
    yield rotation_bias(window.views, window.increments, window.device)


def in_motion(noise: ImuNoise, config: StartConfig) -> ImuNoise:
    """The white noise that stands for all that an IMU says wrongly over the seconds of a window."""
    return replace(
        noise,
        gyroscope_noise_density=config.gyro_noise * noise.gyroscope_noise_density,
        accelerometer_noise_density=config.accel_noise * noise.accelerometer_noise_density,
    )


def _from(window: Window, b_g: Vectors, pixel_noise: float) -> Refined | str:
    """Refined from a gyro bias and what follows from it."""
    b_a = window.device.b_a
    increments = window.increments_at(b_g, b_a)
    guess = closed_form(window.views, increments)
    if guess is None:
        return "motion does not determine velocity and gravity"
    return refine(window, Path.of(increments, *guess, b_g, b_a), pixel_noise)


def _fits(refined: Refined, config: StartConfig) -> bool:
    """Whether features and IMU agree with each other."""
    return refined.cost < config.max_cost * refined.dof and bool(np.isfinite(refined.covariance).all())


def _objection(refined: Refined, window: Window, config: StartConfig) -> str:
    """Why a window that fits is not accepted; empty if it is."""
    P, K = refined.covariance, len(refined.path.R)
    last = 9 * (K - 1)
    velocity = last + np.arange(9)[VELOCITY]
    R_WB, P_tilt = refined.path.R[-1], P[last : last + 3, last : last + 3]
    velocity_sigma = float(np.sqrt(np.linalg.eigvalsh(P[np.ix_(velocity, velocity)])[-1]))
    tilt_sigma = float(np.sqrt(np.linalg.eigvalsh((R_WB @ P_tilt @ R_WB.T)[:2, :2])[-1]))
    scale = scale_sigma(refined)
    in_haste = window.seconds >= config.patience_s
    slack = 2.0 if in_haste else 1.0
    known = velocity_sigma < slack * config.max_velocity_sigma and tilt_sigma < slack * config.max_tilt_sigma
    if not known:
        return f"velocity known to {velocity_sigma:.2f} m/s, tilt to {tilt_sigma:.3f} rad only"
    if scale > config.max_scale_sigma and not in_haste:
        return f"scale known to {scale:.0%} only"
    return ""


def scale_sigma(refined: Refined) -> float:
    """Standard deviation of the size of the window's path, by that size: of sum(q dp) / sum(q q), q about the mean."""
    p = refined.path.p
    q = p - p.mean(axis=0)
    weight = q.ravel() / max(float(np.sum(q * q)), 1e-12)
    rows = (9 * np.arange(len(p))[:, None] + np.arange(9)[POSITION]).ravel()
    return float(np.sqrt(weight @ refined.covariance[np.ix_(rows, rows)] @ weight))


def _last_state(refined: Refined, window: Window) -> State:
    """The state at the last pose, in a world in which it has position and yaw 0, with its covariance."""
    path, K = refined.path, len(refined.path.R)
    R_WB = path.R[-1]
    turn = so3.exp(np.array([0.0, 0.0, -np.arctan2(R_WB[1, 0], R_WB[0, 0])]))
    rows = np.r_[9 * (K - 1) : 9 * K, 9 * K : 9 * K + 6]
    T = np.eye(15)
    T[POSITION, POSITION] = T[VELOCITY, VELOCITY] = turn
    P: Floats = T @ refined.covariance[np.ix_(rows, rows)] @ T.T
    noise = window.noise  # the window's biases are constant: what they walk from its mean to its end comes on top
    P[GYRO_BIAS, GYRO_BIAS] += np.eye(3) * noise.gyroscope_random_walk**2 * window.seconds / 3.0
    P[ACCEL_BIAS, ACCEL_BIAS] += np.eye(3) * noise.accelerometer_random_walk**2 * window.seconds / 3.0
    return State(turn @ R_WB, np.zeros(3), turn @ path.v[-1], path.b_g, path.b_a, 0.5 * (P + P.T))

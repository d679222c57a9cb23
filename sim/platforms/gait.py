"""How the hand of somebody who walks moves: steps, heel strikes, looking around, tremor."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.signal import butter, fftconvolve, sosfilt

from navcore.arrays import Floats, Vectors

_STEP_HZ, _AT_SPEED = 1.8, 1.2  # steps a second at m/s; longer and faster steps make a walker faster
_SLOWEST_HZ = 1.1
_BOB, _SURGE, _SWAY = 0.012, 0.006, 0.024  # m, half the travel at that speed; sway goes with every second step
_NOD, _ROLL, _WAG = 0.012, 0.010, 0.015  # rad, likewise, of pitch, roll and yaw
_STRIKE_S = 0.012  # of the blow of a heel
_STRIKE = np.array([-0.0008, 0.0, -0.0014])  # m that it shifts the hand back and down at that speed
_TREMOR_HZ = (8.0, 12.0)
_WANDER_S, _WANDER = 0.8, 0.008  # s between drawn places of the hand, m


@dataclass(frozen=True)
class Holding:
    """How the rig is held and turned."""

    look: tuple[float, float, float]  # rad, sd of roll, pitch and yaw of looking around
    look_s: float  # s between the directions that are looked at
    tremor: float  # m/s^2, rms per axis
    vigour: float = 1.0  # of the steps


@dataclass(frozen=True)
class Hand:
    """Where the hand is beside the walker: (N, 3) m ahead, left, up, and (N, 3) rad roll, pitch, yaw."""

    offset: Vectors
    angles: Vectors


def hand_of(speed: Floats, dt_s: float, holding: Holding, rng: np.random.Generator) -> Hand:
    """The hand of somebody who goes at `speed` (N,) m/s, every `dt_s`."""
    n = len(speed)
    going = speed / _AT_SPEED
    rate_hz = np.maximum(_STEP_HZ * np.sqrt(np.clip(going, 0.0, None)), _SLOWEST_HZ)
    phase = 2.0 * np.pi * (rng.random() + np.cumsum(rate_hz) * dt_s)
    size = holding.vigour * going
    stride = 0.5 * phase
    offset = np.stack([_SURGE * np.sin(phase), _SWAY * np.sin(stride), -_BOB * np.cos(phase)], axis=1)
    angles = np.stack([_ROLL * np.sin(stride), _NOD * np.cos(phase), _WAG * np.cos(stride)], axis=1)
    offset = size[:, None] * offset + _strikes(phase, size, dt_s) + _WANDER * _wandering(n, dt_s, _WANDER_S, rng)
    angles = size[:, None] * angles + np.array(holding.look) * _wandering(n, dt_s, holding.look_s, rng)
    shift, turn = _tremor(n, dt_s, holding.tremor, rng)
    return Hand(offset + shift, angles + turn)


def _strikes(phase: Floats, size: Floats, dt_s: float) -> Vectors:
    """(N, 3) m: a short push at every step, with two continuous derivatives."""
    blows = np.diff(np.floor(phase / (2.0 * np.pi)), prepend=np.floor(phase[0] / (2.0 * np.pi))) * size
    t = np.arange(0.0, 20.0 * _STRIKE_S, dt_s) / _STRIKE_S
    pulse = (t / 3.0) ** 3 * np.exp(3.0 - t)  # its peak is 1
    pushed = fftconvolve(blows, pulse)[: len(phase)]
    shift: Vectors = pushed[:, None] * _STRIKE
    return shift


def _wandering(n: int, dt_s: float, every_s: float, rng: np.random.Generator) -> Vectors:
    """(n, 3): quintic B-splines with coefficients drawn anew for each `every_s`, scaled to sd 1."""
    count = int(n * dt_s / every_s) + 8
    knots = (np.arange(count + 6) - 5.0) * every_s
    # The squares of a quintic B-spline's weights sum to .419, seen over all times.
    spline = BSpline(knots, rng.standard_normal((count, 3)) / np.sqrt(0.419), 5)
    out: Vectors = spline(np.arange(n) * dt_s)
    return out


def _tremor(n: int, dt_s: float, rms: float, rng: np.random.Generator) -> tuple[Vectors, Vectors]:
    """(n, 3) m and (n, 3) rad whose accelerations lie between 8 and 12 Hz; the wrist turns as a point .1 m off does."""
    band = butter(2, _TREMOR_HZ, "bandpass", fs=1.0 / dt_s, output="sos")
    noise: Floats = sosfilt(band, rng.standard_normal((n, 6)), axis=0)
    middle = 2.0 * np.pi * np.sqrt(_TREMOR_HZ[0] * _TREMOR_HZ[1])
    width_hz = 1.11 * (_TREMOR_HZ[1] - _TREMOR_HZ[0])  # noise bandwidth of a second-order Butterworth band
    noise *= rms / middle**2 / np.sqrt(2.0 * width_hz * dt_s)
    shift, turn = np.hsplit(noise, 2)
    return shift, turn / 0.1

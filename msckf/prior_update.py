"""The bias prior as a pseudo-measurement (docs/filter.md, section 7)."""

from dataclasses import dataclass

import numpy as np

from msckf.blocks import BIASES
from msckf.config import PriorConfig, StartConfig
from msckf.recovery import Learned
from msckf.state import FilterState
from navcore.arrays import Floats
from navcore.chi_square import chi_square_quantile
from navcore.imu import ImuNoise, ImuSamples
from navcore.prior import BiasPrior, BiasPriorSource, Paced, PriorState


@dataclass(frozen=True)
class StartingBias:
    """What is known of the biases and of the prior's error when the filter starts.

    Attributes:
        device: mean and covariance of the biases.
        c: (6,) the prior's error; gain: (6, 6) how it follows the biases; conditional: (6, 6) its rest;
            None where `c` is not estimated.
    """

    device: BiasPrior
    c: Floats | None = None
    gain: Floats | None = None
    conditional: Floats | None = None


class PriorUpdate:
    """Feeds the measurements of one source to the filter.

    Model: z = b + c + e (DESIGN of the modelled mode): `c` is a state, constant over the run; `e` is white at one
    measurement per window, since overlapping windows share it. The plain mode is the paper's factor (Yi et al., eqs. 5
    and 6): residual W (b - b_hat), every measurement taken, nothing known of its error.
    """

    def __init__(self, source: BiasPriorSource, config: PriorConfig, noise: ImuNoise) -> None:
        self.source = source
        self.config = config
        self._noise = noise
        self._paced = Paced(source, thinned=config.mode == "modelled")
        self._surprises = 0
        self._before_start: list[BiasPrior] = []
        self.nis: float | None = None  # of this frame's last measurement, before weighting
        self._last_nis: float | None = None
        self.applied = 0

    @property
    def models_error(self) -> bool:
        """Whether `c` is estimated."""
        return self.config.mode == "modelled" and bool(np.any(np.diagonal(self.source.constant_covariance) > 0.0))

    def add_imu(self, samples: ImuSamples) -> None:
        """Take samples, in time order; the source gets them when the filter is there."""
        self._paced.add_imu(samples)

    def starting_bias(self, config: StartConfig, t_ns: int, learned: Learned | None = None) -> StartingBias:
        """Device knowledge, or what was learned before a loss, joined by Bayes' rule with the measurements since."""
        sigma = np.repeat([config.gyro_bias_sigma, config.accel_bias_sigma], 3)
        wide = BiasPrior(t_ns, np.zeros(3), np.zeros(3), np.diag(sigma**2))
        device = self.source.device() or wide
        self._before_start += self._paced.said(t_ns)
        constant = self.source.constant_covariance if self.models_error else np.zeros((6, 6))
        mean = np.concatenate([device.vector, np.zeros(6)])
        b, c = slice(0, 6), slice(6, 12)  # biases, and the error of the prior
        P = np.zeros((12, 12))
        P[b, b], P[c, c] = device.covariance, constant
        H = np.hstack([np.eye(6), np.eye(6) if self.models_error else np.zeros((6, 6))])
        at_ns = self._before_start[0].t_ns if self._before_start else t_ns
        if learned is not None:
            mean, P, at_ns = learned.mean, learned.covariance.copy(), learned.t_ns
        for z in self._before_start:
            P[b, b] += self._walked(z.t_ns - at_ns)
            at_ns = z.t_ns
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + self._noise_of(z))
            mean = mean + K @ (z.vector - H @ mean)
            P = P - K @ H @ P
            P = 0.5 * (P + P.T)
        P[b, b] += self._walked(t_ns - at_ns)
        b_g, b_a = np.split(mean[b], 2)
        fused = BiasPrior(t_ns, b_g, b_a, P[b, b])
        if not self.models_error:
            return StartingBias(fused)
        gain = np.asarray(np.linalg.solve(P[b, b], P[b, c]).T, dtype=np.float64)
        conditional = P[c, c] - gain @ P[b, c]
        return StartingBias(fused, mean[c], gain, 0.5 * (conditional + conditional.T))

    def begin(self, state: FilterState, start: StartingBias) -> None:
        """Add `c` to a state that has just started from `start`."""
        self._before_start = []
        if start.c is None or start.gain is None or start.conditional is None:
            return
        mean = start.c + start.gain @ (state.biases - start.device.vector)
        state.add_prior_error(mean, start.gain, start.conditional)

    def update(self, state: FilterState, t_ns: int) -> tuple[str, ...]:
        """Apply what the source has to say by IMU time `t_ns`; returns findings for `Health`."""
        findings: tuple[str, ...] = ()
        self.nis = None
        for z in self._paced.said(t_ns):
            self.applied += 1
            if self.config.mode == "plain":
                self._plain(state, z)
            elif not self._modelled(state, z, t_ns):
                self._surprises += 1
                if self._surprises >= self.config.surprises:
                    innovation = z.vector - state.biases - (0.0 if state.c is None else state.c)
                    state.widen_biases(np.diag(innovation**2))
                    self._surprises = 0
                    findings = ("bias prior and filter disagree",)
            else:
                self._surprises = 0
            self._last_nis = self.nis
        return findings

    def known(self, state: FilterState | None) -> PriorState:
        """What is known of the source by now."""
        if state is None or state.c is None:
            return PriorState(self.applied, self._last_nis, latest=self._paced.latest)
        covariance = state.covariance[state.prior_error, state.prior_error]
        with_biases = state.covariance[state.prior_error, BIASES]
        c, latest = state.c.copy(), self._paced.latest
        return PriorState(self.applied, self._last_nis, c, covariance.copy(), with_biases.copy(), latest)

    def _noise_of(self, z: BiasPrior) -> Floats:
        """(6, 6): the measurement's own; a fixed one in the plain mode."""
        return np.eye(6) / self.config.weight**2 if self.config.mode == "plain" else z.covariance

    def _walked(self, age_ns: int) -> Floats:
        """(6, 6) covariance of what the biases walk in a time; the plain mode knows of no walk."""
        if self.config.mode == "plain":
            return np.zeros((6, 6))
        walk = np.repeat([self._noise.gyroscope_random_walk, self._noise.accelerometer_random_walk], 3)
        return np.diag(walk**2 * max(age_ns, 0) * 1e-9)

    def _plain(self, state: FilterState, z: BiasPrior) -> None:
        R = self._noise_of(z)
        r = z.vector - state.biases
        S = state.covariance[BIASES, BIASES] + R
        self.nis = float(r @ np.linalg.solve(S, r))
        state.update(np.eye(6), np.r_[BIASES], r, R)

    def _modelled(self, state: FilterState, z: BiasPrior, t_ns: int) -> bool:
        """Update with a Student-t weight; False if the innovation is a surprise."""
        H, R_walk = retrodiction(state.covariance[BIASES, BIASES], self._walked(t_ns - z.t_ns))
        columns, r, R = np.r_[BIASES], z.vector - state.biases, self._noise_of(z) + R_walk
        if state.c is not None:
            columns, H, r = np.r_[BIASES, state.prior_error], np.hstack([H, np.eye(6)]), r - state.c
        S = H @ state.covariance[np.ix_(columns, columns)] @ H.T + R
        self.nis = float(r @ np.linalg.solve(S, r))
        surprise = self.nis > chi_square_quantile(self.config.surprise_probability, 6)
        # Expected precision of a Student-t innovation: (dof + 6) / (dof + nis), never more than the Gaussian's.
        weight = min((self.config.student_dof + 6.0) / (self.config.student_dof + self.nis), 1.0)
        state.update(H, columns, r, R + (1.0 / weight - 1.0) * S)
        return not surprise


def retrodiction(P: Floats, W: Floats) -> tuple[Floats, Floats]:
    """How the biases of a while ago depend on those of now, whose error has the walk since then in it.

    For a measurement out of sequence (docs/filter.md, equation 62). Of error and walk along a direction, the smaller
    one is taken to be a part of the other.

    Args:
        P: (6, 6) covariance of the biases now.
        W: (6, 6) of their walk since then, diagonal.

    Returns:
        (6, 6) derivative of the biases then by those now, and (6, 6) covariance of the rest.
    """
    scale = np.sqrt(np.maximum(np.diagonal(W), 1e-24))
    ratio, U = np.linalg.eigh(P / np.outer(scale, scale))
    ratio = np.maximum(ratio, 1e-12)
    shared = np.minimum(ratio, 1.0)  # covariance of error and walk, in units of W
    H = np.eye(6) - scale[:, None] * (U * (shared / ratio)) @ U.T / scale
    rest = scale[:, None] * (U * (1.0 - shared**2 / ratio)) @ U.T * scale
    return H, 0.5 * (rest + rest.T)

"""The bias prior as factors: the paper's, and the one that knows that the prior errs (DESIGN of the modelled mode)."""

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, C

from factor.border import bias_of, swapped
from factor.config import PriorConfig
from navcore.arrays import Floats
from navcore.imu import ImuNoise
from navcore.prior import BiasPrior

_ERROR = C(0)
"""Key of the constant error. The variable is -c, so that z = b + c is GTSAM's factor of a difference, b - (-c)."""


@dataclass(frozen=True)
class PriorError:
    """The prior's constant error at the start, in the order b_g, b_a.

    Attributes:
        mean: (6,) of c.
        gain: (6, 6) how it follows the biases there: c - mean = gain (b - b_hat) + rest.
        rest: (6, 6) covariance of that.
    """

    mean: Floats
    gain: Floats
    rest: Floats


def paper_factor(k: int, b_hat: BiasPrior, weight: float) -> gtsam.PriorFactorConstantBias:
    """Residual W [b_a - b_a_hat; b_g - b_g_hat], Jacobian W I, on keyframe `k` (Yi et al., eqs. 5 and 6)."""
    return gtsam.PriorFactorConstantBias(
        B(k), bias_of(b_hat.b_g, b_hat.b_a), gtsam.noiseModel.Isotropic.Sigma(6, 1.0 / weight)
    )


def modelled_factor(k: int, z: BiasPrior, covariance: Floats) -> gtsam.BetweenFactorConstantBias:
    """z = b_k + c + e, with the (6, 6) covariance of e in the order b_g, b_a."""
    noise = gtsam.noiseModel.Gaussian.Covariance(swapped(covariance))
    return gtsam.BetweenFactorConstantBias(_ERROR, B(k), bias_of(z.b_g, z.b_a), noise)


class BiasFactors:
    """The factors that a prior has put into the window."""

    def __init__(
        self, config: PriorConfig, noise: ImuNoise, error: PriorError | None, latest: BiasPrior | None = None
    ) -> None:
        self._config = config
        self._walk = np.repeat([noise.gyroscope_random_walk, noise.accelerometer_random_walk], 3) ** 2  # by second
        self._error = error
        self._factors: dict[int, list[gtsam.NonlinearFactor]] = {}
        self._latest = latest
        self._covariance = np.zeros((6, 6))  # of the newest bias, or of it and -c; GTSAM's order

    @property
    def keys(self) -> list[int]:
        """Of the prior's error, if that is estimated."""
        return [] if self._error is None else [_ERROR]

    def begin(self, values: gtsam.Values, graph: gtsam.NonlinearFactorGraph, P: Floats) -> None:
        """Put the prior's error in, with what is known of it at the first keyframe.

        Args:
            values: those of the first keyframe; the error comes into them.
            graph: gets the factor.
            P: (6, 6) covariance of the biases there, in the order b_g, b_a.
        """
        self._covariance = swapped(P)
        if self._error is None:
            return
        values.insert(_ERROR, bias_of(*np.split(-self._error.mean, 2)))
        gain, rest = swapped(self._error.gain), swapped(self._error.rest)
        L_inverse = np.linalg.inv(np.linalg.cholesky(rest))
        by_bias = L_inverse @ gain  # of -(c - mean) - (-gain (b - b_hat))
        factor = gtsam.JacobianFactor(_ERROR, L_inverse, B(0), by_bias, np.zeros(6), gtsam.noiseModel.Unit.Create(6))
        graph.push_back(gtsam.LinearContainerFactor(factor, values))
        both = gain @ self._covariance
        whole = rest + both @ gain.T
        self._covariance = np.block([[self._covariance, -both.T], [-both, whole]])

    def hear(self, said: list[BiasPrior], k: int, values: gtsam.Values, t_ns: int) -> None:
        """Take what a source has said by now; the newest keyframe is `k`."""
        for z in said:
            self._latest = z
            if self._config.mode == "modelled":
                self._factors.setdefault(k, []).append(self._weighed(z, k, values, t_ns))

    def keyframe(self, k: int) -> None:
        """In the paper's mode every keyframe gets what was said last."""
        if self._config.mode == "plain" and self._latest is not None:
            self._factors[k] = [paper_factor(k, self._latest, self._config.weight)]

    def integrated_at(self, estimate: gtsam.imuBias.ConstantBias) -> gtsam.imuBias.ConstantBias:
        """The bias at which the samples after a keyframe are integrated."""
        if self._config.preintegration == "estimate" or self._latest is None:
            return estimate
        return bias_of(self._latest.b_g, self._latest.b_a)

    def graph(self) -> gtsam.NonlinearFactorGraph:
        """All of them."""
        graph = gtsam.NonlinearFactorGraph()
        for factors in self._factors.values():
            for factor in factors:
                graph.push_back(factor)
        return graph

    def leave(self, k: int) -> gtsam.NonlinearFactorGraph:
        """Those of keyframe `k`, which are here no longer."""
        graph = gtsam.NonlinearFactorGraph()
        for factor in self._factors.pop(k, []):
            graph.push_back(factor)
        return graph

    def known(self, covariance: Floats) -> None:
        """The covariance (15, 15) or (21, 21) of the newest state and the prior's error, in GTSAM's order."""
        self._covariance = covariance[9:, 9:]

    def _weighed(self, z: BiasPrior, k: int, values: gtsam.Values, t_ns: int) -> gtsam.NonlinearFactor:
        """A measurement with a Student-t weight by how surprising it is, as in the filter.

        It speaks of a time that has passed: the biases have walked since.
        """
        R = z.covariance + np.diag(self._walk) * max(t_ns - z.t_ns, 0) * 1e-9
        r = swapped(z.vector) - values.atConstantBias(B(k)).vector()
        H = np.eye(6)
        if self._error is not None:
            r += values.atConstantBias(_ERROR).vector()
            H = np.hstack([H, -H])
        S = swapped(R) + H @ self._covariance @ H.T
        nis = float(r @ np.linalg.solve(S, r))
        dof = self._config.student_dof
        weight = min((dof + 6.0) / (dof + nis), 1.0)
        covariance = R + (1.0 / weight - 1.0) * swapped(S)
        if self._error is None:
            noise = gtsam.noiseModel.Gaussian.Covariance(swapped(covariance))
            return gtsam.PriorFactorConstantBias(B(k), bias_of(z.b_g, z.b_a), noise)
        return modelled_factor(k, z, covariance)

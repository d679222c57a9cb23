"""What an IMU says of successive intervals, and how it hangs together with velocity and gravity in the body's frame.

Everything is in B, so heading and position never enter. With g_B gravity in B and v_B velocity in B at an interval's
start, T its length, and (delta_R, delta_v) its preintegrated increment:

    g_B' = delta_R^T g_B        v_B' = delta_R^T (v_B + g_B T + delta_v)
    p_B' = delta_R^T (p_B + v_B T + g_B T^2 / 2 + delta_p)

where p_B is the place, from the middle of where the platform moves, in B. Means over the interval are linear in
(g_B, v_B) too (`Increments.mean_RT` and so on).
"""

from dataclasses import dataclass, replace

import numpy as np

from ipnet.preintegration import Increments, preintegrate
from ipnet.windows import means
from navcore import so3
from navcore.arrays import Floats, Mask, Stamps, Vectors
from navcore.imu import GRAVITY, ImuNoise, ImuSamples

FEATURES = 15
"""Mean over an interval of: specific force (3), velocity in B (3), up in B (3), rate (3); m/s^2, m/s, 1, rad/s; and the
place at its start (3), m in B."""
FORCE, SPEED, UP, RATE, PLACE = (slice(k, k + 3) for k in range(0, FEATURES, 3))
NODE = 15
"""Unknowns at the start of an interval: g_B, v_B, p_B, b_g, b_a."""
GRAV, VELO, POSI, BIAS = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 15)
GYRO_BIAS, ACCEL_BIAS = slice(9, 12), slice(12, 15)
TURNS = 9
"""Means of w_x^2, w_y^2, w_z^2, w_x w_y, w_x w_z, w_y w_z, and the angular acceleration (3): what a lever arm adds."""
FAR = np.repeat([2e-3, 0.2], 3)
"""rad/s, m/s^2: over half a second the turn is off by 1e-3, and what is of second order in it by 1e-6."""
_TINY = 1e-8  # added to variances of gravity, velocity, place: (1e-4)^2 in their units
_STILL = 1.4  # times the noise: what samples of a body at rest may scatter
_QUIET_RUN = 4  # intervals in a row: a hand that turns back is quiet for one
_TURN = 0.2  # rad/s: a mean rate above that is a steady turn, whatever the scatter; no gyroscope is biased so much
_FLOOR_G, _FLOOR_A = 1e-3, 1e-2  # rad/s, m/s^2: beside the density, for devices whose step is coarse


@dataclass(frozen=True)
class Intervals:
    """N successive intervals at given biases.

    Attributes:
        bias: (N, 6) b_g, b_a, taken off.
        increments: preintegrated.
        force, rate: (N, 3) means.
        turns: (N, 9), see `TURNS`.
        still: (N,) whether nothing but noise is in the samples.
        shake: (N,) log10 of the rms of second differences of the accelerometer [m/s^2]: rotors that turn, say.
    """

    bias: Floats
    increments: Increments
    force: Vectors
    rate: Vectors
    turns: Floats
    still: Mask
    shake: Floats

    @staticmethod
    def of(samples: ImuSamples, edges_ns: Stamps, b_g: Vectors, b_a: Vectors, noise: ImuNoise) -> "Intervals":
        """Between N + 1 edges; biases (3,) or (N, 3) are taken off."""
        bias = np.broadcast_to(np.concatenate(np.broadcast_arrays(b_g, b_a), axis=-1), (len(edges_ns) - 1, 6))
        increments = preintegrate(samples, edges_ns, b_g, b_a, noise)
        mean = means(samples, edges_ns)
        omega = samples.gyro - np.mean(np.atleast_2d(b_g), axis=0)
        squares = means(ImuSamples(samples.t_ns, omega**2, omega[:, [0, 0, 1]] * omega[:, [1, 2, 2]]), edges_ns)
        at_edges = np.stack([np.interp(edges_ns, samples.t_ns, omega[:, k]) for k in range(3)], axis=1)
        turns = np.hstack([squares, np.diff(at_edges, axis=0) / increments.dt[:, None]])
        force, rate = mean[:, 3:] - b_a, mean[:, :3] - b_g
        still, shake = _still(samples, edges_ns, noise), _shake(samples, edges_ns)
        return Intervals(bias, increments, force, rate, turns, still, shake)

    def at(self, bias: Floats) -> "Intervals":
        """At biases (N, 6) that differ little, to first order: see `FAR`."""
        d = bias - self.bias
        inc = self.increments
        moved = np.matvec(inc.J, d)
        corrected = replace(
            inc,
            delta_R=inc.delta_R @ so3.exp(moved[:, 0:3]),
            delta_v=inc.delta_v + moved[:, 3:6],
            delta_p=inc.delta_p + moved[:, 6:9],
            mean_RTv=inc.mean_RTv - 0.5 * inc.dt[:, None] * d[:, 3:6],
        )
        return replace(self, bias=bias, increments=corrected, force=self.force - d[:, 3:6], rate=self.rate - d[:, 0:3])

    def far(self, bias: Floats) -> bool:
        """Whether biases differ too much for `at`."""
        return bool((np.abs(bias - self.bias) > FAR).any())

    def __len__(self) -> int:
        return len(self.force)

    def features(self, nodes: Floats) -> Floats:
        """(N, 15) `FEATURES` from the nodes (N, 15) at the starts."""
        inc = self.increments
        g_B, v_B = nodes[:, GRAV], nodes[:, VELO]
        speed = np.matvec(inc.mean_RT, v_B) + np.matvec(inc.mean_tRT, g_B) + inc.mean_RTv
        up = -np.matvec(inc.mean_RT, g_B) / GRAVITY
        return np.hstack([self.force, speed, up, self.rate, nodes[:, POSI]])

    def feature_jacobian(self) -> Floats:
        """(N, 15, 15): derivative of `features` by the nodes.

        That of the means of rotation by b_g, about half an interval times velocity, is left out: it is small beside
        what a window of many intervals says of b_g.
        """
        inc = self.increments
        L = np.zeros((len(self), FEATURES, NODE))
        L[:, FORCE, ACCEL_BIAS] = -np.eye(3)
        L[:, SPEED, GRAV], L[:, SPEED, VELO] = inc.mean_tRT, inc.mean_RT
        L[:, SPEED, ACCEL_BIAS] = -0.5 * inc.dt[:, None, None] * np.eye(3)
        L[:, UP, GRAV] = -inc.mean_RT / GRAVITY
        L[:, RATE, GYRO_BIAS] = -np.eye(3)
        L[:, PLACE, POSI] = np.eye(3)
        return L

    def following(self, nodes: Floats) -> tuple[Floats, Floats]:
        """(N, 15) the nodes at the ends, from those (N, 15) at the starts, and (N, 15, 15) the derivative."""
        inc = self.increments
        RT = np.swapaxes(inc.delta_R, 1, 2)
        T = inc.dt[:, None]
        g_B, v_B, p_B = nodes[:, GRAV], nodes[:, VELO], nodes[:, POSI]
        g = np.matvec(RT, g_B)
        v = np.matvec(RT, v_B + g_B * T + inc.delta_v)
        p = np.matvec(RT, p_B + v_B * T + 0.5 * g_B * T * T + inc.delta_p)
        # With delta_R Exp(e): (delta_R Exp(e))^T x = RT x + hat(RT x) e.
        J = np.zeros((len(self), NODE, NODE))
        for row, moved, own in ((GRAV, g, None), (VELO, v, slice(3, 6)), (POSI, p, slice(6, 9))):
            J[:, row, GYRO_BIAS] = so3.hat(moved) @ inc.J[:, 0:3, 0:3]
            if own is not None:
                J[:, row, BIAS] += RT @ inc.J[:, own]
        J[:, GRAV, GRAV] = J[:, VELO, VELO] = J[:, POSI, POSI] = RT
        J[:, VELO, GRAV] = J[:, POSI, VELO] = RT * T[..., None]
        J[:, POSI, GRAV] = 0.5 * RT * (T * T)[..., None]
        J[:, BIAS, BIAS] = np.eye(6)
        return np.hstack([g, v, p, nodes[:, BIAS]]), J

    def noise(self, ends: Floats, walk: Floats) -> Floats:
        """(N, 15, 15) covariance of the nodes at the ends (N, 15), biases walking with (6,) sd a root of a second."""
        inc = self.increments
        RT = np.swapaxes(inc.delta_R, 1, 2)
        M = np.zeros((len(self), 9, 9))
        M[:, 0:3, 0:3] = so3.hat(ends[:, GRAV])
        M[:, 3:6, 0:3] = so3.hat(ends[:, VELO])
        M[:, 6:9, 0:3] = so3.hat(ends[:, POSI])
        M[:, 3:6, 3:6] = M[:, 6:9, 6:9] = RT
        Q = np.zeros((len(self), NODE, NODE))
        Q[:, 0:9, 0:9] = M @ inc.Q @ np.swapaxes(M, 1, 2)
        Q[:, range(9), range(9)] += _TINY
        Q[:, range(9, NODE), range(9, NODE)] += walk**2 * inc.dt[:, None]
        return Q


def _still(samples: ImuSamples, edges_ns: Stamps, noise: ImuNoise) -> Mask:
    """(N,): the scatter of gyro and accelerometer about their means is that of their noise, and no steady turn."""
    values = np.hstack([samples.gyro, samples.accel])
    first = np.searchsorted(samples.t_ns, edges_ns[:-1])
    last = np.maximum(np.searchsorted(samples.t_ns, edges_ns[1:]), first + 2)
    total = np.vstack([np.zeros((1, 6)), np.cumsum(values - values.mean(axis=0), axis=0)])
    squares = np.vstack([np.zeros((1, 6)), np.cumsum((values - values.mean(axis=0)) ** 2, axis=0)])
    last = np.minimum(last, len(samples))
    n = np.maximum(last - first, 1)[:, None]
    variance = (squares[last] - squares[first]) / n - ((total[last] - total[first]) / n) ** 2
    white = np.sqrt(noise.rate_hz)
    sigma_g = noise.gyroscope_noise_density * white + _FLOOR_G
    sigma_a = noise.accelerometer_noise_density * white + _FLOOR_A
    limit = _STILL**2 * np.repeat([sigma_g**2, sigma_a**2], 3)
    rate = (total[last] - total[first])[:, :3] / n + values[:, :3].mean(axis=0)
    quiet = (variance < limit).all(axis=1) & (np.linalg.norm(rate, axis=1) < _TURN)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], quiet, [False]]).astype(np.int8)))
    still = np.zeros(len(quiet), dtype=bool)
    for begin, end in edges.reshape(-1, 2):
        still[begin:end] = end - begin >= _QUIET_RUN
    return still


def noise_shake(noise: ImuNoise) -> float:
    """What `shake` is for noise alone."""
    sigma = noise.accelerometer_noise_density * np.sqrt(noise.rate_hz)
    return float(np.log10(np.sqrt(18.0) * sigma + 1e-6))


def _shake(samples: ImuSamples, edges_ns: Stamps) -> Floats:
    squares = np.sum(np.diff(samples.accel, n=2, axis=0) ** 2, axis=1)
    total = np.concatenate([[0.0], np.cumsum(squares)])
    first = np.minimum(np.searchsorted(samples.t_ns, edges_ns[:-1]), len(squares) - 1)
    last = np.clip(np.searchsorted(samples.t_ns, edges_ns[1:]) - 2, first + 1, len(squares))
    mean = (total[last] - total[first]) / (last - first)
    return np.asarray(0.5 * np.log10(mean + 1e-12))

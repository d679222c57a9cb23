"""Biases, gravity, velocity and place over a window, under which raw IMU data obey a motion model (Gauss-Newton)."""

from dataclasses import dataclass

import numpy as np

from ipnet.motion.chain import Chain
from ipnet.motion.intervals import BIAS, FEATURES, FORCE, GRAV, NODE, RATE, SPEED, Intervals
from ipnet.motion.model import EFFECTS, ROWS, MotionModel
from navcore.arrays import Floats, Stamps
from navcore.imu import GRAVITY, ImuNoise, ImuSamples

_ITERATIONS = 20
_PLAIN = 5  # iterations before tails are thought of
_DONE, _ENOUGH = 0.03, 0.3  # of a sigma: biases that move less are found; that still move more are not
_NORM_SIGMA = 0.003  # m/s^2, of |g_B|
_STILL_SIGMAS = np.repeat([0.005, 5e-4], 3)  # m/s, rad/s, of a body at rest, beside the noise
_FAR_AWAY = np.repeat([10.0, 20.0, 100.0], 3)  # m/s^2, m/s, m: nothing is farther
_LEAST_KNOWN = 0.8  # share of a window that must be the platform's own motion, or rest


@dataclass(frozen=True)
class Inferred:
    """What a window tells.

    Attributes:
        mean: (6,) b_g, b_a at the window's end.
        covariance: (6, 6).
        nodes: (N + 1, 15) g_B, v_B, p_B, b_g, b_a along the window.
        iterations: how many it took.
        cost: mean squared innovation of the motion by the model's Q: about dof / (dof - 2) where it is as learned.
    """

    mean: Floats
    covariance: Floats
    nodes: Floats
    iterations: int
    cost: float


@dataclass(frozen=True)
class Smoother:
    """A motion model put to use.

    Attributes:
        model: how the platform moves.
        noise: of the IMU.
        sigma: (6,) rad/s, m/s^2: biases beforehand, as sd about zero.
    """

    model: MotionModel
    noise: ImuNoise
    sigma: Floats

    def infer(self, samples: ImuSamples, edges_ns: Stamps, start: Floats | None = None) -> Inferred | None:
        """Biases in a window cut into intervals of the model's length.

        Args:
            samples: cover the edges.
            edges_ns: (N + 1,) N two or more.
            start: (6,) biases to begin with, where something is known.

        Returns:
            None where nothing can be said: too much of it is not the platform's own motion, or no motion of the
            platform fits.
        """
        starts = self._starts(samples.between(int(edges_ns[0]), int(edges_ns[-1]))) if start is None else [start]
        found = [inferred for s in starts if (inferred := self._infer_from(s, samples, edges_ns)) is not None]
        return min(found, key=lambda inferred: inferred.cost, default=None)

    def _starts(self, samples: ImuSamples) -> list[Floats]:
        """The mean rate, and the same without what is about the usual force: a rover that turns all the time, say.

        From far off a wrong minimum is found; these two are wrong at different times.
        """
        rate, usual = samples.gyro.mean(axis=0), self.model.mean[FORCE]
        across = rate - usual * (usual @ rate) / (usual @ usual)
        return [np.append(rate, np.zeros(3)), np.append(across, np.zeros(3))]

    def _infer_from(self, start: Floats, samples: ImuSamples, edges_ns: Stamps) -> Inferred | None:
        bias = np.tile(start, (len(edges_ns), 1))
        base = Intervals.of(samples, edges_ns, bias[:-1, :3], bias[:-1, 3:], self.noise)
        if np.mean(self.model.applies(base) | (base.still[1:] & base.still[:-1])) < _LEAST_KNOWN:
            return None
        try:
            return self._iterate(samples, edges_ns, base, bias)
        except np.linalg.LinAlgError:
            return None

    def _iterate(self, samples: ImuSamples, edges_ns: Stamps, base: Intervals, bias: Floats) -> Inferred | None:
        nodes, effects = self._first_guess(base, bias), np.zeros(EFFECTS)
        for done in range(1, _ITERATIONS + 1):
            if base.far(nodes[:-1, BIAS]):
                base = Intervals.of(samples, edges_ns, nodes[:-1, 9:12], nodes[:-1, 12:15], self.noise)
            cells = base.at(nodes[:-1, BIAS])
            chain, cost = self._equations(cells, nodes, effects, robust=done > _PLAIN)
            step, border, covariance = chain.solve()
            nodes, effects = nodes + step, effects + border
            variance = np.diag(covariance)
            if not (np.isfinite(nodes).all() and (variance > 0.0).all()):
                return None
            moved = np.abs(step[-1, BIAS]) / np.sqrt(variance[BIAS])
            if done > _PLAIN + 1 and moved.max() < _DONE:
                break
        if moved.max() > _ENOUGH:
            return None
        return Inferred(nodes[-1, BIAS], covariance[BIAS, BIAS], nodes, done, cost)

    def _first_guess(self, cells: Intervals, bias: Floats) -> Floats:
        """(N + 1, 15): gravity opposite to the force, at the usual velocity in the middle."""
        force = np.vstack([cells.force, cells.force[-1:]])
        g_B = -GRAVITY * force / np.linalg.norm(force, axis=1, keepdims=True)
        v_B = np.tile(self.model.mean[SPEED], (len(force), 1))
        return np.hstack([g_B, v_B, np.zeros((len(force), 3)), bias])

    def _equations(self, cells: Intervals, nodes: Floats, effects: Floats, robust: bool) -> tuple[Chain, float]:
        chain = Chain.empty(len(nodes), NODE, EFFECTS)
        self._add_kinematics(chain, cells, nodes)
        cost = self._add_motion(chain, cells, nodes, effects, robust)
        self._add_rest(chain, cells, nodes)
        self._add_beforehand(chain, cells, nodes, effects)
        return chain, cost

    def _add_kinematics(self, chain: Chain, cells: Intervals, nodes: Floats) -> None:
        """Each node follows from the one before, up to the IMU's noise."""
        expected, J = cells.following(nodes[:-1])
        densities = [self.noise.gyroscope_random_walk, self.noise.accelerometer_random_walk]
        walk = np.repeat(np.array(densities) + 1e-7, 3)
        information = np.asarray(np.linalg.inv(cells.noise(expected, walk)), dtype=np.float64)
        r = nodes[1:] - expected
        JT_I = np.swapaxes(J, 1, 2) @ information
        chain.D[1:] += information
        chain.D[:-1] += JT_I @ J
        chain.E -= JT_I
        chain.h[1:] -= np.matvec(information, r)
        chain.h[:-1] += np.matvec(JT_I, r)

    def _add_motion(self, chain: Chain, cells: Intervals, nodes: Floats, effects: Floats, robust: bool) -> float:
        """The platform moves as it was learned; where it does not, that counts less (Student's t)."""
        model = self.model
        u, L = cells.features(nodes[:-1]), cells.feature_jacobian()
        w = model.innovations(u, cells.turns, effects)
        by_next, by_last, K = model.jacobians(u, effects)
        P, N = by_next @ L[1:], by_last @ L[:-1]
        information = np.linalg.inv(model.Q)
        distance = np.sum((w @ information) * w, axis=1)
        weight = (model.dof + ROWS) / (model.dof + distance) if robust else np.ones(len(w))
        moving = model.applies(cells)
        W = np.where(moving, weight, 0.0)[:, None, None] * information
        PT, NT, KT = (np.swapaxes(X, 1, 2) @ W for X in (P, N, K))
        chain.D[1:-1] += PT @ P
        chain.D[:-2] += NT @ N
        chain.E[:-1] += NT @ P
        chain.F[1:-1] += PT @ K
        chain.F[:-2] += NT @ K
        chain.G += (KT @ K).sum(axis=0)
        chain.h[1:-1] -= np.matvec(PT, w)
        chain.h[:-2] -= np.matvec(NT, w)
        chain.k -= np.matvec(KT, w).sum(axis=0)
        return float(np.mean(distance[moving])) / ROWS if moving.any() else 0.0

    def _add_rest(self, chain: Chain, cells: Intervals, nodes: Floats) -> None:
        """At rest there is neither velocity nor rate."""
        rest = np.flatnonzero(cells.still)
        rows = np.r_[SPEED, RATE]
        L = cells.feature_jacobian()[rest][:, rows]
        variance = np.tile(_STILL_SIGMAS**2, (len(rest), 1))
        variance[:, 3:] += self.noise.gyroscope_noise_density**2 / cells.increments.dt[rest, None]
        LT = (np.swapaxes(L, 1, 2) / variance[:, None, :]).astype(np.float64)
        chain.D[rest] += LT @ L
        chain.h[rest] -= np.matvec(LT, cells.features(nodes[:-1])[rest][:, rows])

    def _add_beforehand(self, chain: Chain, cells: Intervals, nodes: Floats, effects: Floats) -> None:
        """What is known before anything is seen: spread of motion, size of gravity, biases, effects."""
        model = self.model
        if model.applies(cells)[0]:
            L = cells.feature_jacobian()[0]
            information = np.linalg.inv(model.spread + 1e-9 * np.eye(FEATURES))
            chain.D[0] += L.T @ information @ L
            chain.h[0] -= L.T @ information @ (cells.features(nodes[:-1])[0] - model.mean)
        g_B = nodes[0, GRAV]
        size = float(np.linalg.norm(g_B))
        J = np.zeros(NODE)
        J[GRAV] = g_B / size
        chain.D[0] += np.outer(J, J) / _NORM_SIGMA**2
        chain.h[0] -= J * (size - GRAVITY) / _NORM_SIGMA**2
        chain.D[0][:9, :9] += np.diag(_FAR_AWAY**-2.0)
        chain.h[0, :9] -= nodes[0, :9] / _FAR_AWAY**2
        chain.D[0][BIAS, BIAS] += np.diag(self.sigma**-2.0)
        chain.h[0, BIAS] -= nodes[0, BIAS] / self.sigma**2
        scatter = np.linalg.inv(model.effects + 1e-12 * np.eye(EFFECTS))
        chain.G += scatter
        chain.k -= scatter @ effects

"""The graph: ten keyframes and the newest frame, solved at every frame; what leaves becomes a linear factor."""

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X
from scipy.linalg import cho_solve

from factor.bias_prior import BiasFactors, PriorError
from factor.border import error_from_gtsam, insert, state_of
from factor.config import PriorConfig, WindowConfig
from factor.inertia import Inertia
from factor.sight import Seen, Sides, Sight, View
from navcore.arrays import Floats, Mask, Rotations, Vectors
from navcore.calibration import CameraMount
from navcore.chi_square import chi_square_quantile
from navcore.frontend import Observations
from navcore.imu import ImuNoise
from navcore.imu_buffer import Cells
from navcore.odometry import State
from navcore.prior import BiasPrior

_STATE = 15
_GAUGE_SIGMA = 1e-4  # rad, m: of what a start knows exactly, its own origin


@dataclass(frozen=True)
class Outcome:
    """The state at a frame, and how many of the features that it saw had a part in it, or were refused."""

    state: State
    used: int
    refused: int


@dataclass
class _Keyframe:
    """A keyframe: its number, directions (3,) in B by feature through the first camera, whether it stood still."""

    k: int
    directions: dict[int, Vectors]
    still: bool


class Window:
    """Everything that is estimated together, from a state on.

    Args:
        mounts: the cameras.
        noise: of the IMU.
        config, prior: settings.
        state: where it begins.
        error: the bias prior's constant error, if it is estimated.
        said: the last measurement of the prior before that, if there was one.
        observations: of the frame there.
    """

    def __init__(
        self,
        mounts: tuple[CameraMount, ...],
        noise: ImuNoise,
        config: WindowConfig,
        prior: PriorConfig,
        state: State,
        error: PriorError | None,
        said: BiasPrior | None,
        observations: Observations,
    ) -> None:
        self._config = config
        self._focal = mounts[0].camera.focal
        self._sides = Sides(mounts, config)
        self._inertia = Inertia(noise)
        self.biases = BiasFactors(prior, noise, error, said)
        self._values = gtsam.Values()
        insert(self._values, 0, state)
        self._before = _told(self._values, state)
        self.biases.begin(self._values, self._before, state.covariance[9:, 9:])
        self._between: dict[int, gtsam.NonlinearFactorGraph] = {}  # what the IMU says up to a keyframe
        self._views: dict[int, list[View]] = {}  # by feature, from the keyframes
        self._keyframes: list[_Keyframe] = []
        self._note(0)
        self._keep(0, self._sides.see(observations), still=False)

    def _note(self, n: int) -> None:
        """Frame `n` is the newest: from there the next one is predicted."""
        self._state = gtsam.NavState(self._values.atPose3(X(n)), self._values.atVector(V(n)))
        self._bias = self._values.atConstantBias(B(n))

    @property
    def newest(self) -> int:
        """Number of the newest keyframe."""
        return self._keyframes[-1].k

    def integrate(self, cells: Cells, noise: ImuNoise) -> Rotations:
        """Take the samples up to the next frame; returns R_B1B0, from the body at the last frame to the body now."""
        R_before = self._state.attitude().matrix()
        self._state = self._inertia.extend(cells, noise, self._state, self._bias)
        return np.asarray(self._state.attitude().matrix().T @ R_before)

    def advance(self, observations: Observations, said: list[BiasPrior], t_ns: int, *, still: bool) -> Outcome:
        """Solve with the frame at the end of the samples, which was at IMU time `t_ns`; keep it, if it tells enough.

        Args:
            observations: of it.
            said: by the bias prior since the last frame.
            t_ns: now.
            still: whether the body stands still.

        Raises:
            RuntimeError: the graph does not determine its states.
        """
        self.biases.hear(said, self.newest, self._values, t_ns)
        seen = self._sides.see(observations)
        k, n = self.newest, self.newest + 1
        self._values.insert(X(n), self._state.pose())
        self._values.insert(V(n), self._state.velocity())
        self._values.insert(B(n), self._bias)
        if not still:
            self._keyframes[-1].still = False  # it is not where the body stands still the next time
        rest = self._at_rest(n) if still else gtsam.NonlinearFactorGraph()
        covariance, used, refused = self._solve(self._inertial(n, rest), self._sights(n, seen))
        outcome = Outcome(state_of(self._values, n, covariance[:_STATE, :_STATE]), used, refused)
        self.biases.known(covariance)
        self._note(n)
        if self._is_keyframe(seen, still=still):
            self._between[n] = gtsam.NonlinearFactorGraph(rest)
            self._between[n].push_back(self._inertia.factor(k, n))
            self._keep(n, seen, still=still)
            if len(self._keyframes) > self._config.keyframes:
                self._let_go()
        else:
            for key in (X(n), V(n), B(n)):
                self._values.erase(key)
        return outcome

    def _inertial(self, n: int, rest: gtsam.NonlinearFactorGraph) -> gtsam.NonlinearFactorGraph:
        """All factors up to frame `n` but those of features."""
        graph = gtsam.NonlinearFactorGraph(rest)
        graph.push_back(self._before)
        for factors in self._between.values():
            graph.push_back(factors)
        graph.push_back(self._inertia.factor(self.newest, n))
        graph.push_back(self.biases.graph())
        return graph

    def _sights(self, n: int, seen: Seen) -> list[Sight]:
        """Of the features that were seen from keyframes, with what frame `n` saw."""
        now: dict[int, list[View]] = {}
        for key, view in seen.views(n):
            now.setdefault(key, []).append(view)
        all_views = (views + now.get(key, []) for key, views in self._views.items())
        return [self._sides.sight(views, n) for views in all_views if self._enough(views)]

    def _enough(self, views: list[View]) -> bool:
        return len(views) >= self._config.min_views and views[0][0] != views[-1][0]

    def _solve(self, inertial: gtsam.NonlinearFactorGraph, sights: list[Sight]) -> tuple[Floats, int, int]:
        """Gauss-Newton from where the values are.

        Returns:
            Covariance of the newest state and of the prior's error, if that is estimated, (15, 15) or (21, 21); how
            many sights were used and refused.
        """
        ordering = self._ordering()
        for _ in range(self._config.iterations):
            found, nis, passed = self._tested(sights)
            graph = gtsam.NonlinearFactorGraph(inertial)
            for sight, good in zip(found, passed, strict=True):
                if good:
                    graph.push_back(sight.factor)
            step, covariance = self._step(graph.linearize(self._values), ordering)
            self._values = self._values.retract(step)
            if step.norm() < self._config.settled:
                break  # what was tested before so small a step holds after it
        else:
            found, nis, passed = self._tested(sights)
        self._sides.noise.learn(nis, np.array([sight.dof for sight in found]))
        now = np.array([sight.now for sight in found], dtype=bool)
        return covariance, int((passed & now).sum()), int((~passed & now).sum())

    def _tested(self, sights: list[Sight]) -> tuple[list[Sight], Floats, Mask]:
        """Those whose point can be told, neither at the body nor too far away, and whether it explains their views.

        Returns:
            Sights, what their points leave unexplained (normalised, squared), and whether that passes the test.
        """
        found = [(s, result.get()) for s in sights if (result := s.factor.point(self._values)).valid()]
        if not found:
            return [], np.zeros(0), np.zeros(0, dtype=bool)
        points = np.array([point for _, point in found])
        frames = [*(keyframe.k for keyframe in self._keyframes), self.newest + 1]
        poses = [self._values.atPose3(X(k)) for k in frames if self._values.exists(X(k))]
        distance = np.linalg.norm(points[:, None] - np.array([pose.translation() for pose in poses]), axis=2)
        there = (distance.min(axis=1) > self._config.min_depth) & (distance.max(axis=1) < self._config.max_depth)
        kept = [sight for (sight, _), good in zip(found, there, strict=True) if good]
        nis = np.array([2.0 * sight.factor.error(self._values) for sight in kept])
        limit = chi_square_quantile(self._config.gate_probability, np.array([sight.dof for sight in kept]))
        return kept, nis, np.asarray(nis <= limit)

    def _ordering(self) -> gtsam.Ordering:
        """All states, the newest last, then the prior's error."""
        n = self.newest + 1
        last = [X(n), V(n), B(n), *self.biases.keys]
        ordering = gtsam.Ordering()
        for key in self._values.keys():  # noqa: SIM118, GTSAM's is no mapping
            if key not in last:
                ordering.push_back(key)
        for key in last:
            ordering.push_back(key)
        return ordering

    def _step(self, linear: gtsam.GaussianFactorGraph, ordering: gtsam.Ordering) -> tuple[gtsam.VectorValues, Floats]:
        """The step to the least squares, and the covariance of what comes last.

        By a Cholesky factor of the whole matrix, its diagonal scaled to one: GTSAM's own takes pivots that differ by
        seven orders of magnitude for a singular system, as a bias that hardly walks and is hardly known has them.
        """
        H, g = linear.hessian(ordering)
        scale = 1.0 / np.sqrt(np.diagonal(H))
        L = np.linalg.cholesky(H * np.outer(scale, scale))
        x = scale * cho_solve((L, True), scale * g)
        step, at = gtsam.VectorValues(), 0
        for i in range(ordering.size()):
            key = ordering.at(i)
            size = 3 if gtsam.Symbol(key).chr() == ord("v") else 6
            step.insert(key, x[at : at + size])
            at += size
        known = _STATE + 6 * len(self.biases.keys)
        corner = np.linalg.inv(L[-known:, -known:]) * scale[-known:]
        return step, corner.T @ corner

    def _at_rest(self, n: int) -> gtsam.NonlinearFactorGraph:
        """Frame `n` stands still: where the last keyframe was, if that stood still too."""
        c, graph = self._config, gtsam.NonlinearFactorGraph()
        graph.push_back(gtsam.PriorFactorVector(V(n), np.zeros(3), gtsam.noiseModel.Isotropic.Sigma(3, c.rest_sigma)))
        if self._keyframes[-1].still:
            same = gtsam.noiseModel.Isotropic.Sigma(6, c.same_sigma)
            graph.push_back(gtsam.BetweenFactorPose3(X(self.newest), X(n), gtsam.Pose3(), same))
        return graph

    def _is_keyframe(self, seen: Seen, *, still: bool) -> bool:
        last, c = self._keyframes[-1], self._config
        if (still and not last.still) or self._inertia.seconds >= c.longest_s:
            return True
        rows = np.flatnonzero(seen.first)
        common = [(last.directions[key], seen.directions[i]) for i in rows if (key := seen.keys[i]) in last.directions]
        if len(common) == 0:
            return len(rows) > 0
        if len(common) < c.common * len(last.directions):
            return True
        k, n = last.k, last.k + 1
        turn = self._values.atPose3(X(k)).rotation().between(self._values.atPose3(X(n)).rotation()).matrix()
        before, now = (np.array(x) for x in zip(*common, strict=True))
        angle = np.linalg.norm(np.cross(before, now @ turn.T), axis=1)
        return bool(np.median(angle) * self._focal >= c.disparity)

    def _keep(self, k: int, seen: Seen, *, still: bool) -> None:
        """Make frame `k`, the newest, a keyframe."""
        first = seen.first
        directions = dict(zip(seen.keys[first].tolist(), seen.directions[first], strict=True))
        self._keyframes.append(_Keyframe(k, directions, still))
        for key, view in seen.views(k):
            self._views.setdefault(key, []).append(view)
        self._inertia.begin(self.biases.integrated_at(self._values.atConstantBias(B(k))))
        self.biases.keyframe(k)

    def _let_go(self) -> None:
        """The oldest keyframe leaves: what is known through it becomes a factor on the states it is tied to.

        A feature that was seen from it goes with all its views, so that none counts twice, and begins anew.
        """
        k = self._keyframes.pop(0).k
        graph = gtsam.NonlinearFactorGraph()
        graph.push_back(self._before)
        graph.push_back(self._between.pop(self._keyframes[0].k))
        graph.push_back(self.biases.leave(k))
        for key, views in list(self._views.items()):
            if views[0][0] != k:
                continue
            sights, _, passed = self._tested([self._sides.sight(views, k)] if self._enough(views) else [])
            spent = bool(passed.any())
            if spent:
                graph.push_back(sights[0].factor)
            kept = [] if spent else [view for view in views if view[0] != k]
            if kept:
                self._views[key] = kept
            else:
                del self._views[key]
        linear = graph.linearize(self._values)
        _, rest = linear.eliminatePartialSequential([X(k), V(k), B(k)])
        self._before = gtsam.LinearContainerFactor.ConvertLinearGraph(rest, self._values)
        for key in (X(k), V(k), B(k)):
            self._values.erase(key)


def _told(values: gtsam.Values, state: State) -> gtsam.NonlinearFactorGraph:
    """What a state knows, as a factor on the first keyframe."""
    T = error_from_gtsam(state.R_WB)
    P = state.covariance + np.diag(np.repeat([_GAUGE_SIGMA**2, _GAUGE_SIGMA**2, 0.0, 0.0, 0.0], 3))
    information = T.T @ np.linalg.inv(P) @ T
    x, v, b = slice(0, 6), slice(6, 9), slice(9, 15)
    zero = np.zeros(15)
    factor = gtsam.HessianFactor(
        X(0), V(0), B(0),
        information[x, x], information[x, v], information[x, b], zero[x],
        information[v, v], information[v, b], zero[v],
        information[b, b], zero[b], 0.0,
    )  # fmt: skip
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(gtsam.LinearContainerFactor(factor, values))
    return graph

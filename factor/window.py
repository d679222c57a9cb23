"""The graph: ten keyframes and the newest frame, solved at every frame; what leaves becomes a linear factor."""

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from factor.bias_prior import BiasFactors, PriorError
from factor.border import error_from_gtsam, insert, state_of
from factor.config import PriorConfig, WindowConfig
from factor.inertia import Inertia
from factor.sight import Seen, Sides
from navcore.arrays import Floats, Rotations, Vectors
from navcore.calibration import CameraMount
from navcore.frontend import Observations
from navcore.imu import ImuNoise
from navcore.imu_buffer import Cells
from navcore.odometry import State
from navcore.prior import BiasPrior

_STATE = 15
_GAUGE_SIGMA = 1e-4  # rad, m: of what a start knows exactly, its own origin


@dataclass(frozen=True)
class Outcome:
    """What a frame did: the state there, and how many features had a part in it or were refused."""

    state: State
    used: int
    refused: int


@dataclass
class _Keyframe:
    """A keyframe: its number, and directions (3,) in B by feature, through the first camera."""

    k: int
    directions: dict[int, Vectors]


class Window:
    """Everything that is estimated together, from a state on.

    Args:
        mounts: the cameras.
        noise: of the IMU.
        config, prior: settings.
        state: where it begins.
        error: the bias prior's constant error, if it is estimated.
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
        observations: Observations,
    ) -> None:
        self._config = config
        self._focal = mounts[0].camera.focal
        self._sides = Sides(mounts, config)
        self._inertia = Inertia(noise)
        self.biases = BiasFactors(prior, noise, error)
        self._values = gtsam.Values()
        insert(self._values, 0, state)
        self._before = _told(self._values, state)
        self.biases.begin(self._values, self._before)
        self._between: dict[int, gtsam.CombinedImuFactor] = {}  # by the later keyframe
        self._views: dict[int, list[tuple[int, int, Floats]]] = {}  # by feature: keyframe, side, px from its axis
        self._keyframes: list[_Keyframe] = []
        self._keep(0, self._sides.see(observations))

    @property
    def newest(self) -> int:
        """Number of the newest keyframe."""
        return self._keyframes[-1].k

    def integrate(self, cells: Cells, noise: ImuNoise) -> Rotations:
        """Take the samples up to the next frame; returns the body's rotation, as what it takes vectors of before to."""
        return self._inertia.extend(cells, noise)

    def advance(self, observations: Observations, said: list[BiasPrior], t_ns: int) -> Outcome:
        """Solve with the frame at the end of the samples, which was at IMU time `t_ns`; keep it, if it tells enough.

        Args:
            observations: of it.
            said: by the bias prior since the last frame.
            t_ns: now.

        Raises:
            RuntimeError: the graph does not determine its states.
        """
        self.biases.hear(said, self.newest, self._values, t_ns)
        seen = self._sides.see(observations)
        k, n = self.newest, self.newest + 1
        self._predict(k, n)
        graph, sights = self._graph(n, seen)
        linear = self._solve(graph)
        covariance = self._covariance(linear, n)
        used = sum(s.isValid() for s in sights)
        outcome = Outcome(
            state_of(self._values, n, covariance[:_STATE, :_STATE]), used, sum(s.isOutlier() for s in sights)
        )
        self.biases.known(covariance)
        if self._is_keyframe(seen):
            self._between[n] = self._inertia.factor(k, n)
            self._keep(n, seen)
            if len(self._keyframes) > self._config.keyframes:
                self._let_go()
        else:
            for key in (X(n), V(n), B(n)):
                self._values.erase(key)
        return outcome

    def _predict(self, k: int, n: int) -> None:
        predicted = self._inertia.predict(self._values, k)
        self._values.insert(X(n), predicted.pose())
        self._values.insert(V(n), predicted.velocity())
        self._values.insert(B(n), self._values.atConstantBias(B(k)))

    def _graph(self, n: int, seen: Seen) -> tuple[gtsam.NonlinearFactorGraph, list[gtsam.NonlinearFactor]]:
        """All factors, and those of features among them."""
        graph = gtsam.NonlinearFactorGraph()
        graph.push_back(self._before)
        for factor in self._between.values():
            graph.push_back(factor)
        graph.push_back(self._inertia.factor(self.newest, n))
        graph.push_back(self.biases.graph())
        sights = []
        now: dict[int, list[tuple[int, int, Floats]]] = {}
        for key, side, point in zip(seen.keys.tolist(), seen.sides.tolist(), seen.points, strict=True):
            now.setdefault(key, []).append((n, side, point))
        for key, views in self._views.items():
            all_views = views + now.get(key, [])
            if len({view[0] for view in all_views}) >= 2 and len(all_views) >= self._config.min_views:
                sights.append(self._sides.factor(all_views))
        for sight in sights:
            graph.push_back(sight)
        return graph, sights

    def _solve(self, graph: gtsam.NonlinearFactorGraph) -> gtsam.GaussianFactorGraph:
        """Gauss-Newton from where the values are; returns the last linearisation."""
        for _ in range(self._config.iterations):
            linear = graph.linearize(self._values)
            step = linear.optimize()
            self._values = self._values.retract(step)
            if step.norm() < self._config.settled:
                break
        return linear

    def _covariance(self, linear: gtsam.GaussianFactorGraph, n: int) -> Floats:
        """Of frame `n`'s state and of the prior's error, if that is estimated: (15, 15) or (21, 21)."""
        wanted = [X(n), V(n), B(n), *self.biases.keys]
        others = [key for key in self._values.keys() if key not in wanted]  # noqa: SIM118, GTSAM's is no mapping
        _, rest = linear.eliminatePartialSequential(others)
        ordering = gtsam.Ordering()
        for key in wanted:
            ordering.push_back(key)
        information, _ = rest.hessian(ordering)
        return np.linalg.inv(information)

    def _is_keyframe(self, seen: Seen) -> bool:
        last, c = self._keyframes[-1], self._config
        rows = np.flatnonzero(seen.first)
        common = [(last.directions[key], seen.directions[i]) for i in rows if (key := seen.keys[i]) in last.directions]
        if len(common) == 0:
            return self._inertia.seconds >= c.longest_s or len(rows) > 0
        if len(common) < c.common * len(last.directions):
            return True
        k, n = last.k, last.k + 1
        turn = self._values.atPose3(X(k)).rotation().between(self._values.atPose3(X(n)).rotation()).matrix()
        before, now = (np.array(x) for x in zip(*common, strict=True))
        angle = np.linalg.norm(np.cross(before, now @ turn.T), axis=1)
        return bool(np.median(angle) * self._focal >= c.disparity)

    def _keep(self, k: int, seen: Seen) -> None:
        """Make frame `k`, the newest, a keyframe."""
        first = seen.first
        directions = dict(zip(seen.keys[first].tolist(), seen.directions[first], strict=True))
        self._keyframes.append(_Keyframe(k, directions))
        for key, side, point in zip(seen.keys.tolist(), seen.sides.tolist(), seen.points, strict=True):
            self._views.setdefault(key, []).append((k, side, point))
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
            spent = False
            if len({view[0] for view in views}) >= 2 and len(views) >= self._config.min_views:
                sight = self._sides.factor(views)
                sight.linearize(self._values)
                if sight.isValid():
                    graph.push_back(sight)
                    spent = True
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

"""Three ways to the biases: Gauss-Newton, the paper's Adam, and the paper's mean over moments.

All go gyro first: its bias is that under which turns meet the truth; then, with it fixed, the accelerometer's.
Paper: Yi et al., "A Plug-and-Play Learning-based IMU Bias Factor for Robust Visual-Inertial Odometry".
"""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from ipnet.labels import errors as err
from ipnet.labels.equations import Equations, accel_equations, gyro_equations
from ipnet.labels.errors import Errors, Normal
from ipnet.labels.nodes import Nodes
from ipnet.preintegration import Increments, preintegrate
from navcore.arrays import Floats, Vectors
from navcore.imu import GRAVITY, ImuNoise, ImuSamples

_RELINEARISED = 4  # at most; a gyro bias of .1 rad/s needs three
_REWEIGHTED = 12
_UPRIGHTED = 2  # a tilt of 2.5 degrees takes .01 m/s^2 off the vertical, known from the first solution to 1e-5
_SETTLED = 2e-6  # rad/s, m/s^2
_LINEAR = 1e-4  # rad/s: steps below are linear to 1e-8
_LEAST = 1e-6  # rad/s, m/s^2: what an error is at least, so that a perfect IMU can be labelled
ADAM_STEPS = 15_000
ADAM_EVERY = 5_000
"""Steps after which the learning rate falls tenfold, and the gyro is preintegrated anew."""
_ADAM_REWEIGHTS = 500  # steps


@dataclass(frozen=True)
class Problem:
    """A recording's IMU and the poses that it is held against.

    Attributes:
        imu: samples.
        nodes: poses of the truth.
        noise: of the IMU: its random walks say how far biases stray from their mean.
        tilt: gravity's direction in the truth's world is an unknown too.
    """

    imu: ImuSamples
    nodes: Nodes
    noise: ImuNoise
    tilt: bool

    @property
    def gyro_floor(self) -> float:
        """Standard deviation [rad/s] of the mean rate of a segment by white noise."""
        return self._floor(self.noise.gyroscope_noise_density)

    @property
    def accel_floor(self) -> float:
        """Standard deviation [m/s^2] of the mean specific force under a triangle over two segments, likewise."""
        return self._floor(self.noise.accelerometer_noise_density) * float(np.sqrt(2.0 / 3.0))

    def _floor(self, density: float) -> float:
        length = float(np.median(np.diff(self.nodes.t_ns)[self.nodes.joined])) * 1e-9
        return max(density / float(np.sqrt(length)), _LEAST)

    def increments(self, b_g: Vectors) -> Increments:
        """From each node to the next, with a gyro bias and no accelerometer bias: terms are linear in that.

        Where a segment was left out, what is said does not reach to the next node.
        """
        t_ns, joined = self.nodes.t_ns, self.nodes.joined
        step = round(float(np.median(np.diff(t_ns)[joined])))
        gaps = zip(t_ns[:-1][~joined], t_ns[1:][~joined], strict=True)
        fill = [np.arange(begin + step, end - step // 2, step) for begin, end in gaps]  # else one row is very long
        edges = np.union1d(t_ns, np.concatenate([t_ns[:0], *fill]))
        found = preintegrate(self.imu, edges, b_g, np.zeros(3))
        of_nodes = np.searchsorted(edges, t_ns[:-1])
        return Increments(*(getattr(found, f.name)[of_nodes] for f in fields(found)))


@dataclass(frozen=True)
class Block:
    """What was found in one of the two halves.

    Attributes:
        x: (U,) the unknowns of `equations`, the whole bias first.
        covariance: (U, U).
        by_gyro: (U, 3) how much an error of the gyro bias moves them.
        residual: (N, 3) what is left.
        errors: sizes and weights.
        increments: at which the equations hold.
    """

    x: Floats
    covariance: Floats
    by_gyro: Floats
    residual: Vectors
    errors: Errors
    increments: Increments


Solver = Callable[[Problem], tuple[Block, Block]]


def gauss_newton(problem: Problem) -> tuple[Block, Block]:
    """Least squares with robust weights, preintegrated anew at the current gyro bias until it stays."""
    b_g, errors = np.zeros(3), None
    walk, floor = problem.noise.gyroscope_random_walk, problem.gyro_floor
    for _ in range(_RELINEARISED):
        equations, increments = _gyro(problem, b_g)
        step, errors = _settled(equations, errors, walk, floor)
        b_g = b_g + step
        if float(np.abs(step).max()) < _LINEAR:
            break
    assert errors is not None
    gyro = _block(b_g, equations, errors, walk, increments, step)
    increments = problem.increments(b_g)
    walk, floor = problem.noise.accelerometer_random_walk, problem.accel_floor
    x, errors = np.zeros(0), None
    for _ in range(_UPRIGHTED if problem.tilt else 1):
        equations = accel_equations(problem.nodes, increments, problem.tilt, _down(x))
        x, errors = _settled(equations, errors, walk, floor)
    assert errors is not None
    return gyro, _block(x, equations, errors, walk, increments, x)


def adam(problem: Problem) -> tuple[Block, Block]:
    """The paper's: Adam at 1e-3 for the gyro, then at 1e-2 for the accelerometer, 15 000 steps each.

    It descends the loss that `gauss_newton` solves, and brings its weights up to date on its way.
    """
    b_g, errors = np.zeros(3), None
    walk, floor = problem.noise.gyroscope_random_walk, problem.gyro_floor
    for stage in range(ADAM_STEPS // ADAM_EVERY):
        equations, increments = _gyro(problem, b_g)
        step, errors = _descend(equations, np.zeros(3), errors, walk, floor, 1e-3 * 0.1**stage)
        b_g = b_g + step
    assert errors is not None
    gyro = _block(b_g, equations, errors, walk, increments, step)
    increments = problem.increments(b_g)
    walk, floor = problem.noise.accelerometer_random_walk, problem.accel_floor
    x, of_accel = np.zeros(6 if problem.tilt else 4), None
    for stage in range(ADAM_STEPS // ADAM_EVERY):
        equations = accel_equations(problem.nodes, increments, problem.tilt, _down(x))
        x, of_accel = _descend(equations, x, of_accel, walk, floor, 1e-2 * 0.1**stage)
    assert of_accel is not None
    return gyro, _block(x, equations, of_accel, walk, increments, x)


def per_moment(problem: Problem) -> tuple[Block, Block]:
    """The paper's other way: each moment is solved by itself, from no bias, and the mean is taken.

    Every moment counts the same, so one bad pose of the truth moves the mean. The world is taken to be upright.
    """
    equations, increments = _gyro(problem, np.zeros(3))
    gyro = _mean(equations, increments)
    increments = problem.increments(gyro.x)
    return gyro, _mean(accel_equations(problem.nodes, increments, tilt=False), increments)


SOLVERS: dict[str, Solver] = {"gauss-newton": gauss_newton, "adam": adam, "per-moment": per_moment}
"""Solvers by name."""


def _gyro(problem: Problem, b_g: Vectors) -> tuple[Equations, Increments]:
    increments = problem.increments(b_g)
    return gyro_equations(problem.nodes, increments), increments


def _down(x: Floats) -> float:
    """What is left of gravity along z, when its x and y are the last two of six unknowns."""
    level = float(np.sum(x[4:6] ** 2)) if len(x) == 6 else 0.0
    return float(np.sqrt(max(GRAVITY**2 - level, 0.0)))


def _settled(equations: Equations, errors: Errors | None, walk: float, floor: float) -> tuple[Floats, Errors]:
    """Solve and weigh in turn until the solution stays."""
    x: Floats = np.asarray(np.linalg.lstsq(equations.A.reshape(-1, equations.A.shape[2]), equations.r.ravel())[0])
    errors = errors or err.fresh(equations, x)
    for _ in range(_REWEIGHTED):
        errors = err.reweighted(equations, x, errors, walk, floor)
        told = err.normal(equations, errors, walk)
        before, x = x, np.asarray(np.linalg.solve(told.H, told.h))
        if float(np.abs(x - before).max()) < _SETTLED:
            break
    return x, errors


def _descend(
    equations: Equations, x: Floats, errors: Errors | None, walk: float, floor: float, rate: float
) -> tuple[Floats, Errors]:
    """`ADAM_EVERY` steps of Adam (Kingma, Ba 2015, algorithm 1)."""
    errors = errors or err.fresh(equations, x)
    m, v = np.zeros_like(x), np.zeros_like(x)
    for step in range(ADAM_EVERY):
        if step % _ADAM_REWEIGHTS == 0:
            errors = err.reweighted(equations, x, errors, walk, floor)
            told = err.normal(equations, errors, walk)
        gradient = told.H @ x - told.h
        m, v = 0.9 * m + 0.1 * gradient, 0.999 * v + 0.001 * gradient**2
        m_hat, v_hat = m / (1.0 - 0.9 ** (step + 1)), v / (1.0 - 0.999 ** (step + 1))
        x = x - rate * m_hat / (np.sqrt(v_hat) + 1e-8)
    return x, errors


def _block(x: Floats, equations: Equations, errors: Errors, walk: float, increments: Increments, step: Floats) -> Block:
    """`step`: what solves the equations, that is `x` less where they were linearised."""
    told: Normal = err.normal(equations, errors, walk)
    covariance: Floats = np.asarray(np.linalg.inv(told.H))
    by_gyro = np.zeros((len(x), 3)) if told.H_gyro is None else -covariance @ told.H_gyro
    return Block(x, covariance, by_gyro, err.residual(equations, step), errors, increments)


def _mean(equations: Equations, increments: Increments) -> Block:
    each = np.linalg.solve(equations.A[:, :, :3], equations.r[..., None])[..., 0]
    x: Floats = np.asarray(each.mean(axis=0))
    rows, nodes = equations.by_node.shape
    covariance: Floats = np.asarray(np.cov(each.T) / rows, dtype=np.float64)
    by_gyro = np.zeros((3, 3))
    if equations.by_gyro is not None:
        by_gyro = -np.linalg.solve(equations.A[:, :, :3], equations.by_gyro).mean(axis=0)
    left = equations.r - equations.A[:, :, :3] @ x
    errors = Errors(float(np.sqrt(np.mean(left**2))), 0.0, np.ones(rows), np.ones(nodes))
    return Block(x, covariance, by_gyro, left, errors, increments)

"""One label from a recording and its truth."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ipnet.errors import ConfigError, LabelError
from ipnet.labels import errors as err
from ipnet.labels.equations import OFFSET_UNIT_S, gyro_equations, turn_columns
from ipnet.labels.filter_run import GoodPath
from ipnet.labels.nodes import choose_nodes
from ipnet.labels.solvers import SOLVERS, Block, Problem
from ipnet.recordings import Label
from navcore import so3
from navcore.arrays import Floats, Vectors, frozen
from navcore.imu import GRAVITY
from navcore.sequence import Sequence

SolverName = Literal["gauss-newton", "adam", "per-moment"]
_TURN_SIGMA = np.deg2rad(1.0)  # how far a truth's body can be thought to be turned against the IMU


@dataclass(frozen=True)
class LabelConfig:
    """Settings of a label."""

    solver: SolverName = "gauss-newton"  # the default; the paper's Adam; or the paper's mean over single moments
    segment_s: float = 1.0  # time between two poses of the truth that the IMU is held against
    tilt: bool = True  # the truth's world may be tilted against gravity; without, it is taken to be upright

    def __post_init__(self) -> None:
        if self.solver not in SOLVERS:
            raise ConfigError(f"solver {self.solver!r} is unknown; known are {', '.join(SOLVERS)}")
        if not (np.isfinite(self.segment_s) and 0.1 <= self.segment_s <= 10.0):
            raise ConfigError(f"segment_s is {self.segment_s}, expected 0.1 to 10 s")


@dataclass(frozen=True)
class Measured:
    """Numbers with their standard deviations.

    Attributes:
        value, sigma: (N,).
    """

    value: Floats
    sigma: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", frozen("value", self.value, np.float64, (None,)))
        object.__setattr__(self, "sigma", frozen("sigma", self.sigma, np.float64, (len(self.value),)))


@dataclass(frozen=True)
class SolvedLabel:
    """A label, and how it was found.

    Attributes:
        label: what it says.
        solver: its name.
        segments, left_out: how many were used, and how many fell to gaps.
        tilt: (2,) rad by which the truth's world is turned about its x and y against gravity, or None.
        offset: (1,) s by which the truth's positions are ahead of the IMU, or None.
        turn: rad, rms about an axis, by which the truth's body seems to be turned against the IMU.
        rms: of what is left: mean rates [rad/s] and mean specific forces [m/s^2].
        span_ns: of truth and IMU together.
    """

    label: Label
    solver: str
    segments: int
    left_out: int
    tilt: Measured | None
    offset: Measured | None
    turn: float
    rms: tuple[float, float]
    span_ns: tuple[int, int]


def label(sequence: Sequence, config: LabelConfig | None = None, path: GoodPath | None = None) -> SolvedLabel:
    """The one bias under which a recording's IMU meets its truth.

    Args:
        sequence: with truth, unless there is a path.
        config: settings.
        path: a filter's, in place of the truth.

    Raises:
        LabelError: there is no truth, or too little of it.
    """
    config = config or LabelConfig()
    truth = sequence.truth if path is None else path.poses
    if truth is None:
        raise LabelError(f"{sequence.name}: has no truth; expected one, or a filter's path in its place")
    try:
        nodes = choose_nodes(sequence.imu, truth, config.segment_s)
        problem = Problem(sequence.imu, nodes, sequence.calibration.imu, config.tilt)
        gyro, accel = SOLVERS[config.solver](problem)
    except LabelError as error:
        raise LabelError(f"{sequence.name}: {error}") from error
    turn = _turn(problem, gyro)
    inside = sequence.imu.between(*nodes.span_ns)
    covariance = _covariance(gyro, accel, inside.accel.mean(axis=0) - accel.x[:3], turn)
    if path is not None:
        covariance += np.diag(path.sigma**2)
    found = Label(sequence.name, np.concatenate([gyro.x, accel.x[:3]]), covariance)
    extra = Measured(accel.x[3:], np.sqrt(np.diag(accel.covariance))[3:])
    return SolvedLabel(
        label=found,
        solver=config.solver,
        segments=int(nodes.joined.sum()),
        left_out=nodes.left_out,
        tilt=_tilt(extra.value[1:], extra.sigma[1:]) if len(extra.value) == 3 else None,
        offset=Measured(OFFSET_UNIT_S * extra.value[:1], OFFSET_UNIT_S * extra.sigma[:1]) if len(extra.value) else None,
        turn=turn,
        rms=(_rms(gyro), _rms(accel)),
        span_ns=nodes.span_ns,
    )


def _tilt(gravity: Floats, sigma: Floats) -> Measured:
    """From x and y of gravity in the truth's world, which is upright but for turns about its x and y."""
    return Measured(np.array([-gravity[1], gravity[0]]) / GRAVITY, sigma[::-1] / GRAVITY)


def _turn(problem: Problem, gyro: Block) -> float:
    """Turn of the truth's body against the IMU [rad, rms about an axis], beyond what the gyro's noise explains."""
    equations = gyro_equations(problem.nodes, gyro.increments)
    columns = turn_columns(problem.nodes, gyro.increments)
    prior = np.repeat([0.0, _TURN_SIGMA**-2], 3)
    wider = replace(equations, A=np.concatenate([equations.A, columns], axis=2), prior=prior)
    told = err.normal(wider, gyro.errors, problem.noise.gyroscope_random_walk)
    turn, covariance = np.linalg.solve(told.H, told.h)[3:], np.linalg.inv(told.H)[3:, 3:]
    return float(np.sqrt(max(0.0, turn @ turn - np.trace(covariance)) / 3.0))


def _covariance(gyro: Block, accel: Block, force: Vectors, turn: float) -> Floats:
    """(6, 6) of (b_g, b_a); `force`: the mean specific force in B.

    A truth whose body is turned against the IMU shifts b_a by that turn times the force. Poses tell such a turn
    too poorly to correct for it, well enough to say how large it may be.
    """
    by_gyro = accel.by_gyro[:3]
    joint = np.zeros((6, 6))
    joint[:3, :3] = gyro.covariance
    joint[3:, :3] = by_gyro @ gyro.covariance
    joint[:3, 3:] = joint[3:, :3].T
    joint[3:, 3:] = accel.covariance[:3, :3] + by_gyro @ gyro.covariance @ by_gyro.T
    joint[3:, 3:] += turn**2 * so3.hat(force) @ so3.hat(force).T
    return 0.5 * (joint + joint.T)


def _rms(block: Block) -> float:
    return float(np.sqrt(np.mean(block.residual**2)))

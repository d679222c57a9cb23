"""Gauss-Newton on the biases of a window, in torch: what the motion model of a platform says of them.

The window is cut into pieces, each with a gravity and a velocity of its own in its middle M; all of them share the
biases. Rates are integrated to attitudes, specific forces to velocities, from M outwards. A platform's motion obeys
linear relations between velocity, specific force and rate in B: a quadrotor's specific force across its thrust is
-d v, a rover has no velocity sideways. Each row of the model is such a relation,

    r = A v_B + B f_B + C omega_B + n,    weight w,

with A, B, C learned and n, w given by the network for each block of the window. The unknowns are each piece's tilt of
gravity and velocity in M, and both biases; the attitude error is -G db_g with G the integral of R_M.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from ipnet.attitudes import attitudes, cross, skew
from ipnet.elimination import eliminated, solved
from ipnet.presets import BLOCK, STEP
from navcore.imu import GRAVITY

TILT_SIGMA = 0.2  # rad, of gravity's direction from the mean specific force
VELOCITY_SIGMA = 3.0  # m/s, of the middle's velocity from the platform's usual one
DOF = 4.0  # of Student's distribution of what the model leaves over: a stand on the ground is not flight


@dataclass(frozen=True)
class MotionModel:
    """Relations that the platform obeys.

    Attributes:
        A, B, C: (m, 3) by velocity, specific force, rate.
        n: (batch, m, blocks) the rest.
        w: (batch, m, blocks) weights: 1 / sd.
    """

    A: Tensor
    B: Tensor
    C: Tensor
    n: Tensor
    w: Tensor

    def double(self) -> "MotionModel":
        """In double precision."""
        return MotionModel(*(part.double() for part in (self.A, self.B, self.C, self.n, self.w)))

    def usual_velocity(self) -> Tensor:
        """(batch, 3) in B, by the last three rows."""
        return -self.n[:, -3:].mean(2)


@dataclass(frozen=True)
class Belief:
    """What is thought before or after a refinement.

    Attributes:
        bias: (batch, 6) b_g, b_a.
        variance: (batch, 6).
        gravity, velocity: (batch * pieces, 3) in the middle of each piece, or None where they are not known yet.
    """

    bias: Tensor
    variance: Tensor
    gravity: Tensor | None = None
    velocity: Tensor | None = None

    def double(self) -> "Belief":
        """In double precision."""
        return Belief(*(part if part is None else part.double() for part in vars(self).values()))


def refine(steps: Tensor, dt: float, first: Belief, now: Belief, model: MotionModel, pieces: int) -> Belief:
    """Solve once for what fits the motion model, linearised at `now`, with `first` as what was known beforehand.

    Gravity and velocities of `now` count if it has as many pieces.

    Args:
        steps: (batch, 6, n) rate, specific force, see `ipnet.steps.condensed`.
        dt: s between them.
    """
    off_bias = _cut(steps, pieces) - now.bias[:, None, :, None]
    omega, f = off_bias.flatten(0, 1).chunk(2, dim=1)
    R = attitudes(omega * dt)  # (batch * pieces, 3, 3, n / pieces)
    f_M = (R * f[:, None]).sum(2)
    if now.gravity is not None and now.velocity is not None and len(now.gravity) == len(R):
        gravity, velocity = now.gravity, now.velocity
    else:
        up = f_M.mean(2)
        gravity = -GRAVITY * up / up.norm(dim=1, keepdim=True)
        velocity = model.usual_velocity().repeat_interleave(pieces, dim=0)
    n, w = (_cut(part, pieces).flatten(0, 1) for part in (model.n, model.w))
    v_M = from_middle(f_M, dt) + gravity[..., None] * times(f_M, dt) + velocity[..., None]
    v_B = (R * v_M[:, :, None]).sum(1)
    by_v_f_omega = torch.cat([model.A, model.B, model.C], dim=1)
    r = block_means(by_v_f_omega @ torch.cat([v_B, f, omega], dim=1)) + n
    J = jacobian(R, f_M, v_M, gravity, dt, model)  # (batch * pieces, m, 12, blocks)
    w = w / torch.sqrt(1.0 + (w * r) ** 2 / DOF)
    own, bias, variance = solve(w[:, :, None] * torch.cat([J, r[:, :, None]], dim=2), first, now)
    gravity = gravity + cross(own[:, :3], gravity)
    gravity = GRAVITY * gravity / gravity.norm(dim=1, keepdim=True)
    return Belief(now.bias + bias, variance, gravity, velocity + own[:, 3:])


def jacobian(R: Tensor, f_M: Tensor, v_M: Tensor, gravity: Tensor, dt: float, model: MotionModel) -> Tensor:
    """(batch, m, 12, blocks) of r by tilt, velocity, b_g, b_a, from means over blocks."""
    batch, step = len(R), dt * BLOCK / STEP
    t = block_means(times(v_M, dt))
    means = block_means(torch.cat([R.flatten(1, 2), f_M, v_M], dim=1))
    late = float(t[len(t) // 2])  # from M to the middle of the middle block
    G = from_middle(means[:, :9], step, late).unflatten(1, (3, 3))
    R, f_M, v_M = means[:, :9].view(G.shape), means[:, 9:12], means[:, 12:]
    F = from_middle(cross(f_M[:, :, None], G), step, 0.5 * late)
    eye = torch.eye(3, dtype=R.dtype)[None, :, :, None].expand(G.shape)
    tilt = -skew(gravity)[..., None] * t  # d(gravity) = tilt x gravity
    to_v_M = torch.cat([tilt, eye, F - cross(v_M[:, :, None], G), -G], dim=2)  # (batch, 3, 12, blocks)
    to_v_B = (R[:, :, :, None] * to_v_M[:, :, None]).sum(1)
    J = (model.A @ to_v_B.flatten(2)).view(batch, -1, 12, G.shape[3])
    fixed = torch.cat([torch.zeros_like(model.A).repeat(1, 2), -model.C, -model.B], dim=1)
    return J + fixed[None, :, :, None]


def times(like: Tensor, dt: float) -> Tensor:
    """(n,) s of the middles of steps from that of the middle one."""
    n = like.shape[-1]
    return (torch.arange(n, dtype=like.dtype) - n // 2) * dt


def from_middle(x: Tensor, dt: float, late: float = 0.0) -> Tensor:
    """Integral of (..., n) to the middles of all, from so many seconds before the middle of the middle one."""
    total = torch.cumsum(x, dim=-1) - 0.5 * x
    middle = slice(x.shape[-1] // 2, x.shape[-1] // 2 + 1)
    return (total - total[..., middle] + x[..., middle] * (late / dt)) * dt


def block_means(x: Tensor) -> Tensor:
    """(..., blocks) means of (..., steps)."""
    return x.unflatten(-1, (-1, BLOCK // STEP)).mean(-1)


def _cut(x: Tensor, pieces: int) -> Tensor:
    """(batch, pieces, k, n / pieces) of (batch, k, n)."""
    return x.unflatten(2, (pieces, -1)).transpose(1, 2)


def solve(weighted: Tensor, first: Belief, now: Belief) -> tuple[Tensor, Tensor, Tensor]:
    """Minimise |r + J x|^2, and what is known beforehand.

    In double precision; unknowns of pieces are eliminated first, then what pieces say of the biases is added up.

    Args:
        weighted: (batch * pieces, m, 13, blocks) J, r.

    Returns:
        steps (batch * pieces, 6) of tilt and velocity, (batch, 6) of biases, and variances of those, (batch, 6).
    """
    batch, dtype = len(now.bias), now.bias.dtype
    rows = weighted.transpose(1, 2).flatten(2).double()  # (batch * pieces, 13, m * blocks)
    known = torch.tensor([TILT_SIGMA**-2] * 3 + [VELOCITY_SIGMA**-2] * 3 + [0.0] * 7, dtype=torch.float64)
    N = (rows @ rows.transpose(1, 2) + torch.diag(known))[:, :12]
    tilt, N = eliminated(N)
    velocity, N = eliminated(N)
    eye = torch.eye(6, dtype=torch.float64).expand(batch, 6, 6)
    information = 1.0 / first.variance.double()
    pull = information * (now.bias - first.bias)
    S = N.unflatten(0, (batch, -1)).sum(1) + torch.cat([eye * information[:, None], pull[..., None]], dim=2)
    found = solved(torch.cat([S, eye], dim=2))
    bias, variance = -found[:, :, :1], (found[:, :, 1:] * eye).sum(2)
    x = torch.cat([bias, torch.ones_like(bias[:, :1])], dim=1).repeat_interleave(len(N) // batch, dim=0)
    x = torch.cat([-velocity @ x, x], dim=1)
    own = torch.cat([-tilt @ x, x[:, :3]], dim=1)
    return own[..., 0].to(dtype), bias[..., 0].to(dtype), variance.to(dtype)

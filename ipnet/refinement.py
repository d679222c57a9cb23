"""One step of Gauss-Newton on the biases of a window, in torch: what the motion model of a platform says of them.

The window's rates are integrated to attitudes, its specific forces to velocities, both from the window's middle M
outwards. A platform's motion obeys linear relations between velocity, specific force and rate in B: a quadrotor's
specific force across its thrust is -d v, a rover has no velocity sideways. Each row of the model is such a relation,

    r = A v_B + B f_B + C omega_B + n,    weight w,

with A, B, C learned and n, w given by the network for each block of the window. The unknowns are the gravity's tilt
and the velocity in the middle, and both biases; the attitude error is -G db_g with G the integral of R_M.
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ipnet.presets import BLOCK
from navcore.imu import GRAVITY

TILT_SIGMA = 0.2  # rad, of gravity's direction from the mean specific force
VELOCITY_SIGMA = 3.0  # m/s, of the middle's velocity
DOF = 4.0  # of Student's distribution of what the model leaves over: a stand on the ground is not flight
UNKNOWNS = 12  # tilt, velocity, b_g, b_a


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

    def within(self, reach: float) -> "MotionModel":
        """With less weight far from the middle: a Gaussian of that share of half the window; 0 for the same weights."""
        if reach == 0.0:
            return self
        blocks = self.w.shape[2]
        off = (torch.arange(blocks, dtype=self.w.dtype) + 0.5) * (2.0 / blocks) - 1.0
        return replace(self, w=self.w * torch.exp(-((off / reach) ** 2)))


@dataclass(frozen=True)
class Belief:
    """What is thought before or after a refinement.

    Attributes:
        bias: (batch, 6) b_g, b_a.
        variance: (batch, 6).
        gravity: (batch, 3) in M, or None where it is not known yet.
        velocity: (batch, 3) in M in the middle.
    """

    bias: Tensor
    variance: Tensor
    gravity: Tensor | None
    velocity: Tensor


def refine(window: Tensor, dt: float, first: Belief, now: Belief, model: MotionModel) -> Belief:
    """Solve once for what fits the motion model, linearised at `now`, with `first` as what was known beforehand.

    Args:
        window: (batch, 6, samples) gyro, accel.
        dt: s between samples.
    """
    batch = window.shape[0]
    omega, f = window[:, :3] - now.bias[:, :3, None], window[:, 3:] - now.bias[:, 3:, None]
    R = attitudes(omega, dt)  # (batch, 3, 3, samples)
    f_M = (R * f[:, None]).sum(2)
    level = f_M.mean(2)
    level = -GRAVITY * level / level.norm(dim=1, keepdim=True)
    gravity = level if now.gravity is None else now.gravity
    v_M = from_middle(f_M + gravity[..., None], dt) + now.velocity[..., None]
    v_B = (R * v_M[:, :, None]).sum(1)
    v, force, rate = block_means(v_B), block_means(f), block_means(omega)  # (batch, 3, blocks)
    r = model.A @ v + model.B @ force + model.C @ rate + model.n
    w = model.w / torch.sqrt(1.0 + (model.w * r) ** 2 / DOF)
    J = jacobian(R, f_M, v_M, gravity, dt, model)  # (batch, m, 12, blocks)
    J = (w[:, :, None] * J).transpose(2, 3).flatten(1, 2)
    r = (w * r).flatten(1)
    tilt = cross(level, gravity) / GRAVITY**2  # the rotation from what the mean force says
    off = torch.cat([tilt, now.velocity, now.bias - first.bias], dim=1)
    fixed = window.new_tensor([TILT_SIGMA**-2] * 3 + [VELOCITY_SIGMA**-2] * 3).expand(batch, 6)
    information = torch.cat([fixed, 1.0 / first.variance], dim=1)
    x, variance = solve(J, r, information, off)
    gravity = gravity + cross(x[:, :3], gravity)
    gravity = GRAVITY * gravity / gravity.norm(dim=1, keepdim=True)
    return Belief(now.bias + x[:, 6:], variance[:, 6:], gravity, now.velocity + x[:, 3:6])


def jacobian(R: Tensor, f_M: Tensor, v_M: Tensor, gravity: Tensor, dt: float, model: MotionModel) -> Tensor:
    """(batch, m, 12, blocks) of r by tilt, velocity, b_g, b_a, in the middles of blocks."""
    at, to = slice(BLOCK // 2, None, BLOCK), slice(BLOCK // 2 - 1, None, BLOCK)
    G = torch.cumsum(R, dim=3) * dt
    G = G[..., to] - G[..., R.shape[3] // 2 - 1, None]  # (batch, 3, 3, blocks)
    step = BLOCK * dt
    swept = cross(block_means(f_M)[:, :, None], G) * step
    F = torch.cumsum(swept, dim=3)
    half = F.shape[3] // 2
    F = F - 0.5 * swept - F[..., half - 1, None]
    v = v_M[..., at]
    eye = torch.eye(3, dtype=R.dtype)[None, :, :, None].expand(R.shape[0], 3, 3, G.shape[3])
    t = ((torch.arange(G.shape[3], dtype=R.dtype) + 0.5) * step - 0.5 * step * G.shape[3])[None, None, None]
    g = cross(-gravity[..., None, None], eye[..., :1]) * t  # d(gravity) = tilt x gravity
    to_v_M = torch.cat([g, eye, F - cross(v[:, :, None], G), -G], dim=2)  # (batch, 3, 12, blocks)
    to_v_B = (R[..., at][:, :, :, None] * to_v_M[:, :, None]).sum(1)
    J = torch.einsum("mi,bijk->bmjk", model.A, to_v_B)
    fixed = torch.cat([torch.zeros_like(model.A).repeat(1, 2), -model.C, -model.B], dim=1)
    return J + fixed[None, :, :, None]


def attitudes(omega: Tensor, dt: float) -> Tensor:
    """(batch, 3, 3, n) rotation from B in the middle of each sample to B in the middle of the window.

    Rotations of samples are composed by parallel prefix products, first inside blocks, then of blocks.

    Args:
        omega: (batch, 3, n) rad/s, means over samples.
    """
    batch, _, n = omega.shape
    phi = omega * dt
    before = torch.cat([phi[..., :1], phi[..., :-1]], dim=2)
    phi = phi + cross(before, phi) / 12.0  # coning
    half = _quaternion(0.5 * phi)
    inside = _prefix(product(half, half).view(batch, 4, n // BLOCK, BLOCK))
    ends = _prefix(inside[..., -1])
    middle = ends[..., n // BLOCK // 2 - 1, None]
    begins = torch.cat([_inverse(middle), product(_inverse(middle), ends[..., :-1])], dim=2)
    q = product(begins[..., None], inside).view(batch, 4, n)
    return _matrix(product(q, _inverse(half)))


def _prefix(q: Tensor) -> Tensor:
    """Products of all quaternions up to each, along the last axis."""
    step = 1
    while step < q.shape[-1]:
        q = torch.cat([q[..., :step], product(q[..., :-step], q[..., step:])], dim=-1)
        step *= 2
    return q


def _quaternion(phi: Tensor) -> Tensor:
    """(batch, 4, n) wxyz of rotation vectors (batch, 3, n)."""
    angle = torch.sqrt((phi * phi).sum(1, keepdim=True) + 1e-12)
    return torch.cat([torch.cos(0.5 * angle), torch.sin(0.5 * angle) / angle * phi], dim=1)


def product(p: Tensor, q: Tensor) -> Tensor:
    """(batch, 4, ...) Hamilton product of quaternions, wxyz: sixteen products, four by four with their signs."""
    first = torch.tensor([0, 1, 2, 3, 0, 1, 2, 3, 0, 2, 3, 1, 0, 3, 1, 2])
    second = torch.tensor([0, 1, 2, 3, 1, 0, 3, 2, 2, 0, 1, 3, 3, 0, 2, 1])
    sign = torch.tensor([1, -1, -1, -1, 1, 1, 1, -1, 1, 1, 1, -1, 1, 1, 1, -1], dtype=p.dtype)
    terms = p.index_select(1, first) * q.index_select(1, second)
    terms = terms.view(terms.shape[0], 4, 4, *terms.shape[2:]) * sign.view(1, 4, 4, *[1] * (p.dim() - 2))
    return terms.sum(2)


def _inverse(q: Tensor) -> Tensor:
    sign = torch.tensor([1, -1, -1, -1], dtype=q.dtype)
    return q * sign.view(1, 4, *[1] * (q.dim() - 2))


def _matrix(q: Tensor) -> Tensor:
    """(batch, 3, 3, n) of unit quaternions (batch, 4, n), wxyz: linear in the products of two of their elements."""
    first = torch.tensor([0, 1, 2, 3, 0, 0, 0, 1, 2, 3])
    second = torch.tensor([0, 1, 2, 3, 1, 2, 3, 2, 3, 1])
    rows = torch.tensor(  # by ww xx yy zz wx wy wz xy yz zx
        [
            [1, 1, -1, -1, 0, 0, 0, 0, 0, 0],
            [0, 0, 0, 0, 0, 0, -2, 2, 0, 0],
            [0, 0, 0, 0, 0, 2, 0, 0, 0, 2],
            [0, 0, 0, 0, 0, 0, 2, 2, 0, 0],
            [1, -1, 1, -1, 0, 0, 0, 0, 0, 0],
            [0, 0, 0, 0, -2, 0, 0, 0, 2, 0],
            [0, 0, 0, 0, 0, -2, 0, 0, 0, 2],
            [0, 0, 0, 0, 2, 0, 0, 0, 2, 0],
            [1, -1, -1, 1, 0, 0, 0, 0, 0, 0],
        ],
        dtype=q.dtype,
    )
    return (rows @ (q.index_select(1, first) * q.index_select(1, second))).view(q.shape[0], 3, 3, q.shape[2])


def cross(a: Tensor, b: Tensor) -> Tensor:
    """(batch, 3, ...): a x b along the second axis."""
    one, two = torch.tensor([1, 2, 0]), torch.tensor([2, 0, 1])
    return a.index_select(1, one) * b.index_select(1, two) - a.index_select(1, two) * b.index_select(1, one)


def from_middle(a: Tensor, dt: float) -> Tensor:
    """Integral of (batch, 3, n) from the window's middle to the middle of each sample."""
    total = torch.cumsum(a, dim=2)
    return (total - 0.5 * a - total[..., a.shape[2] // 2 - 1, None]) * dt


def block_means(x: Tensor) -> Tensor:
    """(batch, 3, blocks) means of (batch, 3, samples)."""
    return x.view(x.shape[0], x.shape[1], -1, BLOCK).mean(3)


def solve(J: Tensor, r: Tensor, information: Tensor, off: Tensor) -> tuple[Tensor, Tensor]:
    """Minimise |r + J x|^2 + (off + x)^T diag(information) (off + x).

    By Gauss-Jordan elimination on unknowns of unit prior variance, in double precision, in operations that any
    runtime has; the matrix is positive definite, so no pivots are sought.

    Returns:
        x and its variances, (batch, 12) each.
    """
    scale = information.double().rsqrt()
    J = J.double() * scale[:, None]
    eye = torch.eye(UNKNOWNS, dtype=torch.float64)
    N = J.transpose(1, 2) @ J + eye
    b = -(J * r.double()[..., None]).sum(1) - off.double() / scale
    M = torch.cat([N, b[..., None], eye.expand_as(N)], dim=2)
    for k in range(UNKNOWNS):
        row = M[:, k : k + 1] / M[:, k : k + 1, k : k + 1]
        M = M - (M[:, :, k : k + 1] - eye[:, k : k + 1]) * row
    x = M[:, :, UNKNOWNS] * scale
    variance = (M[:, :, UNKNOWNS + 1 :] * eye).sum(2) * scale**2
    return x.to(r.dtype), variance.to(r.dtype)

"""Attitudes from rates by parallel prefix products of quaternions, in torch operations that every runtime has."""

import torch
from torch import Tensor


def attitudes(phi: Tensor) -> Tensor:
    """(batch, 3, 3, n) rotation from B in the middle of each step to B in the middle of step n // 2.

    Args:
        phi: (batch, 3, n) rotation vectors of the steps.
    """
    half = quaternion(phi, 0.5)
    one = torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=phi.dtype)[None, :, None].expand(len(phi), 4, phi.shape[2])
    q = torch.cat([one[..., :1], product(half[..., :-1], half[..., 1:])], dim=2)  # from one's middle to the next's
    step = 1
    while step < q.shape[2]:
        q = product(torch.cat([one[..., :step], q[..., :-step]], dim=2), q)
        step *= 2
    R = matrix(q)
    middle = R[..., R.shape[3] // 2]
    return (middle.transpose(1, 2) @ R.flatten(2)).view(R.shape)


def quaternion(phi: Tensor, share: float) -> Tensor:
    """(batch, 4, n) wxyz of a share of rotation vectors (batch, 3, n)."""
    angle = torch.sqrt((phi * phi).sum(1, keepdim=True) + 1e-12)
    half = 0.5 * share * angle
    return torch.cat([torch.cos(half), torch.sin(half) / angle * phi], dim=1)


def product(p: Tensor, q: Tensor) -> Tensor:
    """(batch, 4, n) Hamilton product of quaternions, wxyz: sixteen products, four by four with their signs."""
    first = torch.tensor([0, 1, 2, 3, 0, 1, 2, 3, 0, 2, 3, 1, 0, 3, 1, 2])
    second = torch.tensor([0, 1, 2, 3, 1, 0, 3, 2, 2, 0, 1, 3, 3, 0, 2, 1])
    sign = torch.tensor([1, -1, -1, -1, 1, 1, 1, -1, 1, 1, 1, -1, 1, 1, 1, -1], dtype=p.dtype)
    sums = torch.eye(4, dtype=p.dtype).repeat_interleave(4, dim=1) * sign
    return sums @ (p.index_select(1, first) * q.index_select(1, second))


def matrix(q: Tensor) -> Tensor:
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
    return (rows @ (q.index_select(1, first) * q.index_select(1, second))).view(len(q), 3, 3, q.shape[2])


def cross(a: Tensor, b: Tensor) -> Tensor:
    """(batch, 3, ...): a x b along the second axis."""
    one, two = torch.tensor([1, 2, 0]), torch.tensor([2, 0, 1])
    return a.index_select(1, one) * b.index_select(1, two) - a.index_select(1, two) * b.index_select(1, one)


def skew(a: Tensor) -> Tensor:
    """(batch, 3, 3) with skew(a) @ b = a x b, of (batch, 3)."""
    rows = torch.tensor(
        [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], dtype=a.dtype
    )
    return (a @ rows).view(-1, 3, 3)

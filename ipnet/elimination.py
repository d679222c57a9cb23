"""Linear systems, three unknowns at a time, in torch operations that every runtime has."""

import torch
from torch import Tensor

CYCLIC = ((1, 2), (2, 0), (0, 1))


def eliminated(M: Tensor) -> tuple[Tensor, Tensor]:
    """Take the first three unknowns out of equations (batch, k, c), k <= c, whose square part is symmetric.

    Returns:
        (batch, 3, c - 3) coefficients of the three in the others, and (batch, k - 3, c - 3) equations that are left.
    """
    k, c = M.shape[1:]
    rows, others = M.split([3, k - 3], dim=1)
    pivot, rest = rows.split([3, c - 3], dim=2)
    by_three, left = others.split([3, c - 3], dim=2)
    in_others = inverse(pivot) @ rest
    return in_others, left - by_three @ in_others


def solved(M: Tensor) -> Tensor:
    """(batch, k, c - k) M_1^-1 M_2 of (batch, k, c); M_1, its first k columns, is symmetric, k a multiple of three."""
    k = M.shape[1]
    if k == 3:
        return inverse(M[:, :, :3]) @ M[:, :, 3:]
    in_others, left = eliminated(M)
    others = solved(left)
    return torch.cat([in_others[:, :, k - 3 :] - in_others[:, :, : k - 3] @ others, others], dim=1)


def inverse(M: Tensor) -> Tensor:
    """(batch, 3, 3) of symmetric ones, by cofactors."""
    pairs = [(CYCLIC[i], CYCLIC[j]) for i in range(3) for j in range(3)]
    one = [3 * a + c for (a, _), (c, _) in pairs] + [3 * a + d for (a, _), (_, d) in pairs]
    two = [3 * b + d for (_, b), (_, d) in pairs] + [3 * b + c for (_, b), (c, _) in pairs]
    eye = torch.eye(9, dtype=M.dtype)
    flat = M.flatten(1)
    cofactors = (flat[:, one] * flat[:, two]) @ torch.cat([eye, -eye])
    determinant = (flat * cofactors) @ eye[:, :3].sum(1, keepdim=True)  # along the first row
    return (cofactors / determinant).unflatten(1, (3, 3))

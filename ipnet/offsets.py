"""Offset response: how far an output follows a bias that is added to the input; 1 infers, 0 remembers."""

import numpy as np
from scipy.linalg import hadamard

from navcore.arrays import Floats

OFFSET = (0.02, 0.1)
"""Size of an injected offset [rad/s, m/s^2]."""
_SIGNS = np.asarray(hadamard(8), dtype=np.float64)[:, 1:7]  # (8, 6); every axis balanced against the others
_PATTERNS = np.vstack([_SIGNS, 0.5 * _SIGNS])  # (16, 6); so that not one size alone is asked


def offsets_of(index: int, count: int, size: tuple[float, float] = OFFSET) -> Floats:
    """(2 M, 6) offsets for run `index` of `count`: M patterns with both signs; together the runs cover all sixteen."""
    m = -(-len(_PATTERNS) // count)
    rows = [(index * m + j) % len(_PATTERNS) for j in range(m)]
    patterns = _PATTERNS[rows] * np.repeat(size, 3)
    return np.vstack([patterns, -patterns])


def slope(offsets: Floats, changes: Floats) -> Floats:
    """(6, 6) slope of outputs (row) by offsets (column), by least squares over N changes (N, 6)."""
    solution = np.linalg.lstsq(offsets, changes, rcond=None)[0]
    return np.asarray(solution.T, dtype=np.float64)

import numpy as np
import pytest

from sim.replay.chain import SIZE, Normal, Solution

K, C = 5, 3


@pytest.fixture(scope="module")
def dense() -> tuple[np.ndarray, np.ndarray, Normal]:
    """Random factors between neighbours and of constants, dense and as a chain."""
    rng = np.random.default_rng(1)
    n = K * SIZE + C
    H, g, normal = np.zeros((n, n)), np.zeros(n), Normal.empty(K, C)
    for k in range(K - 1):
        J, r = rng.standard_normal((2 * SIZE + C, 2 * SIZE + C)), rng.standard_normal(2 * SIZE + C)
        where = np.r_[k * SIZE : (k + 2) * SIZE, K * SIZE : n]
        block, right = J.T @ J, J.T @ r
        H[np.ix_(where, where)] += block
        g[where] += right
        a, b, c = slice(0, SIZE), slice(SIZE, 2 * SIZE), slice(2 * SIZE, None)
        normal.own[k] += block[a, a]
        normal.own[k + 1] += block[b, b]
        normal.next[k] += block[b, a]
        normal.border[k] += block[a, c]
        normal.border[k + 1] += block[b, c]
        normal.corner += block[c, c]
        normal.g[k] += right[a]
        normal.g[k + 1] += right[b]
        normal.g_c += right[c]
    return H, g, normal


@pytest.fixture(scope="module")
def solution(dense: tuple[np.ndarray, np.ndarray, Normal]) -> Solution:
    return dense[2].solve()


def test_the_minimum_is_that_of_the_dense_matrix(
    dense: tuple[np.ndarray, np.ndarray, Normal], solution: Solution
) -> None:
    H, g, _ = dense
    got = np.concatenate([solution.knots.ravel(), solution.constants])
    np.testing.assert_allclose(got, np.linalg.solve(H, g), atol=1e-9)


def test_covariances_are_blocks_of_the_dense_inverse(
    dense: tuple[np.ndarray, np.ndarray, Normal], solution: Solution
) -> None:
    P = np.linalg.inv(dense[0])
    blocks = [P[k * SIZE : (k + 1) * SIZE, k * SIZE : (k + 1) * SIZE] for k in range(K)]
    np.testing.assert_allclose(solution.covariances(), blocks, atol=1e-9)
    np.testing.assert_allclose(solution.P_cc, P[K * SIZE :, K * SIZE :], atol=1e-9)

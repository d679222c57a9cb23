import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from eval.alignment import align
from eval.errors import ScoreError
from tests.eval.paths import drifting, flight


def cost(R_WV, p_VB, p_WB):
    """Sum of squares at the best translation for a rotation."""
    moved = p_VB @ R_WV.T
    r = (p_WB - p_WB.mean(axis=0)) - (moved - moved.mean(axis=0))
    return float(np.sum(r**2))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 2.0))
def test_yaw_alignment_is_the_brute_force_minimum(seed, noise):
    rng = np.random.default_rng(seed)
    truth = flight(rng, seconds=20.0)
    p_VB = (
        truth.p_WB @ Rotation.random(rng=rng).as_matrix()
        + rng.normal(0.0, noise, truth.p_WB.shape)
        + rng.normal(0, 9, 3)
    )

    def at(yaw):
        return cost(Rotation.from_euler("z", float(yaw)).as_matrix(), p_VB, truth.p_WB)

    grid = np.linspace(-np.pi, np.pi, 73)
    best = minimize(lambda x: at(x[0]), [grid[np.argmin([at(y) for y in grid])]], method="Nelder-Mead")
    found = align(p_VB, truth.p_WB)
    assert cost(found.R_WV, p_VB, truth.p_WB) <= best.fun * (1.0 + 1e-9)
    np.testing.assert_allclose(found.R_WV[2], [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose((p_VB @ found.R_WV.T + found.p_WV).mean(axis=0), truth.p_WB.mean(axis=0), atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_se3_alignment_is_scipys(seed):
    rng = np.random.default_rng(seed)
    truth = flight(rng)
    R_VW = Rotation.random(rng=rng)
    p_VB = truth.p_WB @ R_VW.as_matrix().T + rng.normal(0.0, 0.3, truth.p_WB.shape)
    oracle, _ = Rotation.align_vectors(truth.p_WB - truth.p_WB.mean(axis=0), p_VB - p_VB.mean(axis=0))
    np.testing.assert_allclose(align(p_VB, truth.p_WB, "se3").R_WV, oracle.as_matrix(), atol=1e-9)


def test_a_mirrored_path_still_gets_a_rotation():
    truth = flight(np.random.default_rng(1))
    assert np.linalg.det(align(truth.p_WB * [1.0, 1.0, -1.0], truth.p_WB, "se3").R_WV) == pytest.approx(1.0)


def test_applying_it_moves_everything_that_lives_in_the_world_and_nothing_else():
    rng = np.random.default_rng(2)
    truth = flight(rng)
    estimate = drifting(truth, rng, sigma=0.0)
    moved = align(estimate.p_WB, truth.p_WB).apply(estimate)
    np.testing.assert_allclose(moved.p_WB, truth.p_WB, atol=1e-9)
    np.testing.assert_allclose(moved.v_WB, truth.v_WB, atol=1e-9)
    np.testing.assert_allclose(moved.R_WB, truth.R_WB, atol=1e-9)
    np.testing.assert_array_equal(moved.b_a, estimate.b_a)


def test_what_cannot_be_aligned_is_said():
    p = np.zeros((3, 3))
    with pytest.raises(ScoreError, match=r"\(3, 3\) and \(2, 3\)"):
        align(p, p[:2])
    with pytest.raises(ScoreError, match="N > 0"):
        align(p[:0], p[:0])
    with pytest.raises(ScoreError, match="'sim3' is unknown; known are yaw, se3, none"):
        align(p, p, "sim3")

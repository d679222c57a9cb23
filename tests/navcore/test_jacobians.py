import numpy as np
import pytest
from jacobians import assert_jacobian
from scipy.spatial.transform import Rotation

A = np.array([[1.0, 2.0, -3.0], [0.5, 0.0, 4.0]])


def test_the_right_derivative_passes():
    assert_jacobian(lambda x: A @ x, np.ones(3), A)
    assert_jacobian(lambda x: A @ np.sin(x), np.ones(3), A * np.cos(1.0))


@pytest.mark.parametrize("place", [(0, 0), (1, 1), (1, 2)])
def test_one_wrong_entry_fails(place):
    wrong = A.copy()
    wrong[place] += 1e-5
    with pytest.raises(AssertionError):
        assert_jacobian(lambda x: A @ x, np.ones(3), wrong)


def test_differences_are_taken_on_the_manifold():
    R, p = Rotation.from_rotvec([0.3, -0.2, 0.5]), np.array([1.0, 2.0, 3.0])

    hat = np.array([[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]])
    J = -R.as_matrix() @ hat  # d(R Exp(d) p)/dd

    def turned(R, d):
        return R * Rotation.from_rotvec(d)

    assert_jacobian(lambda R: R.apply(p), R, J, retract=turned)
    with pytest.raises(AssertionError):
        assert_jacobian(lambda R: R.apply(p), R, -J, retract=turned)

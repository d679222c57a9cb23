import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jacobians import assert_jacobian
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from navcore import so3

# Near the identity, at the switch to the series, anywhere, near pi.
ANGLES = (
    st.sampled_from([0.0, 1e-12, 1e-7, 1e-4, 9.99e-4, 1.001e-3, 1e-2])
    | st.floats(0.0, np.pi)
    | st.floats(1e-9, 1e-3).map(lambda x: np.pi - x)
)
DIRECTIONS = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)
VECTORS = st.builds(lambda a, v: a * v / np.linalg.norm(v), ANGLES, DIRECTIONS)
TANGENT = st.tuples(*[st.floats(-6.0, 6.0)] * 3).map(np.array)
UNIFORM = st.integers(0, 2**32 - 1).map(lambda s: Rotation.random(rng=np.random.default_rng(s)).as_matrix())


def retract(R, d):
    return R @ expm(so3.hat(d))


def local(R0, R):
    return Rotation.from_matrix(R0.T @ R).as_rotvec()


@given(VECTORS | TANGENT)
def test_exp_is_the_matrix_exponential(phi):
    np.testing.assert_allclose(so3.exp(phi), expm(so3.hat(phi)), atol=1e-13)


@given(UNIFORM)
def test_log_inverts_exp_on_the_whole_group(R):
    phi = so3.log(R)
    assert np.linalg.norm(phi) <= np.pi + 1e-12
    np.testing.assert_allclose(so3.exp(phi), R, atol=1e-13)


@given(VECTORS)
def test_exp_then_log_gives_the_vector_back(phi):
    # At pi itself, v and -v are the same rotation.
    back = so3.log(so3.exp(phi))
    assert min(np.linalg.norm(back - phi), np.linalg.norm(back + phi)) < 1e-7
    if np.linalg.norm(phi) < np.pi - 1e-6:
        np.testing.assert_allclose(back, phi, atol=1e-9)


@given(VECTORS | TANGENT)
def test_left_jacobian_is_the_integral_of_the_exponential(phi):
    block = np.zeros((6, 6))  # expm([[K, I], [0, 0]]) holds the integral of exp(s K) over 0..1
    block[:3, :3], block[:3, 3:] = so3.hat(phi), np.eye(3)
    np.testing.assert_allclose(so3.left_jacobian(phi), expm(block)[:3, 3:], atol=1e-12)


@given(VECTORS)
def test_right_jacobian_against_differences(phi):
    assert_jacobian(so3.exp, phi, so3.right_jacobian(phi), local=local)


@given(VECTORS)
def test_left_jacobian_against_differences(phi):
    def in_world(R0, R):
        return local(R0.T, R.T) * -1.0

    assert_jacobian(so3.exp, phi, so3.left_jacobian(phi), local=in_world)


@given(VECTORS.filter(lambda v: np.linalg.norm(v) < 3.0))
def test_inverse_jacobian_against_differences_of_log(phi):
    assert_jacobian(so3.log, so3.exp(phi), so3.right_jacobian_inverse(phi), retract=retract, rtol=1e-5)


@given(VECTORS)
def test_inverse_jacobians_are_inverse(phi):
    np.testing.assert_allclose(so3.right_jacobian_inverse(phi) @ so3.right_jacobian(phi), np.eye(3), atol=1e-9)
    np.testing.assert_allclose(so3.left_jacobian_inverse(phi) @ so3.left_jacobian(phi), np.eye(3), atol=1e-9)


@given(UNIFORM)
def test_quaternions_are_scipys(R):
    q = so3.to_quaternion(R)
    np.testing.assert_allclose(q, Rotation.from_matrix(R).as_quat(canonical=True), atol=1e-15)
    np.testing.assert_allclose(so3.from_quaternion(-2.0 * q), R, atol=1e-14)


@given(TANGENT, TANGENT)
def test_hat_is_the_cross_product(v, u):
    np.testing.assert_allclose(so3.hat(v) @ u, np.cross(v, u), atol=1e-12)
    np.testing.assert_array_equal(so3.vee(so3.hat(v)), v)


@given(UNIFORM)
def test_normalise_brings_a_matrix_back_to_the_group(R):
    noise = 1e-5 * np.sin(np.arange(9.0)).reshape(3, 3)
    back = so3.normalise(R + noise)
    assert np.abs(back @ back.T - np.eye(3)).max() < 1e-8
    u, _, vt = np.linalg.svd(R + noise)  # the nearest rotation
    np.testing.assert_allclose(back, u @ vt, atol=1e-8)


@pytest.mark.parametrize("shape", [(), (4,), (2, 3), (0,)])
def test_batches_are_the_single_results(shape):
    phi = np.random.default_rng(1).normal(size=(*shape, 3))
    for f in (so3.exp, so3.hat, so3.right_jacobian, so3.left_jacobian, so3.right_jacobian_inverse):
        batch = f(phi)
        assert batch.shape == (*shape, 3, 3)
        for k in np.ndindex(*shape):
            np.testing.assert_allclose(batch[k], f(phi[k]), atol=1e-15)
    R = so3.exp(phi)
    assert so3.log(R).shape == (*shape, 3)
    assert so3.to_quaternion(R).shape == (*shape, 4)
    assert so3.from_quaternion(so3.to_quaternion(R)).shape == (*shape, 3, 3)

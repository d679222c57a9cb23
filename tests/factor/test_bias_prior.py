"""The prior's factors: the paper's equations, and what is believed of a prior that errs."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, C
from jacobians import assert_jacobian

from factor.bias_prior import BiasFactors, PriorError, modelled_factor, paper_factor
from factor.border import bias_of, swapped
from factor.config import PriorConfig
from navcore.imu import ImuNoise
from navcore.prior import BiasPrior

NOISE = ImuNoise(1.7e-4, 1.9e-5, 2.0e-3, 3.0e-3, 200.0)
B_HAT = BiasPrior(0, np.array([0.01, -0.02, 0.03]), np.array([0.1, 0.2, -0.3]), np.diag([1e-4] * 3 + [4e-2] * 3))
WEIGHT = 50.0


def at(b_g, b_a, minus_c=None):
    values = gtsam.Values()
    values.insert(B(0), bias_of(np.asarray(b_g), np.asarray(b_a)))
    if minus_c is not None:
        values.insert(C(0), bias_of(*np.split(minus_c, 2)))
    return values


def test_the_papers_residual_and_jacobian():
    """Yi et al., eqs. 5 and 6: W [b_a - b_a_hat; b_g - b_g_hat], and W I."""
    factor = paper_factor(0, B_HAT, WEIGHT)
    b_g, b_a = np.array([0.02, 0.01, 0.0]), np.array([0.3, 0.1, 0.1])
    expected = WEIGHT * np.concatenate([b_a - B_HAT.b_a, b_g - B_HAT.b_g])
    values = at(b_g, b_a)
    np.testing.assert_allclose(factor.whitenedError(values), expected)
    assert factor.error(values) == pytest.approx(0.5 * expected @ expected)
    J, minus_r = factor.linearize(values).jacobian()
    np.testing.assert_allclose(J, WEIGHT * np.eye(6))
    np.testing.assert_allclose(minus_r, -expected)
    assert_jacobian(lambda x: factor.whitenedError(at(x[3:], x[:3])), np.concatenate([b_a, b_g]), J)


def test_a_measurement_is_of_the_bias_and_the_priors_error():
    factor = modelled_factor(0, B_HAT, B_HAT.covariance)
    b, c = np.array([0.0, 0.0, 0.02, 0.1, 0.1, 0.0]), np.array([0.01, -0.02, 0.01, 0.0, 0.1, -0.3])
    assert factor.error(at(b[:3], b[3:], -c)) == pytest.approx(0.0, abs=1e-20)  # b + c is what was said
    off = np.array([0.02, 0.0, 0.0, 0.0, 0.4, 0.0])  # two standard deviations each
    assert factor.error(at(b[:3], b[3:], -c + off)) == pytest.approx(0.5 * 8.0)


def test_repeated_measurements_never_know_more_than_the_priors_error_allows():
    sigma_c = np.repeat([0.003, 0.05], 3)
    error = PriorError(np.zeros(6), np.zeros((6, 6)), np.diag(sigma_c**2))
    factors, values, start = BiasFactors(PriorConfig(student_dof=1e9), NOISE, error), at([0] * 3, [0] * 3), 1e3
    graph = gtsam.NonlinearFactorGraph()
    factors.begin(values, graph, np.eye(6) * start**2)
    graph.push_back(
        gtsam.PriorFactorConstantBias(B(0), bias_of(*np.zeros((2, 3))), gtsam.noiseModel.Isotropic.Sigma(6, start))
    )
    z = BiasPrior(0, B_HAT.b_g, B_HAT.b_a, np.diag(np.repeat([1e-6, 1e-4], 3)))
    factors.hear([z] * 400, 0, values, 0)
    graph.push_back(factors.graph())
    solved = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    P = gtsam.Marginals(graph, solved).marginalCovariance(B(0))
    np.testing.assert_allclose(swapped(np.sqrt(np.diagonal(P))), sigma_c, rtol=0.01)
    np.testing.assert_allclose(swapped(solved.atConstantBias(B(0)).vector()), z.vector, rtol=1e-3)


def test_what_the_start_knew_of_both_is_kept():
    """c follows the biases where a prior has set them: their covariance is -Sigma_c then."""
    P_bb, P_cc = np.diag(np.repeat([4e-4, 9e-2], 3)), np.diag(np.repeat([1e-4, 2e-2], 3))
    P_cb = -0.5 * P_cc
    gain = P_cb @ np.linalg.inv(P_bb)
    c = np.array([0.01, 0.0, -0.01, 0.1, 0.0, -0.1])
    factors = BiasFactors(PriorConfig(), NOISE, PriorError(c, gain, P_cc - gain @ P_cb.T))
    values, graph = at([0.01] * 3, [0.1] * 3), gtsam.NonlinearFactorGraph()
    factors.begin(values, graph, P_bb)
    noise = gtsam.noiseModel.Gaussian.Covariance(swapped(P_bb))
    graph.push_back(gtsam.PriorFactorConstantBias(B(0), values.atConstantBias(B(0)), noise))
    joint = gtsam.Marginals(graph, values).jointMarginalCovariance([B(0), C(0)])
    np.testing.assert_allclose(swapped(values.atConstantBias(C(0)).vector()), -c)
    np.testing.assert_allclose(joint.at(C(0), C(0)), swapped(P_cc), atol=1e-12)
    np.testing.assert_allclose(joint.at(C(0), B(0)), -swapped(P_cb), atol=1e-12)


def test_a_surprise_weighs_less():
    factors, values = BiasFactors(PriorConfig(), NOISE, None), at([0] * 3, [0] * 3)
    near, far = (BiasPrior(0, np.full(3, x), np.zeros(3), np.eye(6) * 1e-4) for x in (0.005, 0.2))
    factors.hear([near, far], 0, values, 0)
    first, second = factors.graph().at(0), factors.graph().at(1)
    own = [np.linalg.norm(f.linearize(values).jacobian()[0], ord=2) for f in (first, second)]
    assert own[0] == pytest.approx(100.0) and own[1] < 15.0


def test_the_plain_mode_puts_what_was_said_last_on_every_keyframe():
    factors = BiasFactors(PriorConfig(mode="plain", weight=WEIGHT), NOISE, None)
    factors.keyframe(0)
    assert factors.graph().size() == 0
    factors.hear([B_HAT], 0, at([0] * 3, [0] * 3), 0)
    for k in (1, 2):
        factors.keyframe(k)
    assert factors.graph().size() == 2
    assert factors.leave(1).size() == 1 and factors.graph().size() == 1


def test_samples_may_be_integrated_at_what_was_said():
    estimate = gtsam.imuBias.ConstantBias()
    for mode, expected in (("estimate", np.zeros(6)), ("prior", B_HAT.vector)):
        factors = BiasFactors(PriorConfig(preintegration=mode), NOISE, None)
        np.testing.assert_array_equal(factors.integrated_at(estimate).vector(), np.zeros(6))
        factors.hear([B_HAT], 0, at([0] * 3, [0] * 3), 0)
        np.testing.assert_array_equal(swapped(factors.integrated_at(estimate).vector()), expected)


def test_the_first_measurement_after_a_start_is_no_surprise_that_the_start_explains():
    factors, values = BiasFactors(PriorConfig(), NOISE, None), at([0] * 3, [0] * 3)
    factors.begin(values, gtsam.NonlinearFactorGraph(), np.eye(6) * 0.3**2)
    z = BiasPrior(0, np.zeros(3), np.full(3, 0.3), np.eye(6) * 0.02**2)
    factors.hear([z], 0, values, 0)
    weight = np.linalg.norm(factors.graph().at(0).linearize(values).jacobian()[0], ord=2)
    assert weight == pytest.approx(1.0 / 0.02)

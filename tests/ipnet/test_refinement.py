"""Refinement by dead reckoning: attitudes, derivatives, the solver, and what it finds in a flight."""

from dataclasses import replace

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from ipnet.dataset import regular_windows
from ipnet.presets import BLOCK
from ipnet.refinement import (
    Belief,
    MotionModel,
    attitudes,
    block_means,
    cross,
    from_middle,
    jacobian,
    product,
    refine,
    solve,
)
from ipnet.regression import relations
from navcore.imu import GRAVITY
from tests.ipnet.flying import DRAG, SMALL, flight

DT = 1.0 / SMALL.rate_hz


def test_quaternions_multiply_as_scipys():
    p, q = Rotation.random(2, rng=np.random.default_rng(1))
    wxyz = [torch.from_numpy(np.roll(r.as_quat(), 1))[None] for r in (p, q)]
    expected = np.roll((p * q).as_quat(), 1)
    np.testing.assert_allclose(product(*wxyz)[0], expected, atol=1e-12)


def test_attitudes_are_products_of_turns_seen_from_the_middle():
    omega = torch.randn(1, 3, 64, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    phi = omega[0].T.numpy() * DT
    before = np.vstack([phi[:1], phi[:-1]])
    turns = Rotation.from_rotvec(phi + np.cross(before, phi) / 12.0)
    after = [Rotation.identity()]
    for turn in turns:
        after.append(after[-1] * turn)
    half = Rotation.from_rotvec(-0.5 * turns.as_rotvec())
    expected = [(after[32].inv() * after[k + 1] * half[k]).as_matrix() for k in range(64)]
    np.testing.assert_allclose(attitudes(omega, DT)[0].permute(2, 0, 1), expected, atol=1e-6)


def test_the_solver_is_least_squares():
    rng = np.random.default_rng(2)
    J, r = rng.normal(size=(40, 12)) * np.logspace(-2, 2, 12), rng.normal(size=40)
    information, off = np.logspace(-1, 3, 12), rng.normal(size=12)
    x, variance = solve(*(torch.from_numpy(a)[None] for a in (J, r, information, off)))
    N = J.T @ J + np.diag(information)
    np.testing.assert_allclose(x[0], -np.linalg.solve(N, J.T @ r + information * off), rtol=1e-8)
    np.testing.assert_allclose(variance[0], np.diagonal(np.linalg.inv(N)), rtol=1e-8)


def test_regression_finds_the_drag():
    found = relations(regular_windows([flight(k) for k in range(3)], SMALL, 2.0))
    assert found is not None
    np.testing.assert_allclose(found.A[:2, :2], DRAG * np.eye(2), atol=0.01)
    np.testing.assert_allclose(found.C[:2], 0.0, atol=0.01)


def test_integrals_run_from_the_middle():
    ones = torch.ones(1, 3, 8, dtype=torch.float64)
    np.testing.assert_allclose(from_middle(ones, 0.5)[0, 0], 0.5 * (np.arange(8) + 0.5) - 2.0, atol=1e-12)


def test_the_derivative_is_that_of_dead_reckoning():
    rng = torch.Generator().manual_seed(3)
    windows = regular_windows([flight(4)], SMALL, 9.0)
    samples = torch.stack([windows[k][0] for k in range(2)]).double().transpose(1, 2)
    A, B, C = torch.randn(3, 2, 3, generator=rng, dtype=torch.float64)
    model = MotionModel(A, B, C, *torch.ones(2, 2, 2, SMALL.samples // BLOCK, dtype=torch.float64))
    up = torch.tensor([[0.0, 0.0, -GRAVITY]], dtype=torch.float64).expand(2, 3)

    def at(x):
        omega, f = samples[:, :3] - x[:, 6:9, None], samples[:, 3:] - x[:, 9:, None]
        R = attitudes(omega, DT)
        f_M = (R * f[:, None]).sum(2)
        gravity = up + cross(x[:, :3], up)
        v_M = from_middle(f_M + gravity[..., None], DT) + 1.0 + x[:, 3:6, None]
        v_B = (R * v_M[:, :, None]).sum(1)
        r = A @ block_means(v_B) + B @ block_means(f) + C @ block_means(omega)
        return r, jacobian(R, f_M, v_M, gravity, DT, model)

    J = at(torch.zeros(2, 12, dtype=torch.float64))[1]
    for k in range(12):
        step = torch.zeros(2, 12, dtype=torch.float64)
        step[:, k] = 1e-6
        numeric = (at(step)[0] - at(-step)[0]) / 2e-6
        assert (numeric - J[:, :, k]).abs().mean() < 0.05 * numeric.abs().mean() + 1e-3  # J is of blocks' middles


def test_regression_is_not_misled_by_what_is_no_flight():
    flights = [flight(k) for k in range(3)]
    still = flights[2]
    tilted = still.imu.accel + 3.0 * (np.arange(len(still.imu)) < 1000)[:, None]
    flights[2] = replace(still, imu=replace(still.imu, accel=tilted))
    found = relations(regular_windows(flights, SMALL, 2.0))
    assert found is not None
    np.testing.assert_allclose(found.A[:2, :2], DRAG * np.eye(2), atol=0.02)
    assert found.weight[:2].min() > 5.0


def test_regression_needs_velocities():
    track = flight(1)
    blind = replace(track, velocity=np.full_like(track.velocity, np.nan))
    assert relations(regular_windows([blind], SMALL, 2.0)) is None


def test_a_flight_with_known_drag_reveals_its_biases():
    bias = np.array([0.02, -0.03, 0.01, 0.05, -0.04, 0.1])
    windows = regular_windows([flight(5, bias=bias)], SMALL, 5.0)
    samples = torch.stack([windows[k][0] for k in range(len(windows))]).transpose(1, 2)
    n, blocks = len(samples), SMALL.samples // BLOCK
    eye = torch.eye(3)[:2]
    model = MotionModel(DRAG * eye, eye, torch.zeros(2, 3), torch.zeros(n, 2, blocks), torch.full((n, 2, blocks), 30.0))
    unsure = torch.tensor([0.05, 0.05, 0.05, 0.3, 0.3, 0.3]) ** 2
    first = Belief(torch.zeros(n, 6), unsure.expand(n, 6), None, torch.zeros(n, 3))
    now = first
    for reach in (0.3, 0.6, 0.0, 0.0):
        now = refine(samples, DT, first, now, model.within(reach))
    error = (now.bias - torch.from_numpy(bias).float()).abs()
    assert error[:, :2].max() < 5e-3
    assert (error < 5.0 * now.variance.sqrt() + 1e-3).all()

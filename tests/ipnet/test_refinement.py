"""Refinement by dead reckoning: attitudes, steps, derivatives, the solver, and what it finds in a flight."""

from dataclasses import replace

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from ipnet.attitudes import attitudes, cross, product, skew
from ipnet.dataset import regular_windows
from ipnet.elimination import eliminated, inverse, solved
from ipnet.presets import BLOCK, STEP
from ipnet.refinement import Belief, MotionModel, block_means, from_middle, jacobian, refine, times
from ipnet.regression import relations
from ipnet.steps import condensed
from navcore.imu import GRAVITY
from tests.ipnet.flying import DRAG, SMALL, flight

DT = 1.0 / SMALL.rate_hz
UP = torch.tensor([[0.0, 0.0, -GRAVITY]], dtype=torch.float64)


def test_quaternions_multiply_as_scipys():
    p, q = Rotation.random(2, rng=np.random.default_rng(1))
    wxyz = [torch.from_numpy(np.roll(r.as_quat(), 1))[None, :, None] for r in (p, q)]
    expected = np.roll((p * q).as_quat(), 1)
    np.testing.assert_allclose(product(*wxyz)[0, :, 0], expected, atol=1e-12)


def test_a_matrix_stands_for_the_cross_product():
    a, b = torch.randn(2, 5, 3, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close((skew(a) @ b[..., None])[..., 0], torch.linalg.cross(a, b))
    torch.testing.assert_close(cross(a, b), torch.linalg.cross(a, b))


def test_attitudes_are_products_of_turns_seen_from_the_middle_step():
    phi = torch.randn(1, 3, 24, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    turns = Rotation.from_rotvec(phi[0].T.numpy())
    half = Rotation.from_rotvec(0.5 * phi[0].T.numpy())
    begin = [Rotation.identity()]
    for turn in turns:
        begin.append(begin[-1] * turn)
    middles = [begin[k] * half[k] for k in range(24)]
    expected = [(middles[12].inv() * middle).as_matrix() for middle in middles]
    np.testing.assert_allclose(attitudes(phi)[0].permute(2, 0, 1), expected, atol=1e-6)


def test_steps_turn_and_push_as_their_samples_do():
    rng = np.random.default_rng(3)
    t = np.arange(8 * STEP) * DT
    omega = 1.5 * np.sin(rng.uniform(0.5, 2.0, 3) * t[:, None] + rng.uniform(0.0, 6.0, 3))
    force = np.array([0.0, 0.0, GRAVITY]) + np.sin(rng.uniform(0.5, 2.0, 3) * t[:, None] + rng.uniform(0.0, 6.0, 3))
    bias = torch.from_numpy(rng.normal(size=(1, 6)) * 0.1)
    window = torch.from_numpy(np.hstack([omega, force]).T[None]) + bias[..., None]
    steps = (condensed(window, bias, DT) - bias[..., None])[0].T.numpy()

    def way(omega, force, dt, fine):
        R, v = Rotation.identity(), np.zeros(3)
        for w, f in zip(np.repeat(omega, fine, axis=0), np.repeat(force, fine, axis=0), strict=True):
            v = v + (R * Rotation.from_rotvec(0.5 * w * dt / fine)).apply(f) * dt / fine
            R = R * Rotation.from_rotvec(w * dt / fine)
        return R, v

    R, v = way(omega, force, DT, 10)
    R_steps, v_steps = way(steps[:, :3], steps[:, 3:], STEP * DT, 1)
    R_plain, v_plain = way(*np.split(np.hstack([omega, force]).reshape(-1, STEP, 6).mean(1), 2, axis=1), STEP * DT, 1)
    assert (R.inv() * R_steps).magnitude() < 2e-3 < 0.5 * (R.inv() * R_plain).magnitude()
    assert np.linalg.norm(v_steps - v) < 0.01 < 0.2 * np.linalg.norm(v_plain - v)


def test_elimination_solves_what_is_left():
    rng = np.random.default_rng(2)
    A = rng.normal(size=(40, 12)) * np.logspace(-2, 2, 12)
    M = np.hstack([A.T @ A, rng.normal(size=(12, 4))])
    x = np.linalg.solve(M[:, :12], M[:, 12:])
    np.testing.assert_allclose(solved(torch.from_numpy(M)[None])[0], x, rtol=1e-6)
    in_others, left = eliminated(torch.from_numpy(M)[None])
    np.testing.assert_allclose(np.linalg.solve(left[0, :, :9], left[0, :, 9:]), x[3:], rtol=1e-6)
    rest = in_others[0].numpy()
    np.testing.assert_allclose(rest[:, 9:] - rest[:, :9] @ x[3:], x[:3], rtol=1e-6)
    small = torch.from_numpy(M[None, 9:, 9:12])
    np.testing.assert_allclose(inverse(small)[0], np.linalg.inv(small[0]), rtol=1e-8)


def test_regression_finds_the_drag():
    found = relations(regular_windows([flight(k) for k in range(3)], SMALL, 2.0))
    assert found is not None
    np.testing.assert_allclose(found.A[:2, :2], DRAG * np.eye(2), atol=0.01)
    np.testing.assert_allclose(found.C[:2], 0.0, atol=0.01)


def test_integrals_run_from_the_middle_step():
    ones = torch.ones(1, 3, 8, dtype=torch.float64)
    np.testing.assert_allclose(from_middle(ones, 0.5)[0, 0], 0.5 * (np.arange(8) - 4.0), atol=1e-12)
    np.testing.assert_allclose(times(ones, 0.5), 0.5 * (np.arange(8) - 4.0), atol=1e-12)
    np.testing.assert_allclose(from_middle(ones, 0.5, 0.2)[0, 0], 0.5 * (np.arange(8) - 4.0) + 0.2, atol=1e-12)


def test_the_derivative_is_that_of_dead_reckoning():
    rng = torch.Generator().manual_seed(3)
    windows = regular_windows([flight(4)], SMALL, 9.0)
    samples = torch.stack([windows[k][0] for k in range(2)]).double().transpose(1, 2)
    steps, dt = condensed(samples, torch.zeros(2, 6, dtype=torch.float64), DT), STEP * DT
    A, B, C = torch.randn(3, 2, 3, generator=rng, dtype=torch.float64)
    model = MotionModel(A, B, C, *torch.ones(2, 2, 2, SMALL.samples // BLOCK, dtype=torch.float64))

    def at(x):
        omega, f = steps[:, :3] - x[:, 6:9, None], steps[:, 3:] - x[:, 9:, None]
        R = attitudes(omega * dt)
        f_M = (R * f[:, None]).sum(2)
        gravity = UP + cross(x[:, :3], UP.expand(2, 3))
        v_M = from_middle(f_M, dt) + gravity[..., None] * times(f_M, dt) + 1.0 + x[:, 3:6, None]
        v_B = (R * v_M[:, :, None]).sum(1)
        r = block_means(A @ v_B + B @ f + C @ omega)
        return r, jacobian(R, f_M, v_M, gravity, dt, model)

    J = at(torch.zeros(2, 12, dtype=torch.float64))[1]
    for k in range(12):
        step = torch.zeros(2, 12, dtype=torch.float64)
        step[:, k] = 1e-6
        numeric = (at(step)[0] - at(-step)[0]) / 2e-6
        assert (numeric - J[:, :, k]).abs().mean() < 0.06 * numeric.abs().mean() + 1e-3  # J is of means over blocks


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


BIAS = np.array([0.02, -0.03, 0.01, 0.05, -0.04, 0.1])


def refined(pieces, unsure, seconds=30.0):
    """What refinements say of a flight with known drag, and how it is wrong."""
    windows = regular_windows([flight(5, seconds=seconds, bias=BIAS)], SMALL, 5.0)
    samples = torch.stack([windows[k][0] for k in range(len(windows))]).transpose(1, 2)
    n, blocks = len(samples), SMALL.samples // BLOCK
    A, B = torch.zeros(5, 3), torch.zeros(5, 3)
    A[:2, :2], B[:2, :2], A[2:] = DRAG * torch.eye(2), torch.eye(2), torch.eye(3)
    w = torch.tensor([30.0, 30.0, 0.3, 0.3, 0.3])[None, :, None].expand(n, 5, blocks)
    model = MotionModel(A, B, torch.zeros(5, 3), torch.zeros(n, 5, blocks), w)
    first = Belief(torch.zeros(n, 6), torch.tensor(unsure).expand(n, 6) ** 2)
    now = first
    for count in pieces:
        now = refine(condensed(samples, now.bias, DT), STEP * DT, first, now, model, count)
    return now, (now.bias - torch.from_numpy(BIAS).float()).abs()


def test_a_flight_with_known_drag_reveals_its_biases():
    now, error = refined((2, 1, 1, 1), [0.05, 0.05, 0.05, 0.3, 0.3, 0.3])
    assert error[:, :2].max() < 7e-3
    assert (error < 5.0 * now.variance.sqrt() + 1e-3).all()


def test_pieces_have_gravities_and_velocities_of_their_own():
    now, error = refined((3,), [0.05, 0.05, 0.05, 0.3, 0.3, 0.3])
    assert now.gravity.shape == now.velocity.shape == (3 * len(error), 3)
    torch.testing.assert_close(now.gravity.norm(dim=1), torch.full((3 * len(error),), GRAVITY))
    _, whole = refined((1,), [0.05, 0.05, 0.05, 0.3, 0.3, 0.3])
    assert error[:, :2].mean() < 0.02  # saying nothing: 0.025; little is known from a few seconds
    assert whole[:, :2].mean() < error[:, :2].mean()

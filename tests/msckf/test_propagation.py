"""Propagation against differences on the manifold, against van Loan, and against simulated flights."""

import numpy as np
import pytest
from filterpy.common import van_loan_discretization
from jacobians import assert_jacobian
from scipy.linalg import block_diag, expm
from scipy.spatial.transform import Rotation

from msckf.propagation import Increment, _integrals, _steps, integrate, noise_in_world, predict, transition
from navcore import so3
from navcore.imu import ImuNoise
from navcore.imu_buffer import Cells, ImuBuffer
from sim.imu import exact_imu
from sim.motion import EPOCH_NS
from sim.platforms import DIFFICULTIES, PLATFORMS, simulate_motion

NOISE = ImuNoise(1.7e-4, 1.9e-5, 2.0e-3, 3.0e-3, 200.0)
BLOCKS = [slice(k, k + 3) for k in range(0, 15, 3)]


def random_cells(n=11, seed=0, rate=1.5, dt=0.005):
    rng = np.random.default_rng(seed)
    widths = np.full(n, dt)
    widths[0], widths[-1] = 0.3 * dt, 0.6 * dt
    force = np.array([0.3, -0.2, 9.8]) + rng.standard_normal((n, 3))
    return Cells(widths, rate * rng.standard_normal((n, 3)), force, np.zeros(n))


def random_state(seed=0):
    rng = np.random.default_rng(seed)
    return (
        Rotation.random(rng=rng).as_matrix(),
        rng.standard_normal(3),
        rng.standard_normal(3),
        0.02 * rng.standard_normal(3),
        0.1 * rng.standard_normal(3),
    )


def retract(state, d):
    """(R, p, v, b_g, b_a) moved by an error (15,)."""
    R, *rest = state
    return (R @ Rotation.from_rotvec(d[:3]).as_matrix(), *(x + d[3 * k + 3 : 3 * k + 6] for k, x in enumerate(rest)))


def local(a, b):
    """The error (15,) from one state to another."""
    turn = Rotation.from_matrix(a[0].T @ b[0]).as_rotvec()
    return np.concatenate([turn, *(y - x for x, y in zip(a[1:], b[1:], strict=True))])


def assert_blocks(f, x, J, rtol):
    """Every 3x3 block against differences, to `rtol` of the block's own largest entry."""
    for j, columns in enumerate(BLOCKS[: J.shape[1] // 3]):

        def moved(x, d, columns=columns):
            whole = np.zeros(15)
            whole[columns] = d
            return retract(x, whole)

        for i, rows in enumerate(BLOCKS[: J.shape[0] // 3]):
            try:
                assert_jacobian(f, x, J[rows, columns], moved, lambda a, b, rows=rows: local(a, b)[rows], rtol, 1e-10)
            except AssertionError as error:
                raise AssertionError(f"block ({i}, {j})") from error


@pytest.mark.parametrize("angle", [0.0, 1e-6, 9.99e-3, 1.001e-2, 0.5, 3.0])
def test_integrals_of_a_turn_against_the_matrix_exponential(angle):
    """expm([[A, I, 0], [0, 0, I], [0, 0, 0]]) holds exp(A), its mean and its double integral, on both sides of the
    angle at which series take over."""
    phi = angle * np.array([0.6, -0.48, 0.64])
    block = np.zeros((9, 9))
    block[0:3, 0:3], block[0:3, 3:6], block[3:6, 6:9] = so3.hat(phi), np.eye(3), np.eye(3)
    whole = expm(block)
    for found, k in zip(_integrals(phi[None]), range(0, 9, 3), strict=True):
        np.testing.assert_allclose(found[0], whole[0:3, k : k + 3], rtol=0, atol=1e-11)


def test_the_transition_of_one_cell():
    """State in the body at the cell's start: rotation increment, position, velocity (gravity left out), biases."""
    dt, gyro, accel = np.array([0.005]), np.array([[1.5, -2.0, 0.7]]), np.array([[1.0, -0.5, 9.5]])

    def step(state):
        R, p, v, b_g, b_a = state
        E, dv, dp, _ = _steps(dt, gyro - b_g, accel - b_a)
        return R @ E[0], p + v * dt[0] + R @ dp[0], v + R @ dv[0], b_g, b_a

    start = (np.eye(3), np.zeros(3), np.zeros(3), np.full(3, 0.01), np.full(3, -0.05))
    F = _steps(dt, gyro - start[3], accel - start[4])[3][0]
    assert_blocks(step, start, F, rtol=1e-4)  # the cell turns by .013 rad, and F leaves out orders beyond the square


@pytest.mark.parametrize("n", [1, 2, 11, 60])
def test_the_increments_by_the_biases(n):
    cells = random_cells(n)

    def increments(state):
        inc = integrate(cells, state[3], state[4], NOISE)
        return inc.delta_R, inc.delta_p, inc.delta_v, state[3], state[4]

    state = random_state()
    J = np.zeros((9, 15))
    J[:, 9:15] = integrate(cells, state[3], state[4], NOISE).J
    assert_blocks(increments, state, J, rtol=1e-4)


@pytest.mark.parametrize("n", [1, 11, 60])
@pytest.mark.parametrize("seed", range(3))
def test_the_transition_between_frames(n, seed):
    """All fifteen columns, by moving the start on the manifold and integrating again."""
    cells, start = random_cells(n, seed), random_state(seed)

    def flow(state):
        return (*predict(*state[:3], integrate(cells, *state[3:], NOISE)), *state[3:])

    inc = integrate(cells, *start[3:], NOISE)
    Phi = transition(inc, start[:3], predict(*start[:3], inc))
    assert_blocks(flow, start, Phi, rtol=1e-4)


def continuous(omega, force, noise, seconds, R_0):
    """Phi and Q of the error dynamics at constant rate and force, by van Loan, with p and v in W.

    With errors of p and v turned into the body the dynamics do not depend on time:
    dtheta' = -[w]dtheta - db_g - n_g; dp' = -[w]dp + dv; dv' = -[w]dv - [f]dtheta - db_a - n_a.
    """
    F = np.zeros((15, 15))
    w, f, eye = so3.hat(omega), so3.hat(force), np.eye(3)
    F[0:3, 0:3] = F[3:6, 3:6] = F[6:9, 6:9] = -w
    F[0:3, 9:12] = F[6:9, 12:15] = -eye
    F[3:6, 6:9] = eye
    F[6:9, 0:3] = -f
    G = np.zeros((15, 12))
    G[0:3, 0:3] = -noise.gyroscope_noise_density * eye
    G[6:9, 3:6] = -noise.accelerometer_noise_density * eye
    G[9:12, 6:9] = noise.gyroscope_random_walk * eye
    G[12:15, 9:12] = noise.accelerometer_random_walk * eye
    Phi, Q = van_loan_discretization(F, G, seconds)
    R_1 = R_0 @ Rotation.from_rotvec(omega * seconds).as_matrix()
    T_0, T_1 = block_diag(eye, R_0, R_0, eye, eye), block_diag(eye, R_1, R_1, eye, eye)
    return T_1 @ Phi @ T_0.T, T_1 @ Q @ T_1.T


@pytest.mark.parametrize(("omega", "n"), [((0.0, 0.0, 0.0), 10), ((1.0, -0.7, 0.4), 10), ((3.0, 2.0, -4.0), 40)])
def test_phi_and_q_against_van_loan(omega, n):
    """Phi: F of a cell stops at second order in the cell's rotation, which is below .03 rad. Q: noise enters at the
    middle of each cell, which misses van Loan's integral by less than (cell / interval)^2."""
    omega, force, seconds = np.array(omega), np.array([0.5, -1.0, 9.6]), 0.05
    R, p, v, b_g, b_a = random_state(3)
    cells = Cells(np.full(n, seconds / n), np.tile(omega + b_g, (n, 1)), np.tile(force + b_a, (n, 1)), np.zeros(n))
    inc = integrate(cells, b_g, b_a, NOISE)
    Phi_true, Q_true = continuous(omega, force, NOISE, seconds, R)
    Phi = transition(inc, (R, p, v), predict(R, p, v, inc))
    for rows in BLOCKS:
        for columns in BLOCKS:
            scale = np.abs(Phi_true[rows, columns]).max()
            np.testing.assert_allclose(Phi[rows, columns], Phi_true[rows, columns], rtol=0, atol=1e-5 * scale + 1e-12)
    sigma = np.sqrt(np.diagonal(Q_true))
    off = (noise_in_world(inc, R) - Q_true) / np.outer(sigma, sigma)
    assert np.abs(off).max() < 1.0 / n**2


def test_noise_of_a_gap_is_what_a_rig_may_do_in_it():
    calm = random_cells(10)
    bridged = np.zeros(10)
    bridged[4] = 0.3
    gap = Cells(calm.dt, calm.gyro, calm.accel, bridged)
    Q_calm, Q_gap = (integrate(c, np.zeros(3), np.zeros(3), NOISE).Q for c in (calm, gap))
    assert np.linalg.eigvalsh(Q_gap - Q_calm).min() > -1e-15
    assert Q_gap[0, 0] - Q_calm[0, 0] == pytest.approx(0.1**2 * 0.3, rel=0.01)
    assert Q_gap[6, 6] - Q_calm[6, 6] == pytest.approx(0.5**2 * 0.3, rel=0.05)


def test_no_cells_no_motion():
    inc = integrate(
        Cells(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)), np.zeros(3), np.zeros(3), NOISE
    )
    R, p, v, *_ = random_state()
    R_1, p_1, v_1 = predict(R, p, v, inc)
    np.testing.assert_allclose(R_1, R, atol=1e-15)
    np.testing.assert_array_equal(p_1, p)
    np.testing.assert_array_equal(v_1, v)
    np.testing.assert_allclose(transition(inc, (R, p, v), (R_1, p_1, v_1)), np.eye(15), atol=1e-14)
    assert isinstance(inc, Increment)
    assert not inc.Q.any()


def travel(platform, difficulty, seconds, seed):
    """Errors of rotation [rad], position [m] and velocity [m/s] after dead reckoning on exact samples.

    It begins and ends between two samples' intervals: inside one nobody knows how the body shook. The frames on the
    way lie anywhere.
    """
    motion = simulate_motion(platform, seconds, seed, difficulty=difficulty)
    imu, _ = exact_imu(motion, 200.0)
    buffer = ImuBuffer(200.0)
    buffer.append(imu)
    ends_s = np.array([0.105, seconds - 0.05])
    frames_s = np.arange(0.1513, seconds - 0.1, 0.05)
    edges = EPOCH_NS + np.rint(np.concatenate([ends_s[:1], frames_s, ends_s[1:]]) * 1e9).astype(np.int64)
    truth = motion.at(edges)
    zero = np.zeros(3)
    state = truth.R_WB[0], truth.p_WB[0], truth.v_WB[0]
    for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        state = predict(*state, integrate(buffer.cells(a, b), zero, zero, NOISE))
    turn = so3.log(state[0].T @ truth.R_WB[-1])
    return tuple(float(np.linalg.norm(e)) for e in (turn, state[1] - truth.p_WB[-1], state[2] - truth.v_WB[-1]))


EVERY = [
    pytest.param(platform, difficulty, marks=[] if difficulty == "difficult" else pytest.mark.slow)
    for platform in PLATFORMS
    for difficulty in DIFFICULTIES
]


@pytest.mark.parametrize(("platform", "difficulty"), EVERY)
def test_a_minute_of_exact_samples_ends_within_a_centimetre(platform, difficulty):
    turn, off, speed = travel(platform, difficulty, 60.0, 1)
    assert turn < 1e-7
    assert off < 0.01
    assert speed < 1e-4

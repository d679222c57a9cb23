"""Motion models and the smoother: on a body whose drag and biases are known."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ipnet.errors import ConfigError, LabelError
from ipnet.motion.chain import Chain
from ipnet.motion.fit import fit, path
from ipnet.motion.intervals import BIAS, GRAV, NODE, POSI, VELO, Intervals
from ipnet.motion.learn import learn
from ipnet.motion.model import EFFECTS, ROWS
from ipnet.motion.smoother import Smoother
from ipnet.motion.source import Known, MotionPrior
from ipnet.motion.store import MotionCard, find
from navcore.imu import ImuSamples
from tests.ipnet.droning import DRAG, G_W, NOISE, drone

STEP_NS = 500_000_000
BIAS_OF_IT = np.array([0.03, -0.02, 0.01, 0.2, -0.1, 0.15])


@pytest.fixture(scope="module")
def flights():
    return [drone(seed) for seed in range(5)]


@pytest.fixture(scope="module")
def model(flights):
    return fit(flights)


def window(recording, seconds, begin_s=0.5):
    return int(recording.imu.t_ns[0]) + round(begin_s * 1e9) + np.arange(round(seconds * 2) + 1) * STEP_NS


def test_drag_is_found(model):
    np.testing.assert_allclose(model.D[:2, :2], -DRAG * np.eye(2), atol=0.01)
    assert model.gate is not None  # the rotors are heard


def test_nodes_follow_the_true_path():
    recording = drone(7, 10.0, noisy=False)
    edges = window(recording, 8.0)
    truth = recording.truth.at(edges)
    in_B = [np.einsum("nji,nj->ni", truth.R_WB, x) for x in (np.tile(G_W, (len(edges), 1)), truth.v_WB, truth.p_WB)]
    nodes = np.hstack([*in_B, np.zeros((len(edges), 6))])
    cells = Intervals.of(recording.imu, edges, np.zeros(3), np.zeros(3), NOISE)
    following, _ = cells.following(nodes[:-1])
    np.testing.assert_allclose(following[:, GRAV], nodes[1:, GRAV], atol=1e-3)
    np.testing.assert_allclose(following[:, VELO], nodes[1:, VELO], atol=1e-3)
    np.testing.assert_allclose(following[:, POSI], nodes[1:, POSI], atol=1e-3)


def test_derivatives_of_the_kinematics_agree_with_differences():
    recording = drone(7, 10.0)
    edges = window(recording, 4.0)
    rng = np.random.default_rng(1)
    at = np.hstack([np.tile(-G_W, (8, 1)), rng.standard_normal((8, 6)), np.tile(BIAS_OF_IT, (8, 1))])

    def following(nodes):
        cells = Intervals.of(recording.imu, edges, nodes[:, 9:12], nodes[:, 12:15], NOISE)
        return cells.following(nodes)[0]

    cells = Intervals.of(recording.imu, edges, at[:, 9:12], at[:, 12:15], NOISE)
    _, J = cells.following(at)
    for axis in range(NODE):
        h = 1e-5 * np.eye(NODE)[axis]
        numeric = (following(at + h) - following(at - h)) / 2e-5
        np.testing.assert_allclose(J[:, :, axis], numeric, atol=5e-3)


def test_intervals_at_other_biases_are_those_integrated_anew():
    recording = drone(7, 10.0)
    edges = window(recording, 4.0)
    moved = np.tile(np.array([1e-3, -2e-3, 1e-3, 0.05, 0.02, -0.03]), (8, 1))
    near = Intervals.of(recording.imu, edges, np.zeros(3), np.zeros(3), NOISE).at(moved)
    anew = Intervals.of(recording.imu, edges, moved[:, :3], moved[:, 3:], NOISE)
    np.testing.assert_allclose(near.increments.delta_R, anew.increments.delta_R, atol=2e-6)
    np.testing.assert_allclose(near.increments.delta_v, anew.increments.delta_v, atol=3e-5)
    np.testing.assert_allclose(near.force, anew.force, atol=1e-12)
    nodes = np.hstack([np.tile(-G_W, (8, 1)), np.ones((8, 3)), np.zeros((8, 9))])
    np.testing.assert_allclose(near.features(nodes), anew.features(nodes), atol=8e-3)


def test_derivatives_of_the_motion_agree_with_differences(flights, model):
    p = path(flights[0], 0.5)
    u, turns = p.u[:3], p.turns[:3]
    effects = 0.1 * np.random.default_rng(2).standard_normal(EFFECTS)
    by_next, by_last, by_effects = model.jacobians(u, effects)
    h = 1e-6
    for axis in range(u.shape[1]):
        more, less = u.copy(), u.copy()
        more[1, axis] += h
        less[1, axis] -= h
        change = (model.innovations(more, turns, effects) - model.innovations(less, turns, effects)) / (2.0 * h)
        np.testing.assert_allclose(change[0], by_next[:, axis], atol=1e-6)
        np.testing.assert_allclose(change[1], by_last[:, axis], atol=1e-6)
    for axis in range(EFFECTS):
        d = h * np.eye(EFFECTS)[axis]
        change = (model.innovations(u, turns, effects + d) - model.innovations(u, turns, effects - d)) / (2.0 * h)
        np.testing.assert_allclose(change, by_effects[:, :, axis], atol=1e-6)


def test_a_chain_is_solved_as_the_whole_system():
    rng = np.random.default_rng(3)
    nodes, size, border = 5, 3, 2
    n = nodes * size
    rows = rng.standard_normal((60, n + border))
    for k in range(60):  # each row sees two neighbours and the border
        first = rng.integers(0, nodes - 1) * size
        rows[k, :first], rows[k, first + 2 * size : n] = 0.0, 0.0
    A, b = rows.T @ rows, rng.standard_normal(n + border)
    chain = Chain.empty(nodes, size, border)
    for i in range(nodes):
        s = slice(i * size, (i + 1) * size)
        chain.D[i], chain.F[i], chain.h[i] = A[s, s], A[s, n:], b[s]
        if i + 1 < nodes:
            chain.E[i] = A[s, s.stop : s.stop + size]
    chain.G[:], chain.k[:] = A[n:, n:], b[n:]
    x, shared, covariance = chain.solve()
    whole = np.linalg.solve(A, b)
    np.testing.assert_allclose(np.concatenate([x.ravel(), shared]), whole, rtol=1e-8)
    np.testing.assert_allclose(covariance, np.linalg.inv(A)[n - size : n, n - size : n], rtol=1e-8)


def test_biases_are_inferred_from_a_flight_never_seen(model):
    errors = []
    for seed in range(10, 14):
        recording = drone(seed, 32.0, BIAS_OF_IT)
        found = Smoother(model, NOISE, np.repeat([0.3, 1.5], 3)).infer(recording.imu, window(recording, 30.0))
        errors.append(found.mean - BIAS_OF_IT)
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (rms < [1e-3, 1e-3, 0.02, 0.02, 0.02, 0.02]).all(), rms


def test_rest_tells_the_gyro_and_says_little_of_the_accelerometer(model):
    recording = drone(5, 12.0, BIAS_OF_IT, rest_s=12.0)
    found = Smoother(model, NOISE, np.repeat([0.3, 1.5], 3)).infer(recording.imu, window(recording, 10.0))
    sigma = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose(found.mean[:3], BIAS_OF_IT[:3], atol=5e-4)
    assert sigma[0] < 1e-3 and sigma[3] > 0.1


def test_a_steady_turn_is_no_rest(model):
    """Scatter alone does not tell them apart: a turntable's samples are as quiet as a table's."""
    recording = drone(5, 12.0, BIAS_OF_IT, rest_s=12.0)
    imu = recording.imu
    turning = ImuSamples(imu.t_ns, imu.gyro + np.array([0.0, 0.0, 0.5]), imu.accel)
    smoother = Smoother(model, NOISE, np.repeat([0.3, 1.5], 3))
    assert smoother.infer(turning, window(recording, 10.0)) is None


def test_of_what_is_carried_nothing_is_said(model):
    recording = drone(5, 12.0, noisy=False)  # no rotors are heard
    assert Smoother(model, NOISE, np.repeat([0.3, 1.5], 3)).infer(recording.imu, window(recording, 10.0)) is None


def updated(before, walk, seconds, H, z, R):
    """What a Kalman filter knows that much later, after a measurement."""
    P = before.covariance + np.diag(walk) * seconds
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    mean = before.mean + K @ (z - H @ before.mean)
    return Known(before.t_ns + round(seconds * 1e9), mean, (np.eye(6) - K @ H) @ P)


@pytest.fixture
def before():
    rng = np.random.default_rng(3)
    A = rng.normal(size=(6, 6)) * np.repeat([1e-3, 0.02], 3)
    return Known(7_000_000_000, BIAS_OF_IT, A.T @ A + np.diag(np.repeat([1e-4, 5e-3], 3) ** 2))


WALK = np.repeat([2e-5, 3e-3], 3) ** 2


def test_what_is_new_is_the_measurement_between(before):
    rng = np.random.default_rng(4)
    R = np.diag(np.repeat([4e-4, 8e-3], 3) ** 2)
    z = BIAS_OF_IT + rng.normal(size=6) * np.sqrt(np.diag(R))
    told = updated(before, WALK, 5.0, np.eye(6), z, R).since(before, WALK)
    assert told.t_ns == 12_000_000_000
    np.testing.assert_allclose(told.vector, z, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(told.covariance, R, rtol=1e-6, atol=1e-12)


def test_of_directions_with_nothing_new_nothing_is_told(before):
    H, R = np.eye(6)[[0, 4]], np.diag([1e-4, 5e-3]) ** 2
    after = updated(before, WALK, 5.0, H, H @ BIAS_OF_IT + [2e-4, -0.01], R)
    told = after.since(before, WALK)
    np.testing.assert_allclose(H @ told.vector, H @ BIAS_OF_IT + [2e-4, -0.01], rtol=1e-2)
    again = updated(before, WALK, 5.0, np.eye(6), told.vector, told.covariance)  # whoever is told knows as much
    np.testing.assert_allclose(again.mean, after.mean, atol=0.02 * np.sqrt(np.diag(after.covariance)).min())
    np.testing.assert_allclose(again.covariance, after.covariance, rtol=0.02, atol=1e-9)
    carried_on = replace(before, t_ns=after.t_ns, covariance=before.covariance + 5.0 * np.diag(WALK))
    assert carried_on.since(before, WALK) is None


@pytest.fixture(scope="module")
def card(flights):
    return learn(flights)


def said(card, imu, pieces):
    source = MotionPrior(card, NOISE)
    answers = []
    for begin in range(0, len(imu), pieces):
        source.add_imu(imu[begin : begin + pieces])
        answers += source.poll(int(imu.t_ns[min(begin + pieces, len(imu)) - 1]))
    return answers


def test_a_source_is_causal_and_pieces_do_not_matter(card):
    imu = drone(20, 26.0, BIAS_OF_IT).imu
    whole, small = said(card, imu, len(imu)), said(card, imu, 37)
    ends = [round(s * 1e9) for s in (9.5, 14.5, 19.5, 24.5)]
    assert [z.t_ns for z in whole] == [z.t_ns for z in small] == ends
    for a, b in zip(whole, small, strict=True):
        np.testing.assert_allclose(a.vector, b.vector, rtol=1e-9)
    early = said(card, imu[:1200], 37)
    np.testing.assert_array_equal(early[0].vector, small[0].vector)


def test_a_gap_begins_anew(card):
    imu = drone(20, 26.0, BIAS_OF_IT).imu
    late = ImuSamples(imu.t_ns[900:] + 400_000_000, imu.gyro[900:], imu.accel[900:])
    joined = ImuSamples(
        *(np.concatenate([a, b]) for a, b in zip(vars(imu[:900]).values(), vars(late).values(), strict=True))
    )
    begin = late.t_ns[0] - 5_000_000
    assert [z.t_ns for z in said(card, joined, 50)] == [begin + 9_500_000_000, begin + 14_500_000_000]


def test_errors_are_found_on_flights_that_were_left_out(card, flights):
    assert card.training == card.validation == tuple(f.name for f in flights)
    assert (np.diagonal(card.errors.constant) > 0.0).all()


def test_a_card_comes_back_from_its_file(card, tmp_path):
    card.write(tmp_path / "drone.json")
    again = MotionCard.read(find(str(tmp_path / "drone.json")))
    np.testing.assert_array_equal(again.model.Q, card.model.Q)
    np.testing.assert_array_equal(again.errors.constant, card.errors.constant)
    assert again.noise == card.noise and again.training == card.training


def test_what_cannot_be_had_is_said(flights, tmp_path):
    with pytest.raises(ConfigError, match="known are"):
        find("no-such-platform")
    with pytest.raises(LabelError, match=f"{flights[0].name}: learned from and validated on"):
        learn(flights, flights[:1])
    (tmp_path / "wrong.json").write_text("{}")
    with pytest.raises(ConfigError, match=r"wrong\.json"):
        MotionCard.read(tmp_path / "wrong.json")
    with pytest.raises(LabelError, match="three or more"):
        learn(flights[:2])
    with pytest.raises(LabelError, match="too little motion"):
        fit([drone(1, 10.0)])
    with pytest.raises(LabelError, match="no truth"):
        path(replace(flights[0], truth=None), 0.5)
    assert ROWS + 9 == EFFECTS and BIAS.stop == NODE


def test_nothing_in_a_card_is_not_a_number(card, tmp_path):
    card.write(tmp_path / "drone.json")
    content = json.loads((tmp_path / "drone.json").read_text())
    for part, name, says in (
        ("model", "D", "D of a motion model is not finite"),
        ("errors", "floor", "errors or noise"),
    ):
        wrong = {**content, part: {**content[part], name: np.full_like(content[part][name], np.nan).tolist()}}
        (tmp_path / "wrong.json").write_text(json.dumps(wrong))
        with pytest.raises(ConfigError, match=rf"wrong\.json.*{says}"):
            MotionCard.read(tmp_path / "wrong.json")

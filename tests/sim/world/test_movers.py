import mujoco
import numpy as np
import pytest

from navcore.arrays import Vectors
from sim.errors import ConfigError
from sim.motion import Motion
from sim.world import SCENES, Layout, Mover, build, make_layout, make_movers
from sim.world.block import gaps

T_S = np.arange(0.0, 20.0, 0.01)


@pytest.fixture(scope="module", params=sorted(SCENES))
def layout(request: pytest.FixtureRequest, flight: Motion) -> Layout:
    return make_layout(request.param, flight.p_WB, np.random.default_rng(1))


@pytest.fixture(scope="module")
def movers(layout: Layout, flight: Motion) -> tuple[Mover, ...]:
    return make_movers(4, layout, flight.p_WB, flight.duration_s, np.random.default_rng(2))


def outline(mover: Mover, t_s: float) -> Vectors:
    """(M, 3) m: points all over its sides at a time."""
    centres, headings = mover.at(np.array([t_s]))
    u = np.linspace(-1.0, 1.0, 5)
    grid = np.stack(np.meshgrid(u, u, u), axis=-1).reshape(-1, 3)
    local = grid[np.abs(grid).max(axis=1) == 1.0] * mover.half
    c, s = np.cos(headings[0]), np.sin(headings[0])
    points: Vectors = local @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + centres[0]
    return points


def test_they_keep_clear_of_the_body_of_things_and_of_each_other(
    layout: Layout, movers: tuple[Mover, ...], flight: Motion
) -> None:
    for t_s in T_S[::10]:
        boxes = [outline(m, t_s) for m in movers]
        body = flight.p_WB[round(t_s / flight.step_s)]
        for points in boxes:
            assert np.linalg.norm(points - body, axis=1).min() >= 0.7
            assert np.all(points >= np.array(layout.low) - 1e-9) and np.all(points <= layout.high)
            assert min(gaps(points, b.low, b.high).min() for b in layout.blocks) > 0.0
        places = [m.at(np.array([t_s]))[0][0, :2] for m in movers]
        for i in range(len(movers)):
            for j in range(i):
                reach = movers[i].radius + movers[j].radius
                assert np.linalg.norm(places[i] - places[j]) > reach


def test_they_come_near_the_path(movers: tuple[Mover, ...], flight: Motion) -> None:
    body = flight.p_WB[np.rint(T_S / flight.step_s).astype(int)]
    nearest = [m.clearance(T_S, body).min() for m in movers]
    assert min(nearest) < 3.0


def test_they_go_smoothly_at_walking_speed_round_a_closed_loop_facing_ahead(movers: tuple[Mover, ...]) -> None:
    for mover in movers:
        place, velocity = mover.loop.at(T_S)
        speed = np.linalg.norm(velocity, axis=1)
        assert speed.min() > 0.05 and speed.max() <= 1.4
        np.testing.assert_allclose(np.gradient(place, T_S, axis=0)[1:-1], velocity[1:-1], atol=1e-3)
        assert np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() / 0.01 < 6.0  # m/s^2
        np.testing.assert_allclose(mover.at(T_S + mover.loop.period_s)[0], mover.at(T_S)[0], atol=1e-9)
        heading = mover.at(T_S)[1]
        np.testing.assert_allclose(
            np.stack([np.cos(heading), np.sin(heading)], axis=1), velocity / speed[:, None], atol=1e-9
        )


def test_the_model_has_them_where_they_are_said_to_be(layout: Layout, movers: tuple[Mover, ...], coarse: None) -> None:
    scene = build(layout, np.random.default_rng(3), movers=movers)
    data = mujoco.MjData(scene.model)
    assert scene.model.nmocap == 4
    for t_s in (0.0, 7.3):
        scene.place(data, t_s)
        for k, mover in enumerate(movers):
            geoms = np.flatnonzero(scene.model.geom_bodyid == scene.model.body(f"mover{k}").id)
            assert len(geoms) == 5
            centre, heading = mover.at(np.array([t_s]))
            front = centre[0] + mover.half[0] * np.array([np.cos(heading[0]), np.sin(heading[0]), 0.0])
            np.testing.assert_allclose(data.geom_xpos[geoms[0]], front, atol=1e-9)


def test_without_them_the_scene_is_the_same(flight: Motion, coarse: None) -> None:
    layout = make_layout("room", flight.p_WB, np.random.default_rng(1))
    movers = make_movers(2, layout, flight.p_WB, flight.duration_s, np.random.default_rng(2))
    alone = build(layout, np.random.default_rng(3)).model
    with_them = build(layout, np.random.default_rng(3), movers=movers).model
    np.testing.assert_array_equal(with_them.tex_data[: len(alone.tex_data)], alone.tex_data)


def test_too_many_for_the_place_are_refused(flight: Motion) -> None:
    cell = Layout((-1.6, -1.6, 0.0), (1.6, 1.6, 3.0))
    with pytest.raises(ConfigError, match="9 movers were asked for; there is room for"):
        make_movers(9, cell, np.array([[0.0, 0.0, 1.0]]), 5.0, np.random.default_rng(1))
    with pytest.raises(ConfigError, match="expected 0 or more"):
        make_movers(-1, cell, np.array([[0.0, 0.0, 1.0]]), 5.0, np.random.default_rng(1))

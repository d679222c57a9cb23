import numpy as np
import pytest

from sim.world.layout import Block, Layout, make_layout


@pytest.fixture(scope="module")
def room() -> Layout:
    return make_layout("room", np.zeros((1, 3)), np.random.default_rng(1))


def test_landmarks_lie_on_surfaces_with_normals_into_the_air(room: Layout) -> None:
    points, normals = room.landmarks(500, np.random.default_rng(2))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    on_wall = np.isclose(np.abs(points[:, :2]), [5.0, 4.0]).any(axis=1) | np.isclose(points[:, 2] % 4.0, 0.0)
    inwards = np.sum(normals * ([0.0, 0.0, 2.0] - points), axis=1) > 0.0
    assert inwards[on_wall & np.isclose(np.abs(points), [5.0, 4.0, 9.0]).any(axis=1)].mean() > 0.9
    free = room.distance(points + 0.01 * normals, -normals)
    assert np.isclose(free, 0.01).mean() > 0.9  # the others are hidden inside another block


def test_rays_end_at_the_nearest_of_wall_and_block() -> None:
    layout = Layout((10.0, 8.0, 4.0), (Block((2.0, 0.0, 1.0), (0.5, 0.5, 1.0)),), ())
    start = np.tile([0.0, 0.0, 1.0], (4, 1))
    direction = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 0, 1.0], [0.6, 0.8, 0.0]])
    np.testing.assert_allclose(layout.distance(start, direction), [1.5, 5.0, 3.0, 5.0])
    np.testing.assert_allclose(layout.clutter_distance(start, direction), [1.5, np.inf, np.inf, np.inf])


def test_clutter_stays_out_of_the_middle_of_the_room() -> None:
    for seed in range(20):
        for block in make_layout("room", np.zeros((1, 3)), np.random.default_rng(seed)).blocks:
            centre, half = np.array(block.centre), np.array(block.half)
            reaches_in = np.abs(centre[:2]) - half[:2] < np.array([5.0, 4.0]) - 1.0
            assert not reaches_in.all() or centre[2] - half[2] > 3.3

import numpy as np
import pytest

from sim.errors import ConfigError
from sim.world import Layout, make_layout
from sim.world.block import Block, gaps
from sim.world.surface import sides
from sim.world.way import Way


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
    layout = Layout((-5.0, -4.0, 0.0), (5.0, 4.0, 4.0), (Block((2.0, 0.0, 1.0), (0.5, 0.5, 1.0)),))
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


@pytest.mark.parametrize("inwards", [False, True])
def test_sides_are_where_their_normals_say_and_stand_upright(inwards: bool) -> None:
    low, high = np.array([1.0, -2.0, 0.5]), np.array([2.0, 3.0, 4.5])
    found = sides(low, high, 6 * (Block.look,), inwards)
    middle = 0.5 * (low + high)
    for surface in found:
        normal = np.cross(surface.edge_u, surface.edge_v) / surface.area
        np.testing.assert_allclose(surface.normal, normal, atol=1e-12)
        out = surface.middle - middle
        np.testing.assert_allclose(out, np.abs(normal) * np.sign(out) * 0.5 * (high - low), atol=1e-12)
        assert (normal @ out > 0.0) is not inwards
        corners = np.stack([surface.corner, surface.corner + surface.edge_u + surface.edge_v])
        assert np.all(corners >= low - 1e-9) and np.all(corners <= high + 1e-9)
        assert surface.upright == (normal[2] == 0.0)
    assert sum(s.area for s in found) == pytest.approx(2.0 * (5.0 + 4.0 + 20.0))


def test_sides_flush_against_the_box_are_left_out() -> None:
    block = Block.between((-5.0, -0.5, 0.0), (-4.0, 0.5, 2.0))
    layout = Layout((-5.0, -4.0, 0.0), (5.0, 4.0, 4.0), (block,))
    normals = [tuple(s.normal) for s in layout.surfaces[6:]]
    assert normals == [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)]


def test_surfaces_have_the_detail_that_is_seen_from_the_way() -> None:
    way = np.array([[1.0, 1.0, 1.0]])
    layout = Layout((0.0, 0.0, 0.0), (40.0, 3.0, 3.0), way=way)
    by_distance = sorted((float(gaps(way, *_ends(s)).min()), s.texels_per_m) for s in layout.surfaces)
    assert by_distance[0][1] == 200.0
    assert by_distance[-1][1] == pytest.approx(690.0 / 39.0)
    assert sum(s.area for s in layout.surfaces) == pytest.approx(2.0 * (120.0 + 120.0 + 9.0))


def _ends(surface) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[no-untyped-def]
    ends = np.stack([surface.corner, surface.corner + surface.edge_u + surface.edge_v])
    return ends.min(axis=0), ends.max(axis=0)


@pytest.mark.parametrize(("lowest", "floor"), [(0.1, 0.0), (1.7, 0.0), (-1.0, -1.8), (5.0, 4.2)])
def test_the_floor_is_at_zero_or_below_the_path(lowest: float, floor: float) -> None:
    assert Way.of(np.array([[0.0, 0.0, lowest], [1.0, 0.0, lowest + 2.0]])).floor == pytest.approx(floor)


def test_a_path_without_points_is_refused() -> None:
    for path in (np.zeros((0, 3)), np.zeros((4, 2)), np.full((2, 3), np.nan)):
        with pytest.raises(ConfigError, match="finite points"):
            make_layout("room", path, np.random.default_rng(1))

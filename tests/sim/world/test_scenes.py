import mujoco
import numpy as np
import pytest

from navcore.arrays import Vectors
from sim.errors import ConfigError
from sim.world import SCENES, Scene, build, make_layout
from sim.world.block import gaps

KINDS = ("flight", "long", "level")
SEEDS = (1, 2, 3)


@pytest.mark.parametrize("scene", sorted(SCENES))
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_touches_the_path(scene: str, kind: str, seed: int, paths: dict[str, Vectors]) -> None:
    path = paths[kind]
    layout = make_layout(scene, path, np.random.default_rng(seed))
    assert np.all(path[:, :2].min(axis=0) - layout.low[:2] >= 0.6)
    assert np.all(layout.high[:2] - path[:, :2].max(axis=0) >= 0.6)
    assert layout.high[2] - path[:, 2].max() >= 0.6
    assert layout.low[2] == 0.0 if 0.0 <= path[:, 2].min() <= 1.8 else path[:, 2].min() - layout.low[2] >= 0.5
    assert min(gaps(path, b.low, b.high).min() for b in layout.blocks) >= 0.6
    for block in layout.blocks:
        assert np.all(block.low >= np.array(layout.low) - 1e-6)
        assert np.all(block.high <= np.array(layout.high) + 1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_flight_is_in_a_room_of_its_usual_size(seed: int, paths: dict[str, Vectors]) -> None:
    layout = make_layout("room", paths["flight"], np.random.default_rng(seed))
    assert (layout.low, layout.high) == ((-5.0, -4.0, 0.0), (5.0, 4.0, 4.0))
    assert len(layout.blocks) > 14
    assert len(layout.lamp_places) == 4


@pytest.mark.parametrize(("kind", "near_m"), [("flight", 4.0), ("long", 6.0), ("level", 4.0)])
@pytest.mark.parametrize("scene", ["room", "hall", "yard"])
def test_something_is_near_and_something_far(scene: str, kind: str, near_m: float, paths: dict[str, Vectors]) -> None:
    """Of rays level and downwards all around, along the path."""
    path = paths[kind]
    layout = make_layout(scene, path, np.random.default_rng(1))
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    slopes = np.array([-0.5, -0.2, 0.0])[:, None]
    rays = np.stack(np.broadcast_arrays(np.cos(turns), np.sin(turns), slopes), axis=-1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    free = np.array([layout.distance(np.tile(p, (len(rays), 1)), rays) for p in path[:: len(path) // 40]])
    assert np.median(np.percentile(free, 10, axis=1)) < near_m
    assert free.max(axis=1).min() > 5.0


@pytest.mark.parametrize("scene", sorted(SCENES))
def test_landmarks_are_on_surfaces_and_not_in_the_sky(scene: str, paths: dict[str, Vectors]) -> None:
    layout = make_layout(scene, paths["long"], np.random.default_rng(1))
    points, normals = layout.landmarks(800, np.random.default_rng(2))
    free = layout.distance(points + 0.01 * normals, -normals)
    assert np.isclose(free, 0.01).mean() > 0.85  # the others are hidden behind a block that stands against it
    if scene == "yard":
        assert np.all(
            gaps(points, np.array(layout.low) + 1e-3, np.array(layout.high) - 1e-3)[points[:, 2] > 0.1] < 2e-3
        )
        assert np.all(points[:, 2] < layout.high[2] - 1.0)


@pytest.fixture(scope="module", params=sorted(SCENES))
def built(request: pytest.FixtureRequest, paths: dict[str, Vectors]) -> Scene:
    rng = np.random.default_rng(5)
    return build(make_layout(request.param, paths["level"], rng), rng)


def test_distances_are_those_of_mujocos_rays(built: Scene, paths: dict[str, Vectors]) -> None:
    rng, data = np.random.default_rng(1), mujoco.MjData(built.model)
    mujoco.mj_forward(built.model, data)
    rays = rng.standard_normal((400, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    start = paths["level"][rng.integers(len(paths["level"]), size=400)]
    hit = np.zeros(1, dtype=np.int32)
    theirs = [mujoco.mj_ray(built.model, data, p, d, None, 1, -1, hit) for p, d in zip(start, rays, strict=True)]
    np.testing.assert_allclose(built.layout.distance(start, rays), theirs, atol=1e-6)


def test_textures_keep_their_budget_and_the_model_reaches_everything(built: Scene) -> None:
    assert 5e6 < built.model.ntexdata < 200e6
    assert built.model.ntex < 1000  # as many as MuJoCo's renderer takes
    assert built.model.vis.map.zfar * built.model.stat.extent > built.layout.diagonal


def test_textures_are_neither_dark_nor_burnt(built: Scene) -> None:
    grey = built.model.tex_data[::3]
    assert 60.0 < np.median(grey) < 190.0
    assert (grey > 250).mean() < 0.05


@pytest.mark.parametrize("scene", sorted(SCENES))
def test_the_same_seed_gives_the_same_bytes(scene: str, paths: dict[str, Vectors], coarse: None) -> None:
    def made(seed: int) -> Scene:
        rng = np.random.default_rng(seed)
        return build(make_layout(scene, paths["level"], rng), rng)

    first, again, other = made(5), made(5), made(6)
    assert first.layout.blocks == again.layout.blocks != other.layout.blocks
    np.testing.assert_array_equal(first.model.tex_data, again.model.tex_data)


def test_a_scene_that_is_unknown_is_named() -> None:
    with pytest.raises(ConfigError, match=r"'sea' is unknown; known are \['corridor', 'hall', 'room', 'yard'\]"):
        make_layout("sea", np.zeros((1, 3)), np.random.default_rng(1))

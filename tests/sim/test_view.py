"""What is seen of landmarks that a screen hides, against the screen's own geometry."""

import numpy as np
import pytest

from navcore.trajectory import Trajectory
from sim.imu import GRADES
from sim.points.outline import CELLS, Outline
from sim.points.view import Landmarks, View
from sim.rig import euroc_like

FRAMES = 40
WALL_X, SCREEN_X, SCREEN_Y = 6.0, 3.0, 0.0  # m: landmarks on a wall, a screen before its left half


def walked() -> tuple[View, np.ndarray]:
    """A rig that looks along x and walks sideways by 1 m, and its camera's places."""
    p_WB = np.stack([np.zeros(FRAMES), np.linspace(-0.5, 0.5, FRAMES), np.full(FRAMES, 1.5)], axis=1)
    t_ns = np.arange(FRAMES) * 50_000_000
    view = View(
        euroc_like(GRADES["adis16448"].noise), Trajectory(t_ns, np.tile([0.0, 0.0, 0.0, 1.0], (FRAMES, 1)), p_WB)
    )
    return view, view.p_WC[0]


def free_way(start: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The screen is where x = 3 m and y > 0, the wall where x = 6 m."""
    with np.errstate(divide="ignore"):
        to_screen = (SCREEN_X - start[:, 0]) / direction[:, 0]
        to_wall = (WALL_X - start[:, 0]) / direction[:, 0]
    return np.where(start[:, 1] + to_screen * direction[:, 1] > SCREEN_Y, to_screen, to_wall)


@pytest.fixture(scope="module")
def wall() -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.stack([np.full(1500, WALL_X), rng.uniform(-4.0, 4.0, 1500), rng.uniform(-1.0, 3.0, 1500)], axis=1)


def test_what_is_behind_a_screen_is_not_seen(wall: np.ndarray) -> None:
    view, places = walked()
    towards_us = np.tile([-1.0, 0.0, 0.0], (len(wall), 1))
    seen = list(Landmarks(view, wall, towards_us, free_way).seen())
    assert len(seen) == FRAMES
    for k, now in enumerate(seen):
        # Seen is what has a free way in the middle of eight frames: .1 m of walking at most from here.
        crossing = [p[1] + (wall[:, 1] - p[1]) * 0.5 for p in (places[k] - [0, 0.11, 0], places[k] + [0, 0.11, 0])]
        assert not np.any(now.may & (np.minimum(*crossing) > 0.01))
        in_image = view.pixels(k, 0, wall)[1]
        clear = in_image & (np.maximum(*crossing) < -0.01)
        assert np.mean(now.may[clear]) == 1.0
        assert set(now.which) <= set(np.flatnonzero(now.may))
    assert 100 < np.mean([len(now.which) for now in seen]) < len(wall)


def test_the_back_of_a_surface_is_not_seen(wall: np.ndarray) -> None:
    view, _ = walked()
    away = np.tile([1.0, 0.0, 0.0], (len(wall), 1))
    assert not any(now.may.any() for now in Landmarks(view, wall, away, free_way).seen())


def test_the_outline_is_the_image_to_within_a_table_entry() -> None:
    """Pixels, by the camera's own inverse, fall into their cell of eight by five; what is outside has none."""
    view, _ = walked()
    camera = view.calibration.cameras[0].camera
    u, v = np.meshgrid(np.arange(3.0, 752.0, 6.0), np.arange(3.0, 480.0, 6.0))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    inside, cells = Outline.of(camera).look_up(camera.unproject(uv).astype(np.float32))
    assert inside.all()
    wanted = (uv[:, 0] * 8 // 752 + 8 * (uv[:, 1] * 5 // 480)).astype(int)
    well_inside = np.all((uv > 30.0) & (uv < [720.0, 450.0]), axis=1)
    assert np.mean(cells[well_inside] == wanted[well_inside]) > 0.85
    assert np.all(cells[well_inside] >= 0) and cells.max() < CELLS
    outside = camera.unproject(np.array([[-60.0, 240.0], [376.0, 560.0]]))
    assert np.all(Outline.of(camera).look_up(outside)[1] == -1)

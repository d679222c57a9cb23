import mujoco
import numpy as np
import pytest

from navcore import so3
from navcore.arrays import Floats, Image, Pixels, Vectors
from navcore.camera import Camera, PinholeEquidistant, PinholeRadtan
from sim.camera.render import FINE, SceneCamera
from sim.errors import RenderError
from sim.imu import GRADES
from sim.radiance import LINEAR_MAX
from sim.rig import euroc_like
from sim.world.layout import Layout, make_layout
from sim.world.lighting import irradiance
from sim.world.scene import Scene, build

pytestmark = pytest.mark.usefixtures("opengl")

EUROC = euroc_like(GRADES["adis16448"].noise).cameras[0].camera
FISHEYE = PinholeEquidistant(320, 260, 190.98, 190.97, 164.9, 126.9, (0.0034, 0.0007, -0.0021, 0.0002))


def pose(rotation: tuple[float, float, float], p: tuple[float, float, float]) -> Floats:
    T_WC = np.eye(4)
    T_WC[:3, :3], T_WC[:3, 3] = so3.exp(np.array(rotation)), p
    return T_WC


def scene_of_balls(places: Vectors) -> Scene:
    """White balls of 15 mm in the dark."""
    spec = mujoco.MjSpec()
    spec.visual.headlight.ambient = [1.0, 1.0, 1.0]
    spec.visual.headlight.diffuse = [0.0, 0.0, 0.0]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.visual.quality.offsamples = 0
    for p in places:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.015, 0, 0], pos=p, rgba=[1, 1, 1, 1])
    return Scene(Layout((20.0, 20.0, 20.0), (), ()), spec.compile())


def centroid(image: Image, near: Pixels) -> Pixels:
    u, v = np.rint(near).astype(int)
    rows, columns = np.mgrid[v - 8 : v + 9, u - 8 : u + 9]
    light = image[rows, columns].astype(np.float64)
    return np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum()


@pytest.mark.parametrize(("camera", "metres"), [(EUROC, 3.0), (FISHEYE, 1.3)])
def test_points_appear_where_the_camera_model_projects_them(camera: Camera, metres: float) -> None:
    grid = np.meshgrid(np.linspace(15, camera.width - 16, 12), np.linspace(15, camera.height - 16, 8))
    uv = np.stack(grid, axis=-1).reshape(-1, 2) + np.random.default_rng(1).uniform(-4.0, 4.0, (96, 2))
    T_WC = pose((0.3, -1.2, 0.7), (1.0, -2.0, 3.0))
    places = metres * camera.unproject(uv) @ T_WC[:3, :3].T + T_WC[:3, 3]
    with SceneCamera(scene_of_balls(places), camera) as eye:
        image = eye.linear_image(T_WC)
    errors = np.array([centroid(image, x) - x for x in uv])
    assert np.sqrt(np.mean(np.sum(errors**2, axis=1))) < 0.1  # px
    assert np.abs(errors.mean(axis=0)).max() < 0.02


@pytest.fixture(scope="module")
def furnished() -> Scene:
    rng = np.random.default_rng(3)
    return build(make_layout("room", np.zeros((1, 3)), rng), rng)


def test_two_views_of_a_room_agree_through_its_geometry(furnished: Scene) -> None:
    """Pixels of one view, carried by the layout's distances into another, find the same brightness there."""
    T_WA, T_WB = pose((-1.9, 0.3, -0.3), (0.5, -0.4, 1.4)), pose((-1.8, 0.35, -0.2), (0.7, -0.3, 1.5))
    with SceneCamera(furnished, EUROC) as eye:
        first, second = eye.linear_image(T_WA), eye.linear_image(T_WB)
    u, v = (x.ravel() for x in np.meshgrid(np.arange(20, 730, 3), np.arange(20, 460, 3)))
    rays = EUROC.unproject(np.stack([u, v], axis=1)) @ T_WA[:3, :3].T
    start = np.tile(T_WA[:3, 3], (len(rays), 1))
    points = start + furnished.layout.distance(start, rays)[:, None] * rays
    towards = points - T_WB[:3, 3]
    far = np.linalg.norm(towards, axis=1)
    unhidden = furnished.layout.distance(np.tile(T_WB[:3, 3], (len(far), 1)), towards / far[:, None]) > far - 0.01
    p_BF = towards @ T_WB[:3, :3]
    seen = unhidden & EUROC.visible(p_BF)
    u2, v2 = np.rint(EUROC.project(p_BF)[seen]).astype(int).T
    a, b = first[v[seen], u[seen]].astype(float), second[v2, u2].astype(float)
    assert seen.mean() > 0.5
    assert np.corrcoef(a, b)[0, 1] > 0.9
    assert np.median(np.abs(a - b)) < 0.03 * np.median(a)


def test_a_room_is_textured_and_well_exposed(furnished: Scene) -> None:
    with SceneCamera(furnished, EUROC) as eye:
        image = eye.linear_image(pose((-1.9, 0.3, -0.3), (0.5, -0.4, 1.4))) / LINEAR_MAX
    assert 0.05 < np.median(image) < 0.6
    assert (image > 0.99).mean() < 0.02
    blocks = image.reshape(8, 60, 8, 94).std(axis=(1, 3)) / image.reshape(8, 60, 8, 94).mean(axis=(1, 3))
    assert np.median(blocks) > 0.1


def test_the_same_view_gives_the_same_bytes_also_in_another_context(furnished: Scene) -> None:
    T_WC = pose((-1.9, 0.3, -0.3), (0.5, -0.4, 1.4))
    images = []
    for _ in range(2):
        with SceneCamera(furnished, FISHEYE) as eye:
            images += [eye.linear_image(T_WC, FINE), eye.linear_image(T_WC, FINE)]
    assert all(np.array_equal(images[0], x) for x in images[1:])


def test_a_camera_wider_than_a_pinhole_is_refused(furnished: Scene) -> None:
    wide = PinholeEquidistant(512, 512, 150.0, 150.0, 255.5, 255.5)
    with pytest.raises(RenderError, match="tangents up to"):
        SceneCamera(furnished, wide)


def test_baked_light_lies_where_the_lamps_throw_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """On grey surfaces, brightness in the image is irradiance at the point that the pixel sees."""
    monkeypatch.setattr("sim.world.scene.dead_leaves", lambda w, h, *_: np.full((h, w), 0.3))
    layout = make_layout("room", np.zeros((1, 3)), np.random.default_rng(3))
    camera = PinholeRadtan(160, 120, 80.0, 80.0, 79.5, 59.5)
    views = [pose((-1.9, 0.3 + k, -0.3), (0.5, -0.4, 1.4)) for k in (0.0, 1.5)]
    with SceneCamera(build(layout, np.random.default_rng(1)), camera) as eye:
        images = [eye.linear_image(T_WC)[::4, ::4].ravel() for T_WC in views]
    u, v = (x.ravel() for x in np.meshgrid(np.arange(0.0, 160.0, 4.0), np.arange(0.0, 120.0, 4.0)))
    for T_WC, image in zip(views, images, strict=True):
        rays = camera.unproject(np.stack([u, v], axis=1)) @ T_WC[:3, :3].T
        start = np.tile(T_WC[:3, 3], (len(rays), 1))
        points = start + (layout.distance(start, rays)[:, None] - 1e-4) * rays
        on_wall = np.argmin(np.abs(np.abs(points - [0.0, 0.0, 2.0]) - [5.0, 4.0, 2.0]), axis=1)
        gap = np.min(np.abs(np.abs(points - [0.0, 0.0, 2.0]) - [5.0, 4.0, 2.0]), axis=1)
        normals = -np.sign(points - [0.0, 0.0, 2.0]) * np.eye(3)[on_wall]
        expected = irradiance(layout, points, normals)
        bare = (gap < 1e-3) & (image < LINEAR_MAX)
        assert bare.mean() > 0.3
        assert np.corrcoef(expected[bare], image[bare])[0, 1] > 0.97

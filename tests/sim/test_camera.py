import mujoco
import numpy as np
import pytest

from navcore import so3
from navcore.arrays import Floats, Image, Pixels, Vectors
from navcore.camera import Camera, PinholeEquidistant, PinholeRadtan
from sim.camera.faces import Face, faces_of
from sim.camera.render import FINE, SceneCamera, atlases_of
from sim.errors import RenderError
from sim.imu import GRADES
from sim.radiance import LINEAR_MAX
from sim.rig import euroc_like
from sim.world import Layout, make_layout
from sim.world.lighting import direct
from sim.world.scene import Scene, build

pytestmark = pytest.mark.usefixtures("opengl")

EUROC = euroc_like(GRADES["adis16448"].noise).cameras[0].camera
FISHEYE = PinholeEquidistant(320, 260, 190.98, 190.97, 164.9, 126.9, (0.0034, 0.0007, -0.0021, 0.0002))
WIDE = PinholeEquidistant(512, 512, 190.978, 190.973, 254.932, 256.897, (0.00348, 0.000715, -0.00205, 0.000203))
CIRCLE = PinholeEquidistant(200, 180, 60.0, 60.0, 99.5, 89.5, (-0.08, 0.0, 0.0, 0.0))  # turns back at 1.36 * 60 px
BARREL = PinholeRadtan(200, 180, 100.0, 100.0, 99.5, 89.5, (-0.3, 0.0, 0.0, 0.0))  # at 0.70 * 100 px

BALL = 0.015  # m


def pose(rotation: tuple[float, float, float], p: tuple[float, float, float]) -> Floats:
    T_WC = np.eye(4)
    T_WC[:3, :3], T_WC[:3, 3] = so3.exp(np.array(rotation)), p
    return T_WC


def scene_of_balls(places: Vectors) -> Scene:
    """White balls in the dark."""
    spec = mujoco.MjSpec()
    spec.visual.headlight.ambient = [1.0, 1.0, 1.0]
    spec.visual.headlight.diffuse = [0.0, 0.0, 0.0]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.visual.quality.offsamples = 0
    spec.visual.quality.numslices = spec.visual.quality.numstacks = 64
    for p in places:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[BALL, 0, 0], pos=p, rgba=[1, 1, 1, 1])
    return Scene(Layout((-10.0, -10.0, 0.0), (10.0, 10.0, 20.0)), spec.compile())


def centroid(image: Image, near: Pixels) -> Pixels:
    u, v = np.rint(near).astype(int)
    rows, columns = np.mgrid[v - 8 : v + 9, u - 8 : u + 9]
    light = image[rows, columns].astype(np.float64)
    place: Pixels = np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum()
    return place


def middle(camera: Camera, p_CF: Vectors) -> Pixels:
    """Centroid of the outline that a lens gives a ball at `p_CF` (3,): of an oval, not where its centre is imaged."""
    far = np.linalg.norm(p_CF)
    towards = p_CF / far
    side = np.linalg.svd(towards[None])[2][1:]  # (2, 3), across
    turn = np.linspace(0.0, 2.0 * np.pi, 65)[:-1, None]
    across = np.cos(turn) * side[0] + np.sin(turn) * side[1]
    uv = camera.project(towards + np.tan(np.arcsin(BALL / far)) * across)
    after = np.roll(uv, -1, axis=0)
    areas = uv[:, :1] * after[:, 1:] - uv[:, 1:] * after[:, :1]
    return np.asarray(((uv + after) * areas).sum(axis=0) / (3.0 * areas.sum()))


def projection_errors(camera: Camera, uv: Pixels, metres: float) -> Pixels:
    """(N, 2) px, of balls whose centres are imaged at `uv` (N, 2)."""
    p_CF = metres * camera.unproject(uv)
    T_WC = pose((0.3, -1.2, 0.7), (1.0, -2.0, 3.0))
    with SceneCamera(scene_of_balls(p_CF @ T_WC[:3, :3].T + T_WC[:3, 3]), camera) as eye:
        image = eye.linear_image(T_WC)
    return np.array([centroid(image, x) - middle(camera, p) for x, p in zip(uv, p_CF, strict=True)])


@pytest.mark.parametrize(("camera", "metres"), [(EUROC, 3.0), (FISHEYE, 1.3), (WIDE, 1.3)])
def test_points_appear_where_the_camera_model_projects_them(camera: Camera, metres: float) -> None:
    grid = np.meshgrid(*(np.linspace(15, n - 16, n // 26) for n in (camera.width, camera.height)))
    uv = np.stack(grid, axis=-1).reshape(-1, 2)
    uv += np.random.default_rng(1).uniform(-4.0, 4.0, uv.shape)
    errors = projection_errors(camera, uv, metres)
    lengths = np.linalg.norm(errors, axis=1)
    assert np.sqrt(np.mean(errors**2, axis=0)).max() < 0.04  # px, balls of 5 px
    assert np.percentile(lengths, 97) < 0.1
    assert lengths.max() < 0.15
    assert np.abs(errors.mean(axis=0)).max() < 0.01


def test_points_on_the_seams_between_faces_appear_where_they_are_projected() -> None:
    faces = [face for row in faces_of(WIDE) for face in row]
    seams_u, seams_v = ({x.start - 0.5 for x in slices} - {-0.5} for slices in zip(*map(tile, faces), strict=True))
    assert len(seams_u) > 0 and len(seams_v) > 0
    along = [x for x in np.linspace(20.0, 491.0, 24) if min(abs(x - s) for s in seams_u | seams_v) > 12.0]
    uv = np.array([(s, x) for s in seams_u for x in along] + [(x, s) for s in seams_v for x in along])
    errors = projection_errors(WIDE, uv, 1.3)
    assert np.sqrt(np.mean(errors**2, axis=0)).max() < 0.04
    assert np.linalg.norm(errors, axis=1).max() < 0.15


def tile(face: Face) -> tuple[slice, slice]:
    return face.columns, face.rows


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


def test_a_room_looks_the_same_however_the_picture_is_cut(furnished: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a seam would spoil, another cut shows whole."""
    T_WC = pose((-1.9, 0.3, -0.3), (0.5, -0.4, 1.4))
    with SceneCamera(furnished, WIDE) as eye:
        image = eye.linear_image(T_WC).astype(float)
    seams = [face.columns.start for face in faces_of(WIDE)[0]][1:]
    monkeypatch.setattr("sim.camera.faces._THRIFTY", 1.7)
    monkeypatch.setattr("sim.camera.render.atlases_of", atlases_of.__wrapped__)
    assert not {face.columns.start for face in faces_of(WIDE)[0]} & set(seams)
    with SceneCamera(furnished, WIDE) as eye:
        other = eye.linear_image(T_WC).astype(float)
    off = np.median(np.abs(image - other) / image.mean(), axis=0)  # by column
    assert np.median(off) < 0.005
    assert max(off[s - 1 : s + 1].max() for s in seams) < 2.0 * np.median(off)


@pytest.mark.parametrize("camera", [CIRCLE, BARREL], ids=["fisheye", "radial"])
def test_what_the_lens_does_not_see_is_black(furnished: Scene, camera: Camera) -> None:
    with SceneCamera(furnished, camera) as eye:
        image = eye.linear_image(pose((-1.9, 0.3, -0.3), (0.5, -0.4, 1.4)))
    u, v = np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height)))
    radius = np.hypot(u - camera.cx, v - camera.cy)
    turns_back = camera.fx * np.sqrt(-1.0 / (3.0 * camera.distortion[0])) * (2.0 / 3.0)  # px
    assert np.all(image[radius > turns_back + 1.0] == 0)
    assert np.all(image[radius < turns_back - 1.0] > 0)


def test_a_lens_that_sees_all_around_is_refused(furnished: Scene) -> None:
    around = PinholeEquidistant(400, 400, 60.0, 60.0, 199.5, 199.5)
    with pytest.raises(RenderError, match="too far backwards"):
        SceneCamera(furnished, around)


def test_baked_light_lies_where_the_lamps_throw_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """On grey surfaces, brightness in the image is irradiance at the point that the pixel sees."""
    monkeypatch.setattr("sim.world.scene.paint", lambda surface, *_: np.full(surface.texels[::-1], 0.3, np.float32))
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
        expected = direct(layout, points, normals).sum(axis=0)
        bare = (gap < 1e-3) & (image < LINEAR_MAX)
        assert bare.mean() > 0.3
        assert np.corrcoef(expected[bare], image[bare])[0, 1] > 0.97

"""Tangent planes under the wheels against their geometry, and against MuJoCo's own height field."""

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from navcore.arrays import Floats
from sim.platforms.ground import Ground
from sim.platforms.rover import MODEL
from sim.platforms.tread import Tread

RADIUS = 0.12
PLANES = int(mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT)
CELL, CELLS, HIGHEST = 0.01, 257, 0.05  # m, number, m of the height field


def ground() -> Ground:
    return Ground(64e-6, np.random.default_rng(3))


def test_a_wheel_above_its_place_touches_its_plane_and_goes_along_it() -> None:
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    turn = Rotation.from_euler("ZYX", [0.7, 0.03, -0.02])
    q_wxyz, v, omega = np.roll(turn.as_quat(), 1).tolist(), [1.0, 0.4, 0.0], [0.1, -0.1, 0.8]
    planes = Tread(model, ground(), 10).under([0.3, -0.2, 0.35], q_wxyz, v, omega)
    place, quat_wxyz = planes[:, :12].reshape(10, 4, 3), planes[:, 12:].reshape(10, 4, 4)
    normal = Rotation.from_quat(np.roll(quat_wxyz, -1, axis=-1).reshape(-1, 4)).apply([0.0, 0.0, 1.0]).reshape(10, 4, 3)
    hubs = np.stack([model.body(f"hub{i}").pos for i in range(4)])
    arms = turn.apply(hubs)
    speed = v + np.cross(turn.apply(omega), arms)
    xy = ([0.3, -0.2, 0.35] + arms + 0.001 * np.arange(10)[:, None, None] * speed)[..., :2]
    np.testing.assert_allclose(place[..., :2], xy, atol=1e-12)
    height, slope_x, slope_y = np.moveaxis(ground().at(xy[..., 0], xy[..., 1]), -1, 0)
    centre = np.stack([xy[..., 0], xy[..., 1], height + RADIUS], axis=-1)
    np.testing.assert_allclose(((centre - place) * normal).sum(axis=-1), RADIUS, atol=1e-12)
    for ahead in ([1.0, 0.0], slope_x), ([0.0, 1.0], slope_y):
        way = np.stack([np.full((10, 4), ahead[0][0]), np.full((10, 4), ahead[0][1]), ahead[1]], axis=-1)
        np.testing.assert_allclose((way * normal).sum(axis=-1), 0.0, atol=1e-12)


def driven_straight(on_field: bool) -> Floats:
    """(2000, 3): height [m], pitch and roll [rad] every millisecond, at half a metre a second."""
    spec = mujoco.MjSpec.from_file(str(MODEL))
    if on_field:
        along = (np.arange(CELLS) - CELLS // 2) * CELL
        x, y = np.meshgrid(along, along)
        heights = (0.5 + ground().at(x, y)[..., 0] / (2.0 * HIGHEST)).ravel()
        size = [along[-1], along[-1], 2.0 * HIGHEST, 0.1]
        spec.add_hfield(name="field", nrow=CELLS, ncol=CELLS, size=size, userdata=heights.tolist())
        field = {"type": mujoco.mjtGeom.mjGEOM_HFIELD, "hfieldname": "field", "pos": [0.0, 0.0, -HIGHEST]}
        spec.worldbody.add_geom(name="field", contype=0, conaffinity=0, **field)
        for pair in spec.pairs:
            pair.geomname1 = "field"
        spec.memory = 2**26
    model = spec.compile()
    if on_field:
        model.hfield_data[:] = heights  # the compiler stretches them to 0 and 1
    data = mujoco.MjData(model)
    tread = Tread(model, ground(), 1)
    data.qpos[0], data.qpos[2] = -0.9, 0.354
    rows = []
    for k in range(3500):
        data.ctrl[2:] = 0.5 / RADIUS if k > 1000 else 0.0
        if not on_field:
            p, q, v, omega = np.split(np.concatenate([data.qpos[:7], data.qvel[:6]]), [3, 7, 10])
            mujoco.mj_setState(model, data, tread.under(p.tolist(), q.tolist(), v.tolist(), omega.tolist())[0], PLANES)
        mujoco.mj_step(model, data)
        _, pitch, roll = Rotation.from_quat(np.roll(data.qpos[3:7], -1)).as_euler("ZYX")
        rows.append((data.qpos[2], pitch, roll))
    return np.array(rows[1500:])


def test_the_rover_heaves_and_sways_as_on_mujocos_height_field() -> None:
    """The field has flat facets, several contacts a wheel, and wheels that touch beside their middle: .3 mm apart."""
    planes, field = driven_straight(on_field=False), driven_straight(on_field=True)
    for ours, theirs, largest in zip(
        (planes - planes.mean(axis=0)).T, (field - field.mean(axis=0)).T, (2e-4, 8e-4, 8e-4), strict=True
    ):
        assert np.std(theirs) > 2.0 * largest
        assert np.corrcoef(ours, theirs)[0, 1] > 0.99
        assert np.std(ours - theirs) < largest

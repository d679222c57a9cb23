import mujoco
import numpy as np
import pytest

from navcore.arrays import Vectors
from sim.camera.gl import make_context
from sim.errors import ConfigError
from sim.world import Layout, Scene, Switches, build, make_layout
from sim.world.lighting import direct, irradiance


@pytest.fixture(scope="module")
def layout(paths: dict[str, Vectors]) -> Layout:
    return make_layout("room", paths["flight"], np.random.default_rng(1))


@pytest.fixture(scope="module")
def scene(layout: Layout) -> Scene:
    return build(layout, np.random.default_rng(2), switches=Switches.of(4, np.random.default_rng(3)))


def test_lamps_begin_on_and_go_out_and_on_each_at_its_own_times() -> None:
    switches = Switches.of(6, np.random.default_rng(1))
    on = np.array([switches.on(t) for t in np.arange(0.0, 200.0, 0.05)])
    assert on[0].all()
    changes = [np.flatnonzero(np.diff(lamp.astype(int))) for lamp in on.T]
    assert all(len(c) >= 8 for c in changes)
    assert all(np.diff(c).min() * 0.05 > 1.9 and np.diff(c).max() * 0.05 < 25.1 for c in changes)
    assert len({tuple(c) for c in changes}) == 6


def test_with_all_lamps_on_a_switched_scene_is_the_constant_one(layout: Layout, scene: Scene) -> None:
    constant = build(layout, np.random.default_rng(2))
    np.testing.assert_array_equal(scene.model.tex_data, constant.model.tex_data)
    assert constant.light(3.0).all() and not list(constant.relit(np.zeros(4, dtype=bool)))
    for k, rgb in scene.relit(np.ones(4, dtype=bool)):
        first = scene.model.tex_adr[k]
        np.testing.assert_array_equal(rgb, scene.model.tex_data[first : first + len(rgb)])


def test_a_lamp_takes_away_its_own_light_and_no_other(layout: Layout, scene: Scene) -> None:
    """Decoded floor texels, against the light that is worked out at the same places."""
    on = np.array([True, True, False, True])
    floor = next(k for k, s in enumerate(layout.surfaces) if s.normal[2] == 1.0)
    surface, relit = layout.surfaces[floor], dict(scene.relit(on))[floor]
    width, height = surface.texels
    first = scene.model.tex_adr[floor]
    before = scene.model.tex_data[first : first + 3 * width * height].reshape(height, width, 3)[..., 0] / 255.0
    after = relit.reshape(height, width, 3)[..., 0] / 255.0
    usable = (before > 0.3) & (before < 0.99)
    points, (rows, columns) = surface.grid(0.5)
    light = direct(layout, points, np.tile(surface.normal, (len(points), 1)))
    weights = np.concatenate([s.area * np.ones(1) for s in layout.surfaces])
    mean = (
        sum(
            w * direct(layout, p, np.tile(s.normal, (len(p), 1))).sum(axis=0).mean()
            for w, s, p in ((w, s, s.grid(0.3)[0]) for w, s in zip(weights, layout.surfaces, strict=True))
        )
        / weights.sum()
    )
    expected = irradiance(light / mean, on) / irradiance(light / mean, np.ones(4, dtype=bool))
    v = ((np.arange(rows) + 0.5) / rows * height).astype(int).repeat(columns)
    u = np.tile(((np.arange(columns) + 0.5) / columns * width).astype(int), rows)
    ratio = (after[v, u] / before[v, u]) ** 2.2
    good = usable[v, u]
    assert good.mean() > 0.8
    assert np.median(np.abs(ratio - expected)[good]) < 0.02
    assert expected.min() < 0.75 < 0.9 < expected.max()


def test_there_must_be_a_switch_for_each_lamp(layout: Layout) -> None:
    with pytest.raises(ConfigError, match="3 switches, and 4 lamps"):
        build(layout, np.random.default_rng(1), switches=Switches.of(3, np.random.default_rng(1)))


@pytest.mark.usefixtures("opengl")
def test_new_textures_show_once_they_are_uploaded(layout: Layout) -> None:
    scene = build(layout, np.random.default_rng(2), switches=Switches.of(4, np.random.default_rng(3)))
    model, data = scene.model, mujoco.MjData(scene.model)
    mujoco.mj_forward(model, data)
    gl = make_context(160, 120)
    model.vis.global_.offwidth, model.vis.global_.offheight = 160, 120
    context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
    view, camera = mujoco.MjvScene(model, maxgeom=model.ngeom + 1), mujoco.MjvCamera()
    camera.lookat[:], camera.distance = (0.0, 0.0, 1.0), 3.0
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, everything, view)

    def mean() -> float:
        pixels = np.empty((120, 160, 3), dtype=np.uint8)
        mujoco.mjr_render(mujoco.MjrRect(0, 0, 160, 120), view, context)
        mujoco.mjr_readPixels(pixels, None, mujoco.MjrRect(0, 0, 160, 120), context)
        return float(pixels.mean())

    lit = mean()
    for on, share in ((np.zeros(4, dtype=bool), (0.1, 0.7)), (np.ones(4, dtype=bool), (0.999, 1.001))):
        for k, rgb in scene.relit(on):
            model.tex_data[model.tex_adr[k] : model.tex_adr[k] + len(rgb)] = rgb
            mujoco.mjr_uploadTexture(model, context, k)
        assert share[0] < mean() / lit < share[1]
    context.free()
    gl.free()

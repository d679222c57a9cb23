from dataclasses import replace

import numpy as np
import pytest

from navcore.calibration import CameraMount
from navcore.camera import PinholeEquidistant
from sim.camera.exposure import EXPOSURE_S, MAX_STEP_PX, Shutter
from sim.camera.render import SceneCamera
from sim.imu import GRADES
from sim.motion import EPOCH_NS, Motion
from sim.radiance import LINEAR_MAX
from sim.rig import euroc_like
from sim.world import Layout, make_layout
from sim.world.scene import build

MOUNT = euroc_like(GRADES["adis16448"].noise).cameras[0]
WIDE = replace(MOUNT, camera=PinholeEquidistant(512, 512, 191.0, 191.0, 255.0, 257.0, (0.0035, 0.0007, -0.002, 0.0002)))
CIRCLE = replace(MOUNT, camera=PinholeEquidistant(400, 360, 120.0, 120.0, 199.5, 179.5, (-0.08, 0.0, 0.0, 0.0)))
FLYING_NS = EPOCH_NS + 9_000_000_000


@pytest.fixture(scope="module")
def layout() -> Layout:
    return make_layout("room", np.zeros((1, 3)), np.random.default_rng(1))


@pytest.fixture(scope="module")
def shutter(flight: Motion, layout: Layout) -> Shutter:
    return Shutter(flight, MOUNT, layout)


@pytest.mark.parametrize("mount", [MOUNT, WIDE, CIRCLE], ids=["euroc", "beyond 90 degrees", "a circle"])
def test_sub_frames_are_close_enough_everywhere_in_the_image(
    mount: CameraMount, flight: Motion, layout: Layout
) -> None:
    shutter = Shutter(flight, mount, layout)
    points, _ = layout.landmarks(3000, np.random.default_rng(2))
    counts, longest = [], []
    for t_ns in range(FLYING_NS, FLYING_NS + 8_000_000_000, 1_000_000_000):
        stamps = shutter.sub_stamps(t_ns, 0.045)
        counts.append(len(stamps))
        poses = shutter.poses(stamps)
        p_CF = (points - poses[:, None, :3, 3]) @ poses[:, :3, :3]
        ray = points - poses[0, :3, 3]
        far = np.linalg.norm(ray, axis=1)
        free = layout.distance(np.tile(poses[0, :3, 3], (len(far), 1)), ray / far[:, None]) > far - 0.01
        seen = free & mount.camera.visible(p_CF).all(axis=0)
        steps = np.linalg.norm(np.diff(mount.camera.project(p_CF[:, seen]), axis=0), axis=2)
        longest.append(steps.max(initial=0.0))
        assert abs((stamps - t_ns).mean()) < 1.0
    assert max(counts) > 2
    assert 0.5 * MAX_STEP_PX < max(longest) <= MAX_STEP_PX  # and no closer than it takes


def test_a_body_at_rest_needs_one_sub_frame(shutter: Shutter) -> None:
    assert len(shutter.sub_stamps(EPOCH_NS + 1_000_000_000, 0.045)) == 1


@pytest.mark.usefixtures("opengl")
def test_blur_takes_detail_away_and_keeps_the_light(shutter: Shutter, layout: Layout) -> None:
    scene = build(layout, np.random.default_rng(1))
    with SceneCamera(scene, MOUNT.camera) as camera:
        images = [shutter.expose(camera, FLYING_NS, EXPOSURE_S[k]) / LINEAR_MAX for k in (0, 3, 5)]
    detail = [np.abs(np.diff(im, axis=1)).mean() for im in images]
    assert detail[0] > 1.1 * detail[1] > 1.2 * detail[2]
    assert images[2].mean() == pytest.approx(images[0].mean(), rel=0.01)

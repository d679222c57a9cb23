"""What images cost. Run with `tox -e bench`; figures are printed, of one core: frames per second of CPU time."""

import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from navcore.calibration import CameraMount
from navcore.camera import PinholeEquidistant
from sim import simulate_motion
from sim.camera.exposure import EXPOSURE_S, Shutter
from sim.camera.gl import make_context
from sim.camera.render import FINE, SceneCamera
from sim.imu import GRADES
from sim.motion import Motion
from sim.record import record
from sim.rig import euroc_like
from sim.world import Scene, build, make_layout

pytestmark = [pytest.mark.bench, pytest.mark.usefixtures("opengl")]

SECONDS, FRAMES = 10.0, 40
EUROC = euroc_like(GRADES["adis16448"].noise).cameras[0]
TUM_VI = CameraMount(
    PinholeEquidistant(512, 512, 190.978, 190.973, 254.932, 256.897, (0.00348, 0.000715, -0.00205, 0.000203)),
    EUROC.T_BC,
)


@pytest.fixture(scope="module")
def motion() -> Motion:
    return simulate_motion("quadrotor", SECONDS, 1, True)


@pytest.fixture(scope="module")
def room(motion: Motion) -> Scene:
    rng = np.random.default_rng(1)
    return build(make_layout("room", motion.p_WB, rng), rng)


def frame_ms(work: Callable[[int], object], stamps: list[int]) -> float:
    """CPU time of a frame, the median, after one that is not counted."""
    work(stamps[0])
    spent = []
    for t_ns in stamps[1:]:
        start = time.process_time()
        work(t_ns)
        spent.append(time.process_time() - start)
    return 1e3 * float(np.median(spent))


def linear_ms(motion: Motion, room: Scene, mount: CameraMount, severity: int) -> float:
    shutter = Shutter(motion, mount, room.layout)
    stamps = np.linspace(motion.start_ns + 10**8, motion.end_ns - 10**8, FRAMES).astype(np.int64).tolist()
    with SceneCamera(room, mount.camera) as eye:
        return frame_ms(lambda t_ns: shutter.expose(eye, t_ns, EXPOSURE_S[severity]), stamps)


def test_a_plain_picture_takes_less_than_20_ms(motion: Motion, room: Scene) -> None:
    """MuJoCo alone: a pinhole of 752 x 480 px, one sample each, rendered and read."""
    shutter = Shutter(motion, EUROC, room.layout)
    stamps = np.linspace(motion.start_ns, motion.end_ns, FRAMES).astype(np.int64).tolist()
    rectangle, pixels = mujoco.MjrRect(0, 0, 752, 480), np.empty((480, 752, 3), dtype=np.uint8)
    room.model.vis.global_.offwidth, room.model.vis.global_.offheight = 752, 480
    gl = make_context(752, 480)
    context = mujoco.MjrContext(room.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
    data, drawn = mujoco.MjData(room.model), mujoco.MjvScene(room.model, maxgeom=room.model.ngeom + 1)
    mujoco.mj_forward(room.model, data)
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(room.model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), everything, drawn)
    drawn.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False

    def render(t_ns: int) -> None:
        T_WC = shutter.poses(np.array([t_ns]))[0]
        for eye in drawn.camera:
            eye.pos, eye.forward, eye.up = T_WC[:3, 3], T_WC[:3, 2], -T_WC[:3, 1]
            eye.frustum_near, eye.frustum_far, eye.frustum_center = 0.05, 60.0, 0.0
            eye.frustum_bottom, eye.frustum_top, eye.frustum_width = -0.0262, 0.0262, 0.0410
        mujoco.mjr_render(rectangle, drawn, context)
        mujoco.mjr_readPixels(pixels, None, rectangle, context)

    spent = frame_ms(render, stamps)
    context.free()
    gl.free()
    print(f"\nraw, 752 x 480: {spent:.1f} ms a frame, {1e3 / spent:.0f} frames/s")
    assert spent < 1e3 / 50.0


def test_a_recording_is_made_at_15_frames_a_second(tmp_path: Path) -> None:
    """Rendered, developed, encoded and on disk; what comes before the first image is not counted."""
    print("\nrecorded, 752 x 480:")
    for degrade, slowest in (("", 15.0), (f"motion_blur:3@0-{SECONDS:.0f}", 0.0)):
        done: list[tuple[float, float, int]] = []
        out = tmp_path / (degrade.partition(":")[0] or "clean")
        record(
            "quadrotor",
            SECONDS,
            1,
            out,
            degrade=degrade,
            moving_start=True,
            progress=lambda k, _, done=done: done.append((time.process_time(), time.perf_counter(), k)),  # type: ignore[misc]
        )
        cpu, wall, n = np.subtract((time.process_time(), time.perf_counter(), done[-1][2]), done[0])
        rates = f"{n / cpu:5.1f} frames/s ({n / wall:.1f} by the clock)"
        print(f"  {degrade or 'clean':20} {1e3 * cpu / n:6.1f} ms CPU, {rates}")
        assert len(list((out / "mav0" / "cam0" / "data").iterdir())) == done[-1][2]
        assert n / cpu >= slowest


def test_a_wide_fisheye_takes_no_more_than_twice_a_pinhole(motion: Motion, room: Scene) -> None:
    """Linear images: rendered, bent and averaged."""
    print(f"\nlinear images, {FINE} samples per pixel and axis:")
    spent = {}
    for name, mount in (("EuRoC 752 x 480", EUROC), ("TUM-VI 512 x 512", TUM_VI)):
        for severity in (0, 3):
            ms = spent[name, severity] = linear_ms(motion, room, mount, severity)
            print(f"  {name:18} motion_blur:{severity} {ms:7.1f} ms, {1e3 / ms:5.1f} frames/s")
    assert spent["TUM-VI 512 x 512", 0] < 2.0 * spent["EuRoC 752 x 480", 0]

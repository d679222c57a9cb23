"""Pictures of what there is: every scene from within, every platform by how it moves."""

from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import welch

from navcore.arrays import Image
from sim.errors import ConfigError
from sim.imu import ideal_samples
from sim.motion import Motion
from sim.platforms import DIFFICULTIES, PLATFORMS, simulate_motion
from sim.record import filmed
from sim.world import SCENES

SCENES_NAME, PLATFORMS_NAME = "scenes.jpg", "platforms.png"

_SECONDS = 40.0
_LOOKS = 4
_WIDTH = 300  # px of one view
_QUALITY = 88
_RATE_HZ = 1000.0  # fine enough to show what an IMU at 200 Hz averages away
_SHOWN_S = (20.0, 23.0)


def gallery(folder: Path, seed: int = 1) -> None:
    """Write `scenes.jpg`, a row of views for each scene, and `platforms.png`, a row of plots for each platform.

    Raises:
        ConfigError: there is no such folder.
        RenderError: there is no OpenGL here.
    """
    if not folder.is_dir():
        raise ConfigError(f"{folder}: no such folder")
    picture = np.vstack([_views(scene, seed) for scene in SCENES])
    done, data = cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))
    assert done
    (folder / SCENES_NAME).write_bytes(data.tobytes())
    _plots(seed).savefig(folder / PLATFORMS_NAME, dpi=80)


def _views(scene: str, seed: int) -> Image:
    """A scene from several places of one flight."""
    with filmed("quadrotor", _SECONDS, seed, scene=scene) as sequence:
        chosen = np.linspace(0.2, 0.95, _LOOKS) * (len(sequence.frames) - 1)
        images = [sequence.frames[k].images[0].load() for k in chosen.astype(int).tolist()]
    height = round(images[0].shape[0] * _WIDTH / images[0].shape[1])
    row = np.hstack([cv2.resize(image, (_WIDTH, height), interpolation=cv2.INTER_AREA) for image in images])
    for colour, shift in ((0, 1), (255, 0)):
        place = (8 + shift, 20 + shift)
        cv2.putText(row, scene, place, cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 1, cv2.LINE_AA)
    return np.asarray(row)


def _plots(seed: int) -> Figure:
    figure = Figure(figsize=(15.0, 3.4 * len(PLATFORMS)), layout="constrained")
    for axes, platform in zip(figure.subplots(len(PLATFORMS), 4, squeeze=False), PLATFORMS, strict=True):
        for difficulty in DIFFICULTIES:
            motion = simulate_motion(platform, _SECONDS, seed, difficulty=difficulty)
            _show(axes, motion, difficulty)
        axes[0].set(title=f"{platform}: path", xlabel="x [m]", ylabel="y [m]", aspect="equal")
        axes[1].set(title="speed", xlabel="s", ylabel="m/s")
        axes[2].set(title="specific force along z of B", xlabel="s", ylabel="m/s²")
        axes[3].set(title="its amplitude density, all axes", xlabel="Hz", ylabel="m/s²/√Hz")
        axes[0].legend(fontsize="small")
    return figure


def _show(axes: list[Axes], motion: Motion, label: str) -> None:
    force = ideal_samples(motion, _RATE_HZ).accel
    seconds = np.arange(len(force)) / _RATE_HZ
    shown = (seconds >= _SHOWN_S[0]) & (seconds < _SHOWN_S[1])
    axes[0].plot(*motion.p_WB[::20, :2].T, label=label, linewidth=0.9)
    axes[1].plot(np.arange(len(motion.v_WB))[::20] * motion.step_s, np.linalg.norm(motion.v_WB[::20], axis=1))
    axes[2].plot(seconds[shown], force[shown, 2], linewidth=0.7)
    frequency, density = welch(force, _RATE_HZ, nperseg=4096, axis=0)
    axes[3].loglog(frequency[1:], np.sqrt(density[1:].sum(axis=1)), linewidth=0.8)

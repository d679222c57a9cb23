"""An off-screen OpenGL context, and what to type when there is none."""

import os
import shutil
import subprocess
import sys
from typing import Any

from sim.errors import RenderError

PACKAGES = ("libegl1", "libegl-mesa0", "libgl1-mesa-dri", "libopengl0", "libgl1")
"""Debian packages of Mesa's software renderer; pip has none."""
INSTALL = f"apt-get update && apt-get install -y --no-install-recommends {' '.join(PACKAGES)}"
"""The line that installs it, for root."""


def make_context(width: int, height: int) -> Any:
    """A current context for `width` x `height` px: EGL, or OSMesa if the variable MUJOCO_GL says so.

    Raises:
        RenderError: no software GL on this machine; the message is the line to type.
    """
    try:
        if os.environ.get("MUJOCO_GL", "egl") == "osmesa":
            from mujoco.osmesa import GLContext
        else:
            from mujoco.egl import GLContext
        context = GLContext(width, height)
        context.make_current()
    except Exception as error:  # PyOpenGL raises whatever it runs into when a library is missing
        raise RenderError(f"no OpenGL here that renders without a screen ({error}); type: {INSTALL}") from error
    return context


def works() -> bool:
    """Whether a context can be had; asked in a process of its own, since a failed try stays in this one."""
    probe = "from sim.camera.gl import make_context; make_context(16, 16)"
    return subprocess.run([sys.executable, "-c", probe], capture_output=True, check=False).returncode == 0


def install() -> None:
    """Install Mesa's software renderer by apt-get.

    Raises:
        RenderError: not root, no apt-get, or it failed; the message is the line to type.
    """
    if os.geteuid() != 0 or shutil.which("apt-get") is None:
        raise RenderError(f"cannot install OpenGL without root and apt-get; as root on Debian type: {INSTALL}")
    result = subprocess.run(INSTALL, shell=True, capture_output=True, text=True, check=False)
    if result.returncode != 0 or not works():
        raise RenderError(f"installing OpenGL failed: {result.stderr.strip()[-300:]}; type: {INSTALL}")

"""Shared flights, and the reason to skip where nothing can be rendered."""

import pytest

from sim import simulate_motion
from sim.camera import gl
from sim.motion import Motion


@pytest.fixture(scope="session")
def flight() -> Motion:
    return simulate_motion("quadrotor", 20.0, seed=3)


@pytest.fixture(scope="session")
def opengl() -> None:
    if not gl.works():
        pytest.skip(f"no software OpenGL here; as root type: {gl.INSTALL}")

"""`python -m sim check-gl`: the OpenGL that images need."""

from dataclasses import dataclass

from rich.console import Console

from sim.camera import gl
from sim.errors import SimError


@dataclass(frozen=True)
class CheckGl:
    """Say whether images can be rendered here; exit with 1 if they cannot."""

    install: bool = False  # install Mesa's software renderer if it is missing (as root, by apt-get)

    def run(self, console: Console) -> None:
        """Check, and install if that is asked for and needed."""
        if not gl.works():
            if not self.install:
                raise SimError(f"no OpenGL here that renders without a screen; as root type: {gl.INSTALL}")
            gl.install()
        console.print("OpenGL renders")

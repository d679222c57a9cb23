"""`python -m sim`: recordings, pictures, the OpenGL they need."""

from typing import Annotated

import tyro

from navcore.command_line import command_line
from sim.commands.check_gl import CheckGl
from sim.commands.degrade import Degrade
from sim.commands.fleet import Fleet
from sim.commands.gallery import Gallery
from sim.commands.record import Record
from sim.commands.replay import Replay
from sim.commands.severities import Severities
from sim.commands.strip import Strip
from sim.errors import SimError


def main() -> None:
    """Parse the command line and run it."""
    command = tyro.cli(
        Annotated[Record, tyro.conf.subcommand("record")]
        | Annotated[Fleet, tyro.conf.subcommand("fleet")]
        | Annotated[Degrade, tyro.conf.subcommand("degrade")]
        | Annotated[Replay, tyro.conf.subcommand("replay")]
        | Annotated[Severities, tyro.conf.subcommand("severities")]
        | Annotated[Strip, tyro.conf.subcommand("strip")]
        | Annotated[Gallery, tyro.conf.subcommand("gallery")]
        | Annotated[CheckGl, tyro.conf.subcommand("check-gl")],
        prog="python -m sim",
    )
    with command_line(SimError, resumes=True) as console:
        command.run(console)


if __name__ == "__main__":
    main()

"""`python -m ipnet`: labels, networks, motion models, and what they say of a recording's biases."""

from collections.abc import Callable
from typing import Protocol

import tyro
from rich.console import Console

from ipnet.commands.device import Device
from ipnet.commands.export import Export
from ipnet.commands.join import Join
from ipnet.commands.label import Label
from ipnet.commands.learn import Learn
from ipnet.commands.predict import Predict
from ipnet.commands.rivals import Corrector, Recursive, WindowMean
from ipnet.commands.score import Score
from ipnet.commands.train import Train
from ipnet.errors import IpnetError
from navcore.command_line import command_line


class Command(Protocol):
    """Options as a dataclass, and what is done with them; torch is imported in `run` only."""

    def run(self, console: Console) -> None:
        """Do it."""
        ...


COMMANDS: dict[str, Callable[..., Command]] = {
    "label": Label,
    "device": Device,
    "train": Train,
    "learn": Learn,
    "export": Export,
    "predict": Predict,
    "score": Score,
    "join": Join,
    "window-mean": WindowMean,
    "recursive": Recursive,
    "corrector": Corrector,
}


def main() -> None:
    """Parse the command line and run it."""
    command: Command = tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="python -m ipnet")
    with command_line(IpnetError) as console:
        command.run(console)


if __name__ == "__main__":
    main()

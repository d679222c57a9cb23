"""`python -m ipnet`: labels, networks, motion models, and what they say of a recording's biases."""

import sys
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
from navcore.errors import NavcoreError


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
    console = Console(stderr=True, soft_wrap=True)
    try:
        command.run(console)
    except (IpnetError, NavcoreError) as error:
        console.print(f"error: {error}", style="red", markup=False, highlight=False)
        sys.exit(1)
    except KeyboardInterrupt:
        console.print("interrupted")
        sys.exit(130)


if __name__ == "__main__":
    main()

"""How every `python -m PACKAGE` ends: an expected error is one line, and so is an interrupt."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console

from navcore.errors import NavcoreError


@contextmanager
def command_line(*errors: type[Exception], resumes: bool = False) -> Iterator[Console]:
    """The console for what a command says as it runs, apart from its results.

    Args:
        errors: bases of the exceptions that are expected, beside navcore's own.
        resumes: what was interrupted goes on when it is asked for again.

    Raises:
        SystemExit: 1 after an expected error, 130 after an interrupt; the console has said why.
    """
    console = Console(stderr=True, soft_wrap=True)
    expected: tuple[type[Exception], ...] = (NavcoreError, *errors)
    try:
        yield console
    except expected as error:
        console.print(f"error: {error}", style="red", markup=False, highlight=False)
        sys.exit(1)
    except KeyboardInterrupt:
        console.print("interrupted; the same command goes on where it stopped" if resumes else "interrupted")
        sys.exit(130)

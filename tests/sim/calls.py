"""The command line of the simulator, as a test calls it."""

import pytest

from sim.__main__ import main


def call(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    """The exit code of `python -m sim` with these arguments."""
    monkeypatch.setattr("sys.argv", ["python -m sim", *map(str, arguments)])
    try:
        main()
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0

"""The progress bar of a study: its length is time, its text counts cells and images."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from eval.progress import Progress

_PACE_S = 600.0  # the pace of the last minutes tells what is left


@contextmanager
def study_bar(console: Console) -> Iterator[Callable[[Progress], None]]:
    """A bar; what it gives is told how far the study is. The time it will take is printed when it begins."""
    columns = (BarColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), TimeRemainingColumn())
    with Bar(*columns, console=console, speed_estimate_period=_PACE_S) as bar:
        task = bar.add_task("preparing", total=None)
        begun = False

        def show(now: Progress) -> None:
            nonlocal begun
            if not begun and now.workers:
                console.print(expectation(now))
            begun = True
            images = f", {now.images}/{now.all_images} images" if now.all_images else ""
            text = f"{now.cells}/{now.all_cells} cells{images}"
            bar.update(task, description=text, completed=now.cost_s, total=max(now.all_cost_s, 1e-9))

        yield show


def expectation(now: Progress) -> str:
    """What is to be done and how long it takes, in a line."""
    minutes = now.expected_s / 60.0
    time = f"{minutes / 60.0:.1f} hours" if minutes >= 100.0 else _counted(max(1, round(minutes)), "minute")
    images = f" and {_counted(now.all_images, 'image')}" if now.all_images else ""
    cells, workers = _counted(now.all_cells - now.cells, "cell"), _counted(now.workers, "worker")
    return f"{cells}{images} to make: about {time} on {workers}"


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"

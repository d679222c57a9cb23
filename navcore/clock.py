"""CPU time by stage."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def stage(stages: dict[str, float], name: str) -> Iterator[None]:
    """Adds the CPU seconds that this thread spends inside to `stages[name]`."""
    begin = time.thread_time()
    try:
        yield
    finally:
        stages[name] = stages.get(name, 0.0) + time.thread_time() - begin

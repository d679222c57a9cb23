"""A Dask scheduler and workers as processes of their own, as on a cluster."""

import os
import subprocess
import sys
from pathlib import Path
from time import monotonic, sleep

from distributed import Client

_ROOT = Path(__file__).parents[2]
_START_S = 60.0


class Processes:
    """A scheduler with as many workers as are added; `close` ends them all."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "scheduler.json"
        self._folder = folder
        self._all = [self._start("scheduler", "--port", "0", "--dashboard-address", ":0")]
        wait_until(self._file.is_file)
        self.client = Client(scheduler_file=str(self._file), timeout=_START_S)
        self.address = self.client.scheduler.address

    def add_worker(self, *options: str) -> subprocess.Popen[bytes]:
        """Start one more; it is there once the scheduler knows it."""
        plain = ("--no-nanny", "--no-dashboard", "--local-directory", str(self._folder))
        worker = self._start("worker", "--nthreads", "1", *plain, *options)
        self._all.append(worker)
        return worker

    def workers(self) -> int:
        return len(self.client.scheduler_info(n_workers=-1)["workers"])

    def close(self) -> None:
        self.client.close()
        for process in self._all:
            process.kill()
        for process in self._all:
            process.wait()

    def _start(self, what: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", "--scheduler-file", str(self._file), *options]
        environment = os.environ | {"PYTHONPATH": str(_ROOT)}
        log = (self._folder / f"{what}.log").open("ab")
        return subprocess.Popen(command, env=environment, cwd=self._folder, stdout=log, stderr=log)


def wait_until(true, seconds: float = _START_S) -> None:
    """Wait for something that other processes do."""
    end = monotonic() + seconds
    while not true():
        assert monotonic() < end, f"waited {seconds} s in vain"
        sleep(0.05)

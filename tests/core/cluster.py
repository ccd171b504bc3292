"""A Dask cluster of two workers on this machine, for tests."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from locked import locked


class Cluster:
    """A scheduler and workers as processes on this machine, as `dask scheduler` starts them."""

    def __init__(self, folder: Path, workers: int) -> None:
        self.file = folder / "scheduler.json"
        self.environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
        self.folder = folder
        self.processes = [self.start("scheduler", "--no-dashboard", "--host", "127.0.0.1",
                                     "--port", "0")]  # fmt: skip
        self.workers = self.more(workers)

    def more(self, count: int) -> "list[subprocess.Popen[bytes]]":
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard")
        started = [self.start("worker", *options) for _ in range(count)]
        self.processes += started
        return started

    def start(self, what: str, *options: str) -> "subprocess.Popen[bytes]":
        return subprocess.Popen(
            [sys.executable, "-m", "dask", what, "--scheduler-file", str(self.file), *options],
            cwd=self.folder, env=self.environment, stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )  # fmt: skip

    @property
    def name(self) -> str:
        """The scheduler's address, from a file that it makes first and fills afterwards."""
        from distributed.utils import json_load_robust

        written = json_load_robust(self.file, timeout=60)
        return str(written["address"]).replace("tcp://", "dask://")

    def stop(self) -> None:
        for process in self.processes:
            process.kill()
            process.wait()


@contextmanager
def two_workers(folder: Path) -> Iterator[Cluster]:
    """Give a cluster once both workers are there, where Dask is (`locked`)."""
    distributed = locked("distributed", "dask")
    started = Cluster(folder, 2)
    try:
        address = started.name.replace("dask://", "tcp://")
        with distributed.Client(address, timeout=60, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
            yield started
    finally:
        started.stop()

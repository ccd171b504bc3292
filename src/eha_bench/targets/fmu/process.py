"""An FMU's library in a separate process, asked over a socket."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from time import monotonic
from typing import Any

from eha_bench.core.errors import TargetFault
from eha_bench.targets.fmu.description import Binary, Variable

LEAVE = "leave"
"""Asked of a process last; one that hears nothing more without it has lost its owner."""
_PATIENCE = 5.0
"""Time for a process to leave by itself, s."""
_GLANCE = 0.2
"""How often it is looked whether a stop was asked for, s."""
_GRACE = 1.0
"""Time for an answer after a stop was asked for, s."""


class Process:
    """What `instance.Library` offers, run elsewhere; a crash there is a fault here."""

    def __init__(
        self,
        binary: Binary,
        folder: Path,
        answers_within: float,
        stopping: Callable[[], bool],
    ) -> None:
        """Start the process and load the FMU there.

        Args:
            binary: what to load.
            folder: where the FMU was unpacked.
            answers_within: time for each answer, s; after that the process is ended.
            stopping: whether a stop was asked for, which ends a process that does not answer.

        Raises:
            TargetFault: the binary cannot be loaded, or crashes.
            KeyboardInterrupt: a stop was asked for, and it did not answer.
        """
        self._patience = answers_within
        self.stopping: Callable[[], bool] = stopping
        ours, theirs = socket.socketpair()
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        self._process = subprocess.Popen(
            [
                sys.executable, "-m", "eha_bench.targets.fmu.worker", str(theirs.fileno()),
                str(folder),
            ],
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            env=environment,
        )  # fmt: skip
        theirs.close()
        self._connection: Connection[Any, Any] = Connection(ours.detach())
        try:
            self._ask("load", binary, folder)
        except (TargetFault, KeyboardInterrupt):
            self.close()
            raise

    @property
    def alive(self) -> bool:
        """Whether it may still be asked."""
        return self._process.poll() is None

    def start(self, stop: float, values: Mapping[Variable, float]) -> None:
        """As `Library.start`."""
        self._ask("start", stop, dict(values))

    def get(self, variables: tuple[Variable, ...], time: float) -> dict[str, float]:
        """As `Library.get`."""
        found: dict[str, float] = self._ask("get", variables, time, time=time)
        return found

    def tick(
        self,
        values: Mapping[Variable, float],
        time: float,
        length: float,
        count: int,
        variables: tuple[Variable, ...],
    ) -> dict[str, float]:
        """As `Library.tick`."""
        found: dict[str, float] = self._ask(
            "tick", dict(values), time, length, count, variables, time=time
        )
        return found

    def stop(self) -> None:
        """As `Library.stop`; a process that is gone has stopped."""
        with contextlib.suppress(TargetFault):
            self._ask("stop")

    def close(self) -> None:
        """End the process."""
        with contextlib.suppress(OSError):
            self._connection.send((LEAVE, ()))
        self._connection.close()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _ask(self, name: str, *arguments: Any, time: float | None = None) -> Any:
        try:
            self._connection.send((name, arguments))
            self._await(time)
            fault, value = self._connection.recv()
        except (EOFError, OSError) as error:
            raise TargetFault(self._crash(time)) from error
        if fault is not None:
            raise TargetFault(fault)
        return value

    def _await(self, time: float | None) -> None:
        """Wait for an answer, but not for ever, and hardly any longer once a stop is asked for."""
        until = monotonic() + self._patience
        leaving = False
        while not self._connection.poll(min(_GLANCE, max(until - monotonic(), 0.0))):
            if not leaving and self.stopping():
                leaving, until = True, min(until, monotonic() + _GRACE)
            if monotonic() < until:
                continue
            self._process.kill()
            if leaving:
                raise KeyboardInterrupt
            at = f" at {time:.6g} s" if time is not None else ""
            raise TargetFault(f"the FMU does not answer{at}: waited {self._patience:g} s")

    def _crash(self, time: float | None) -> str:
        at = f" at {time:.6g} s" if time is not None else ""
        try:
            code = self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            return f"the FMU's process does not answer{at}"
        how = f"status {code}"
        if code < 0:
            with contextlib.suppress(ValueError):
                how = signal.Signals(-code).name
        return f"the FMU crashed the process that it ran in{at} ({how})"

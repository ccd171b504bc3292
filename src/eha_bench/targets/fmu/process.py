"""An FMU's library in a process of its own, asked over a socket."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from eha_bench.core.errors import TargetFault
from eha_bench.targets.fmu.description import Binary, Variable

_PATIENCE = 5.0
"""Time for a process to leave by itself, s."""
SILENCE = 600.0
"""Time for an FMU to answer, s: large models take minutes to start, and none a night for a step."""


class Process:
    """What `instance.Library` offers, run elsewhere; a crash there is a fault here."""

    def __init__(self, binary: Binary, folder: Path) -> None:
        """Start the process and load the FMU there.

        Raises:
            TargetFault: the binary cannot be loaded, or crashes.
        """
        ours, theirs = socket.socketpair()
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "eha_bench.targets.fmu.worker", str(theirs.fileno())],
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            env=environment,
        )
        theirs.close()
        self._connection: Connection[Any, Any] = Connection(ours.detach())
        try:
            self._ask("load", binary, folder)
        except TargetFault:
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
        self._connection.close()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _ask(self, name: str, *arguments: Any, time: float | None = None) -> Any:
        try:
            self._connection.send((name, arguments))
            if not self._connection.poll(SILENCE):
                self._process.kill()
                at = f" at {time:.6g} s" if time is not None else ""
                raise TargetFault(f"the FMU does not answer{at}: waited {SILENCE:g} s")
            fault, value = self._connection.recv()
        except (EOFError, OSError) as error:
            raise TargetFault(self._crash(time)) from error
        if fault is not None:
            raise TargetFault(fault)
        return value

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

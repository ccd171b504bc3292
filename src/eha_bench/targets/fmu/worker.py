"""The process that an FMU runs in, so that a crash of the FMU is a fault and not the end of us.

`python -m eha_bench.targets.fmu.worker FD FOLDER`: requests come over the socket FD as (name,
arguments) of a `Library`, answers go back as (fault or None, value). FOLDER is where the FMU was
unpacked: it is removed here where whoever unpacked it was killed.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from eha_bench.core.errors import TargetFault
from eha_bench.core.temporary_folder import remove_if_left
from eha_bench.targets.fmu.instance import Library
from eha_bench.targets.fmu.process import LEAVE

_GLANCE = 1.0
"""How often the parent process is looked for, s."""


def serve(connection: Connection[Any, Any]) -> bool:
    """Answer requests until asked to leave or the other end closes; return whether asked."""
    library: Library | None = None
    while True:
        try:
            name, arguments = connection.recv()
        except (EOFError, ConnectionError):
            return False
        if name == LEAVE:
            return True
        try:
            if library is None:
                library = Library(*arguments)
                value = None
            else:
                value = getattr(library, name)(*arguments)
            connection.send((None, value))
        except TargetFault as fault:
            connection.send((str(fault), None))


def _leave_with(parent: int, folder: Path) -> None:
    """End this process once the one that started it is gone: an FMU may never return."""
    while os.getppid() == parent:
        time.sleep(_GLANCE)
    _tidy(folder)
    os._exit(1)


def _tidy(folder: Path) -> None:
    """Remove the unpacked FMU of an owner that was killed; it may take a moment to be gone."""
    until = time.monotonic() + _GLANCE
    while folder.exists() and time.monotonic() < until:
        remove_if_left(folder)
        time.sleep(0.01)


def main() -> None:
    """Serve on the socket whose number is the first argument."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started us stops us, safely
    folder = Path(sys.argv[2])
    threading.Thread(target=_leave_with, args=(os.getppid(), folder), daemon=True).start()
    os.dup2(2, 1)  # what an FMU prints is for people
    connection: Connection[Any, Any] = Connection(int(sys.argv[1]))
    asked = serve(connection)
    connection.close()
    if not asked:
        _tidy(folder)
    # not `sys.exit`: some FMUs' libraries crash where the interpreter tears itself down
    os._exit(0)


if __name__ == "__main__":
    sys.path[:] = [folder for folder in sys.path if folder != str(Path(__file__).parent)]
    main()

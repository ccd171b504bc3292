"""The process that an FMU runs in, so that a crash of the FMU is a fault and not the end of us.

`python -m eha_bench.targets.fmu.worker FD`: requests come over the socket FD as (name, arguments)
of a `Library`, answers go back as (fault or None, value).
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
from eha_bench.targets.fmu.instance import Library

_GLANCE = 1.0
"""How often it is looked whether anybody is still there, s."""


def serve(connection: Connection[Any, Any]) -> None:
    """Answer requests until the other end is closed."""
    library: Library | None = None
    while True:
        try:
            name, arguments = connection.recv()
        except EOFError:
            return
        try:
            if library is None:
                library = Library(*arguments)
                value = None
            else:
                value = getattr(library, name)(*arguments)
            connection.send((None, value))
        except TargetFault as fault:
            connection.send((str(fault), None))


def _leave_with(parent: int) -> None:
    """End this process once the one that started it is gone: an FMU may never return."""
    while os.getppid() == parent:
        time.sleep(_GLANCE)
    os._exit(1)


def main() -> None:
    """Serve on the socket whose number is the argument."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started us stops us, safely
    threading.Thread(target=_leave_with, args=(os.getppid(),), daemon=True).start()
    os.dup2(2, 1)  # what an FMU prints is for people
    connection: Connection[Any, Any] = Connection(int(sys.argv[1]))
    serve(connection)
    connection.close()
    # not `sys.exit`: some FMUs' libraries crash where the interpreter tears itself down
    os._exit(0)


if __name__ == "__main__":
    sys.path[:] = [folder for folder in sys.path if folder != str(Path(__file__).parent)]
    main()

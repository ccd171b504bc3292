"""Commands in processes of their own that need no start of their own.

Python with all that a command imports takes two seconds to start. One process does that once, and
every command is forked from it: a process with its own signals, limits and exit status. It ends as
Python does, its threads, exit functions and output first; but what it shares with the process that
it was forked from is left to the system, where taking it apart took half a second a command.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

MAIN = "from eha_bench.cli.main import main\nmain()"

_SERVER = """\
import atexit, gc, importlib, json, os, resource, socket, sys, threading, traceback
channel = socket.socket(fileno=int(sys.argv[1]))
for name in ("cli.app", "rounds", "comparison_api", "diagnosis.replay.prediction"):
    importlib.import_module(f"eha_bench.{name}")
importlib.import_module("eha_bench.plants.compiled").load_numba()
gc.freeze()
while True:
    message, given, _, _ = socket.recv_fds(channel, 1 << 20, 2)
    if not message:
        break
    asked = json.loads(message)
    child = os.fork()
    if child == 0:
        channel.close()
        nothing = os.open(os.devnull, os.O_RDONLY)
        for number, file in enumerate((nothing, *given)):
            os.dup2(file, number)
            os.close(file)
        os.chdir(asked["folder"])
        if asked["room"] is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (asked["room"], asked["room"]))
        sys.argv = ["eha-bench", *asked["words"]]
        status = 0
        try:
            exec(asked["code"])
        except SystemExit as left:
            status = left.code if isinstance(left.code, int) else int(bool(left.code))
        except BaseException:
            status = 1
            traceback.print_exc()
        threading._shutdown()
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    for file in given:
        os.close(file)
    channel.send(str(child).encode())
    channel.send(str(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])).encode())
"""


class Command:
    """A command that runs; what it writes is gathered while it does."""

    def __init__(self, channel: socket.socket, asked: dict[str, Any]) -> None:
        self._channel = channel
        pipes = [os.pipe() for _ in range(2)]
        socket.send_fds(channel, [json.dumps(asked).encode()], [end for _, end in pipes])
        for _, end in pipes:
            os.close(end)
        self._text = ["", ""]
        self._readers = [
            threading.Thread(target=self._read, args=(k, start))
            for k, (start, _) in enumerate(pipes)
        ]
        for reader in self._readers:
            reader.start()
        channel.settimeout(300.0)  # the first one waits for what the process imports
        self.pid = int(channel.recv(64))
        self.returncode: int | None = None

    def _read(self, number: int, start: int) -> None:
        with open(start, encoding="utf-8") as file:
            self._text[number] = file.read()

    def poll(self) -> int | None:
        """Its exit status, None while it runs."""
        return self._status(0.0)

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def communicate(self, timeout: float) -> tuple[str, str]:
        """Wait for its end, and return what it wrote to standard output and error."""
        if self._status(timeout) is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout)
        for reader in self._readers:
            reader.join(timeout)
        return self._text[0], self._text[1]

    def kill(self) -> None:
        """End it if it still runs."""
        self.send_signal(9)
        self.communicate(60.0)

    def _status(self, timeout: float) -> int | None:
        if self.returncode is None:
            self._channel.settimeout(timeout)
            try:
                self.returncode = int(self._channel.recv(64))
            except (BlockingIOError, TimeoutError):
                return None
        return self.returncode


class Forked:
    """Starts commands, one at a time, by forking a process that has imported everything."""

    def __init__(self) -> None:
        self._channel, end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        # a process with threads is not to be forked, and linear algebra would start some
        one_thread = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        with end:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _SERVER, str(end.fileno())],
                pass_fds=[end.fileno()], env=os.environ | one_thread,
            )  # fmt: skip
        self._last: Command | None = None

    def start(
        self, *words: object, folder: Path, code: str = MAIN, room: int | None = None
    ) -> Command:
        """Start a command.

        Args:
            words: its arguments. folder: where it runs. code: what it executes.
            room: bytes beyond which it cannot write a file, as on a full disk.
        """
        if self._last is not None and self._last.returncode is None:
            self._last.kill()  # of a test that failed
        asked = {"words": [str(w) for w in words], "folder": str(folder), "code": code}
        self._last = Command(self._channel, asked | {"room": room})
        return self._last

    def run(
        self, *words: object, folder: Path, code: str = MAIN, room: int | None = None
    ) -> subprocess.CompletedProcess[str]:
        """Run a command to its end."""
        command = self.start(*words, folder=folder, code=code, room=room)
        out, errors = command.communicate(300.0)
        assert command.returncode is not None
        return subprocess.CompletedProcess(list(words), command.returncode, out, errors)

    def close(self) -> None:
        if self._last is not None and self._last.returncode is None:
            self._last.kill()
        self._channel.close()
        self._process.wait(60.0)

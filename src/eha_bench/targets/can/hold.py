"""Who holds a rig, and whether it may be used: lock and latch, kept on this machine.

The lock follows the adapter, whatever the target is called and whichever alias names the device.
It is the kernel's (`flock`, and a socket without a file): it goes with the process, whatever ends
it, and deleting its file frees nothing. The latch is a file by the target's name, and one by the
adapter: it stands while the torque is on, it stays when the run did not end well, and only a person
takes it away (`eha-bench clear`).
"""

from __future__ import annotations

import fcntl
import json
import os
import socket
import sys
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from eha_bench.core.atomic_file import replacing
from eha_bench.core.errors import EhaBenchError, Place, TargetFault

STATE = "EHA_BENCH_STATE"
_DEFAULT = Path("/var") / "tmp" / "eha-bench"


def state_folder() -> Path:
    """Return the folder of locks and latches, the same for every user; it survives a restart.

    Raises:
        TargetFault: it cannot be made.
    """
    named = os.environ.get(STATE, "")
    folder = Path(named) if named else _DEFAULT
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True, exist_ok=True)
            if not named:
                folder.chmod(0o1777)
    except OSError as error:
        raise TargetFault(
            f"the folder of locks cannot be made ({error.strerror})",
            where=Place(file=str(folder)),
            hint=f"name another one in {STATE}",
        ) from error
    return folder


class RigBusy(TargetFault):
    """Another run holds the rig."""


class RigLatched(TargetFault):
    """The rig was left in a state that a person has to look at."""


@dataclass(frozen=True)
class Latch:
    """Why a rig is latched, since when, and by which process."""

    reason: str
    since: str
    pid: int

    def __str__(self) -> str:
        """One sentence."""
        return f"{self.reason} (since {self.since})"


class Hold:
    """Holds a rig."""

    def __init__(self, name: str, adapter: str = "") -> None:
        """Prepare to hold the rig called `name` that `adapter` (of `adapter_of`) leads to."""
        self._name = name
        self._adapter = adapter
        folder = state_folder()
        self._lock_path = folder / f"{adapter or name}.lock"
        self._latch_path = folder / f"{name}.latch"
        self._latches = [self._latch_path]
        if adapter:
            self._latches.append(folder / f"{adapter}.latch")
        self._descriptor = -1
        self._socket: socket.socket | None = None

    def take(self) -> None:
        """Lock the rig.

        Raises:
            RigBusy: another process has it.
        """
        try:
            flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
            descriptor = os.open(self._lock_path, flags, 0o666)
        except OSError as error:
            raise TargetFault(
                f"the lock cannot be opened ({error.strerror})",
                where=Place(file=str(self._lock_path)),
            ) from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.read(descriptor, 200).decode(errors="replace").strip()
            os.close(descriptor)
            raise RigBusy(
                f"the rig '{self._name}' is in use" + (f" by {holder}" if holder else ""),
                hint="two runs never share a rig: wait until the other one is done",
            ) from error
        try:
            self._socket = self._claim()
        except OSError as error:
            os.close(descriptor)
            raise RigBusy(
                f"the rig '{self._name}' is in use: another run holds its adapter "
                f"({self._adapter})",
                hint="two runs never share a rig: wait until the other one is done",
            ) from error
        with suppress(OSError):
            os.fchmod(descriptor, 0o666)
        os.ftruncate(descriptor, 0)
        os.write(descriptor, f"process {os.getpid()} since {_now()}\n".encode())
        self._descriptor = descriptor

    def _claim(self) -> socket.socket | None:
        """Bind a name that only one process has, and that no file stands for; Linux has those.

        Raises:
            OSError: another process has it.
        """
        if not self._adapter or not sys.platform.startswith("linux"):
            return None
        claimed = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            claimed.bind(f"\0eha-bench-{self._adapter}"[:100])
        except OSError:
            claimed.close()
            raise
        return claimed

    def let_go(self) -> None:
        """Unlock the rig."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        if self._descriptor >= 0:
            with suppress(OSError):
                os.ftruncate(self._descriptor, 0)
            os.close(self._descriptor)
            self._descriptor = -1

    @property
    def latch(self) -> Latch | None:
        """Why the rig is latched; None where it is not."""
        return next((found for path in self._latches if (found := _read(path))), None)

    def check(self) -> None:
        """Refuse a latched rig.

        Raises:
            RigLatched: with the reason.
        """
        latch = self.latch
        if latch is not None:
            raise RigLatched(
                f"the rig '{self._name}' is latched: {latch}",
                hint="inspect the rig, then clear it with `eha-bench clear TARGET --by NAME`",
            )

    def arm(self, trial: str) -> None:
        """Latch in advance: taken back by `disarm` unless this process dies first."""
        self.set(f"the bench ended while the torque was on, in trial '{trial}'")

    def set(self, reason: str) -> None:
        """Latch the rig.

        Raises:
            TargetFault: the latch cannot be written.
        """
        text = json.dumps({"reason": reason, "since": _now(), "pid": os.getpid()})
        try:
            for path in self._latches:
                with replacing(path, durable=True) as part:
                    part.write_text(text + "\n", encoding="utf-8")
        except OSError as error:
            raise TargetFault(
                f"the latch cannot be written ({error.strerror})",
                where=Place(file=str(self._latch_path)),
                hint=f"name another folder in {STATE}",
            ) from error

    def disarm(self) -> None:
        """Take the latch away."""
        for path in self._latches:
            path.unlink(missing_ok=True)

    def clear(self, by: str) -> Latch | None:
        """Take the latch away for a person, note who it was, and return its text."""
        latch = self.latch
        self.disarm()
        if latch is not None:
            try:
                with self._latch_path.with_suffix(".log").open("a", encoding="utf-8") as log:
                    log.write(json.dumps({"cleared": _now(), "by": by, "was": str(latch)}) + "\n")
            except OSError as error:
                raise EhaBenchError(
                    f"cleared, but that cannot be noted ({error.strerror})",
                    where=Place(file=str(self._latch_path)),
                ) from error
        return latch


def _read(path: Path) -> Latch | None:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return Latch(str(data["reason"]), str(data["since"]), int(data["pid"]))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError):
        return Latch("the latch cannot be read", "an unknown time", 0)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")

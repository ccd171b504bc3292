"""Temporary folders that go with the process that made them, however it ends.

A process that is killed tidies nothing up. So each folder is locked by its owner, and one that
no process locks any more is removed by the next process that makes one of its kind.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
import weakref
from contextlib import suppress
from pathlib import Path


class TemporaryFolder:
    """A folder that is removed with this object; after a kill by whoever comes next.

    Attributes:
        path: the folder.
    """

    def __init__(self, kind: str) -> None:
        """Make a folder, and remove those of its kind that a killed process left.

        Args:
            kind: how its name begins; every folder so called has to be made by this class.
        """
        for other in Path(tempfile.gettempdir()).glob(f"{kind}*"):
            remove_if_left(other)
        self.path, held = _make_locked(kind)
        self._finalizer = weakref.finalize(self, _remove, self.path, held)

    def remove(self) -> None:
        """Remove it now."""
        self._finalizer()


def remove_if_left(folder: Path) -> None:
    """Remove a temporary folder of this user whose owner has ended; leave any other."""
    with suppress(OSError):  # it is locked, owned by another user, or gone
        held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(held).st_uid == os.getuid():
                shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(held)


def _make_locked(kind: str) -> tuple[Path, int]:
    while True:
        folder = tempfile.mkdtemp(prefix=kind)
        with suppress(FileNotFoundError):
            held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            fcntl.flock(held, fcntl.LOCK_SH)
            if os.fstat(held).st_nlink:  # no other process removed it before it was locked
                return Path(folder), held
            os.close(held)


def _remove(folder: Path, held: int) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    os.close(held)

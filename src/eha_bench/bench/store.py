"""Where runs are kept: its own folder for each, named after its start, and a link to the last.

Nothing that a run has written is overwritten by another one: a folder that is named twice is set
aside first, and two runs at once never share one.
"""

from __future__ import annotations

import errno
import logging
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final

from eha_bench.core.errors import InputError, Place
from eha_bench.core.output_folder import STAMP, name_aside, writable

LATEST: Final = "latest"
REPORTS: Final = Path("reports")
_LOG = logging.getLogger("eha_bench")


@dataclass(frozen=True)
class SuiteFolder:
    """The runs of one suite, `reports/<suite>/<time>`, and `latest`, a link to the newest.

    Attributes:
        name: the suite's.
        reports: folder of all suites.
    """

    name: str
    reports: Path = REPORTS

    @property
    def path(self) -> Path:
        """The folder of the suite."""
        return self.reports / self.name

    def latest(self) -> Path | None:
        """Return the folder of the newest run; None where there is none."""
        link = self.path / LATEST
        return self.path / link.resolve().name if link.is_dir() else None

    def claim(self) -> Path:
        """Make the folder of a new run, and let `latest` point to it.

        Raises:
            InputError: it cannot be made.
        """
        writable(self.path)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            folder = _make_folder(self.path, datetime.now().strftime(STAMP))
        except OSError as error:
            raise InputError(
                f"cannot be made ({error.strerror})",
                where=Place(file=str(self.path)),
                hint="name another folder with --out",
            ) from error
        part = self.path / f".{LATEST}.{secrets.token_hex(4)}"
        with suppress(OSError):  # a file system without links does without
            part.symlink_to(folder.name, target_is_directory=True)
            part.replace(self.path / LATEST)
        part.unlink(missing_ok=True)
        return folder


def _make_folder(parent: Path, stamp: str) -> Path:
    """Make a folder that no other process has made, though two runs start in the same second."""
    number = 1
    while True:
        folder = parent / (stamp if number == 1 else f"{stamp}-{number}")
        try:
            folder.mkdir()
        except FileExistsError:
            number += 1
        else:
            return folder


def set_aside(folder: Path) -> Path:
    """Rename a folder that is needed again, say so, and return its new name.

    Raises:
        InputError: it cannot be renamed.
    """
    where = Place(file=str(folder))
    hint = "name another folder with --out"
    if folder.is_symlink():
        raise InputError("is a link to the folder of an earlier run", where=where, hint=hint)
    own = folder.resolve()
    if own == Path.cwd() or own in Path.cwd().parents:
        raise InputError(
            "holds an earlier run and cannot be renamed: it is the folder you are in",
            where=where,
            hint=hint,
        )
    aside = name_aside(folder)
    try:
        folder.rename(aside)
    except OSError as error:
        raise InputError(
            f"holds an earlier run and cannot be renamed ({error.strerror})",
            where=where,
            hint=hint,
        ) from error
    _LOG.warning("note: %s held an earlier run, which is now in %s", folder, aside)
    return aside


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Keep a folder to this run; it is given back when the run ends, however it ends.

    Raises:
        InputError: another run is writing into it.
    """
    try:
        import fcntl
    except ImportError:  # not on Windows
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
                raise InputError(
                    "another run is writing there",
                    where=Place(file=str(folder)),
                    hint="wait for its end, or name another folder with --out",
                ) from error
            # a file system without locks does without
        yield
    finally:
        os.close(handle)

"""A folder that results are written into: it is looked at before the work, not after it.

A later run takes the name of such a folder; what is in it is then set aside under another name, and
is found by the first one.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path

from eha_bench.core.errors import InputError, Place

STAMP = "%Y-%m-%d_%H-%M-%S"
"""How a time is written in a folder's name."""

_ASIDE = re.compile(r"(.+)-\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d(-\d+)?")


def writable(folder: Path, hint: str = "") -> Path:
    """Return the folder if results can be written into it; it need not be there yet.

    Nothing is made: who fails afterwards leaves no empty folder behind.

    Raises:
        InputError: it is a file, lies below one, or may not be written.
    """
    nearest = folder
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise InputError(
            "is a file" if nearest == folder else f"cannot be made: '{nearest}' is a file",
            where=Place(file=str(folder)),
            hint=hint or "name a folder with --out",
        )
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(
            f"may not be written{'' if nearest == folder else f', as {nearest} may not'}",
            where=Place(file=str(folder)),
            hint=hint or "name another folder with --out",
        )
    return folder


def spare_inputs(
    written: Iterable[Path],
    inputs: Iterable[object],
    hint: str = "name another folder with --out",
) -> None:
    """Refuse to write a file that the same work reads.

    Args:
        written: files that are about to be written, and folders in which any file may be.
        inputs: what is read; what is neither a path nor a name of one has no file.
        hint: the way out.

    Raises:
        InputError: one of them is the other.
    """
    named = [Path(item) for item in inputs if isinstance(item, str | Path)]
    read = [item for item in named if item.exists()]
    for path in filter(Path.exists, written):
        for item in read:
            if path.samefile(item) or (path.is_dir() and path.resolve() in item.resolve().parents):
                raise InputError(
                    "is read here and would be overwritten",
                    where=Place(file=str(item if path.is_dir() else path)),
                    hint=hint,
                )


def name_aside(folder: Path) -> Path:
    """Return a free name next to a folder that says when it was last written."""
    stamp = datetime.fromtimestamp(folder.stat().st_mtime).strftime(STAMP)
    number = 1
    while True:
        suffix = stamp if number == 1 else f"{stamp}-{number}"
        aside = folder.with_name(f"{folder.name}-{suffix}")
        if not aside.exists():
            return aside
        number += 1


def taker(folder: Path) -> Path | None:
    """Return the folder that has taken this one's name, None where it has not been set aside."""
    named = _ASIDE.fullmatch(folder.name)
    later = folder.with_name(named[1]) if named else None
    return later if later is not None and later.is_dir() else None

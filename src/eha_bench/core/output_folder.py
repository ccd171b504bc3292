"""A folder that results will be written into: looked at before the work, not after it."""

from __future__ import annotations

import os
from pathlib import Path

from eha_bench.core.errors import InputError, Place


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

"""How a folder is called whose name a later run has taken, and how it is known by that name."""

from __future__ import annotations

import re
from datetime import datetime
from pathlib import Path

STAMP = "%Y-%m-%d_%H-%M-%S"
"""How a time is written in a folder's name."""

_ASIDE = re.compile(r"(.+)-\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d(-\d+)?")


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

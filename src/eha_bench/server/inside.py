"""What may be read of a folder: files and folders that lie in it, and nothing that is hidden."""

from __future__ import annotations

from pathlib import Path


def inside(folder: Path, name: str) -> Path | None:
    """Return what a name stands for below a folder; None where it is not there, or not in it.

    Links count as what they lead to: one that leaves the folder leads nowhere. Names that begin
    with a dot are hidden, `..` among them.

    Args:
        folder: must exist.
        name: parts with `/` between them, as a URL has them.
    """
    parts = name.split("/")
    if any(not part or part.startswith(".") or "\\" in part or "\0" in part for part in parts):
        return None
    try:
        own = folder.resolve(strict=True)
        found = own.joinpath(*parts).resolve(strict=True)
    except (OSError, RuntimeError, ValueError):
        return None
    if found == own or not found.is_relative_to(own):
        return None
    return found

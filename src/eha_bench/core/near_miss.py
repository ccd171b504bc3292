"""The way out of a misspelt name: the nearest known one, or the list of them."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def suggest(name: str, known: Iterable[str], *, likeness: float = 0.6) -> str:
    """Return a hint such as `did you mean 'sine'?`, or the names there are.

    `likeness` (0 to 1) is what a name needs to be suggested: more where any name is allowed.
    """
    names = list(known)
    listed = f"known: {', '.join(names)}" if names else "there are none"
    return likely(name, names, likeness=likeness) or listed


def likely(name: str, known: Iterable[str], *, likeness: float = 0.6) -> str:
    """Return a hint such as `did you mean 'sine'?`, "" where no known name is like this one."""
    near = nearest(name, known, likeness=likeness)
    return f"did you mean '{near}'?" if near else ""


def nearest(name: str, known: Iterable[str], *, likeness: float = 0.6) -> str:
    """Return the known name that is most like this one, "" where none is like it."""
    folded = {other.lower(): other for other in reversed(list(known))}
    close = difflib.get_close_matches(name.lower(), folded, n=1, cutoff=likeness)
    return folded[close[0]] if close else ""

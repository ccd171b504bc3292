"""How names from a log are shown in a message to a person."""

from __future__ import annotations

from collections.abc import Iterable

from eha_bench.core.near_miss import likely


def printable(names: Iterable[str]) -> str:
    """Return names from a log as text for a message: on one line, and not without end."""
    text = ", ".join("".join(c if c.isprintable() else "?" for c in name[:200]) for name in names)
    return text if len(text) <= 800 else f"{text[:800]} ..."


def among(name: str, known: Iterable[str], what: str) -> str:
    """Say which names of a kind (`what`, in plural) there are, the likeliest first."""
    names = list(known)
    near = likely(name[:200], names)
    listed = f"its {what} are: {printable(names) or 'none'}"
    return f"{printable([near])} ({listed})" if near else listed

"""Where the shipped YAML files are: next to the package in a checkout, inside it when installed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eha_bench.core.errors import InputError
from eha_bench.core.near_miss import suggest

_PACKAGE = Path(__file__).resolve().parents[1]


def shipped_file(name: str) -> Path:
    """Return the path of a shipped file, named relative to the folder `suites`.

    Raises:
        InputError: no such file is shipped.
    """
    return _shipped_path("suites", name)


def names(folder: str) -> tuple[str, ...]:
    """Return the names of what is shipped in a folder: suites, targets, models or controllers."""
    return tuple(sorted({path.stem for top in _tops(folder) for path in top.glob("*.yaml")}))


def by_name(folder: str, name: str) -> Path | None:
    """Return the shipped file that a bare name stands for, e.g. (`models`, `paper`); or None."""
    if folder not in KINDS or not name.isidentifier():
        return None
    return next((found for top in _tops(folder) if (found := top / f"{name}.yaml").is_file()), None)


def find(name: str | Path, *folders: str, also: Sequence[str] = ()) -> Path:
    """Return the file that is meant: one that is there, or a shipped one by its bare name.

    Args:
        name: a path, or a name such as `paper`.
        folders: kinds of shipped files that are looked through, in order.
        also: names of what is no file, for the way out.

    Raises:
        InputError: a bare name that nothing shipped has.
    """
    path = Path(name)
    if not folders or path.is_file() or path.suffix or len(path.parts) != 1:
        return path
    for folder in folders:
        found = by_name(folder, str(name))
        if found is not None:  # a folder of that name, of an earlier result, is not meant
            return found
    if path.exists():
        return path
    shipped = (item for folder in folders for item in names(folder))
    known = list(dict.fromkeys((*also, *shipped)))
    raise InputError(
        f"unknown {folders[0][:-1]} '{name}': no such file, and none of that name is shipped",
        hint=suggest(str(name), known),
    )


KINDS = ("suites", "targets", "models", "controllers")
"""What is shipped, by folder."""


def _tops(folder: str) -> list[Path]:
    below = "" if folder == "suites" else folder
    return [top / "suites" / below for top in (_PACKAGE / "shipped", _PACKAGE.parents[1])]


def shipped_rig(name: str) -> Path:
    """Return the path of a shipped drive (DBC, target.yaml), in the folder `fixtures/rig`.

    Raises:
        InputError: no such file is shipped.
    """
    return _shipped_path("fixtures/rig", name)


def _shipped_path(folder: str, name: str) -> Path:
    for top in (_PACKAGE / "shipped", _PACKAGE.parents[1]):
        path = top / folder / name
        if path.is_file():
            return path
    raise InputError(f"no shipped file '{name}'")

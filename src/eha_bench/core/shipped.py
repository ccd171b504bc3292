"""Where the shipped YAML files are: beside the package in a checkout, inside it when installed."""

from __future__ import annotations

from pathlib import Path

from eha_bench.core.errors import InputError

_PACKAGE = Path(__file__).resolve().parents[1]


def shipped(name: str) -> Path:
    """Return the path of a shipped file, named relative to the folder `suites`.

    Raises:
        InputError: no such file is shipped.
    """
    return _shipped("suites", name)


def shipped_rig(name: str) -> Path:
    """Return the path of a shipped drive (DBC, target.yaml), in the folder `fixtures/rig`.

    Raises:
        InputError: no such file is shipped.
    """
    return _shipped("fixtures/rig", name)


def _shipped(folder: str, name: str) -> Path:
    for top in (_PACKAGE / "shipped", _PACKAGE.parents[1]):
        path = top / folder / name
        if path.is_file():
            return path
    raise InputError(f"no shipped file '{name}'")

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
    for folder in (_PACKAGE / "shipped" / "suites", _PACKAGE.parents[1] / "suites"):
        path = folder / name
        if path.is_file():
            return path
    raise InputError(f"no shipped file '{name}'")

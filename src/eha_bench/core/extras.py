"""Packages that only an extra of eha-bench brings: one that is missing is a sentence."""

from __future__ import annotations

import importlib.util

from eha_bench.core.errors import EhaBenchError, InputError, Place


def way_to_install(extra: str) -> str:
    """Return the hint for a package that an extra brings."""
    return f"install it with: pip install 'eha-bench[{extra}]'"


def require(
    module: str,
    extra: str,
    what: str,
    *,
    where: Place | None = None,
    error: type[EhaBenchError] = InputError,
) -> None:
    """Refuse what a missing package would end later, before anything is done.

    Args:
        module: that is imported. extra: that brings it. what: needs it, as a sentence begins.
        where: the file that it is about. error: what is raised.

    Raises:
        EhaBenchError: (`error`) the package is not installed.
    """
    if importlib.util.find_spec(module) is None:
        raise error(f"{what} needs {module}", where=where, hint=way_to_install(extra))

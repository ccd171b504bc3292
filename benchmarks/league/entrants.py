"""Who enters: a name and the function that answers, in this repository or anywhere on the path."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from benchmarks.league.answer import Answer
from benchmarks.league.question import Question

Entrant = Callable[[Question], Answer]

ENTRANTS = {
    "eha-bench": "benchmarks.league.product:enter",
    "sindy": "benchmarks.league.sindy:enter",
    "evolution": "benchmarks.league.evolution:enter",
    "declared": "benchmarks.league.declared:enter",
}
"""Those that are always there; a new one is a line here, or `--entrant module:function`."""


def entrant(name: str) -> Entrant:
    """Return the function of an entrant, by its name here or as `module:function`.

    Raises:
        ValueError: there is no such entrant, module or function.
    """
    module, _, function = ENTRANTS.get(name, name).partition(":")
    if not function:
        raise ValueError(f"no entrant '{name}': name one of {', '.join(ENTRANTS)}, or "
                         "module:function")  # fmt: skip
    try:
        found = getattr(import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"entrant '{name}': {error}") from error
    if not callable(found):
        raise ValueError(f"entrant '{name}': '{function}' is no function")
    answer: Entrant = found
    return answer


def fingerprint(name: str) -> str:
    """Return a digest of the file that an entrant's function stands in, "" where there is none."""
    try:
        file = inspect.getsourcefile(inspect.unwrap(entrant(name)))
    except TypeError:  # no function of Python
        return ""
    return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""

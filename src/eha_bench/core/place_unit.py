"""Units that depend on the place: `{effort}/{speed}^2` is N*m*s^2/rad^2 of what turns.

A word in braces stands for the unit that it has where an effect acts or an element joins. Words and
units are multiplied, divided and raised to whole powers, with brackets, and what cancels is left
out: `{damping}/{speed}` of what slides is N*s^2/m^2.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Final

from eha_bench.core.errors import PluginError
from eha_bench.core.near_miss import suggest

_PART: Final = re.compile(r"\s*(?:(\{[^\W\d]\w*\}|[^\W\d]\w*|%)|(-?\d+)|([*/^()]))")
Powers = Mapping[str, int]
"""Unit, or word in braces -> its power."""


def unit_at_place(unit: str, units: Mapping[str, str]) -> str:
    """Return a unit with the words in it replaced by the units that they have at a place.

    Raises:
        PluginError: the place does not have one of the words, or the text is not of this form.
    """
    if "{" not in unit:
        return unit
    found: dict[str, int] = {}
    for name, power in powers(unit).items():
        if not name.startswith("{"):
            _add(found, {name: power})
            continue
        word = name[1:-1]
        if word not in units:
            raise PluginError(
                f"the unit '{unit}' asks for '{name}', which there is not at this place",
                hint=suggest(word, units),
            )
        _add(found, powers(units[word]), power)
    return _unit_text(found)


def usual_size(unit: str, usual: Mapping[str, float]) -> float:
    """Return what a value of this unit usually is at a place, SI, from what its words usually are.

    A word without a usual size, and a unit without words, counts as one.
    """
    size = 1.0
    if "{" in unit:
        for name, power in powers(unit).items():
            size *= usual.get(name.strip("{}"), 1.0) ** power if name.startswith("{") else 1.0
    return size


@lru_cache(maxsize=512)
def powers(unit: str) -> Powers:
    """Return the parts of a unit with their powers, in the order in which they come.

    Raises:
        PluginError: it is no product, quotient or whole power of names.
    """
    if not unit.strip() or unit.strip() == "1":
        return {}
    tokens: list[str] = []
    at = 0
    text = unit.rstrip()
    while at < len(text):
        match = _PART.match(text, at)
        if match is None:
            raise _not_a_unit(unit)
        tokens.append(match[0].strip())
        at = match.end()
    found, rest = _product(tokens, unit)
    if rest:
        raise _not_a_unit(unit)
    return found


def _product(tokens: list[str], unit: str) -> tuple[dict[str, int], list[str]]:
    found: dict[str, int] = {}
    sign = 1
    while True:
        factor, tokens = _factor(tokens, unit)
        _add(found, factor, sign)
        if not tokens or tokens[0] == ")":
            return found, tokens
        if tokens[0] not in "*/":
            raise _not_a_unit(unit)
        sign = 1 if tokens[0] == "*" else -1
        tokens = tokens[1:]


def _factor(tokens: list[str], unit: str) -> tuple[dict[str, int], list[str]]:
    if not tokens or tokens[0] in "*/^)":
        raise _not_a_unit(unit)
    first, tokens = tokens[0], tokens[1:]
    if first == "(":
        found, tokens = _product(tokens, unit)
        if not tokens:
            raise _not_a_unit(unit)
        tokens = tokens[1:]  # the bracket that closes it
    elif first == "1":
        found = {}
    elif first.lstrip("-").isdigit():
        raise _not_a_unit(unit)
    else:
        found = {first: 1}
    if tokens[:1] == ["^"]:
        if len(tokens) < 2 or not tokens[1].lstrip("-").isdigit():
            raise _not_a_unit(unit)
        found = {name: power * int(tokens[1]) for name, power in found.items()}
        tokens = tokens[2:]
    return found, tokens


def _add(found: dict[str, int], more: Powers, times: int = 1) -> None:
    for name, power in more.items():
        found[name] = found.get(name, 0) + times * power


def _unit_text(found: Powers) -> str:
    above = [_power(name, power) for name, power in found.items() if power > 0]
    below = [_power(name, -power) for name, power in found.items() if power < 0]
    if not below:
        return "*".join(above)
    under = below[0] if len(below) == 1 else f"({'*'.join(below)})"
    return f"{'*'.join(above) or '1'}/{under}"


def _power(name: str, power: int) -> str:
    return name if power == 1 else f"{name}^{power}"


def _not_a_unit(unit: str) -> PluginError:
    return PluginError(
        f"'{unit}' is no unit", hint="write units and words in braces as in '{effort}/{speed}^2'"
    )

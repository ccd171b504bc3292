"""The text of a limit becomes bounds in SI.

    limit     := compare { ("," | "and") compare } | range | tolerance
    compare   := ("<=" | ">=" | "<" | ">") quantity
    range     := quantity ".." quantity
    tolerance := [quantity] "+-" (quantity | number "%")
    quantity  := number [unit]                     a bare number is SI

    text      := limit ["of baseline"] ["with 95 % confidence"]
    stated    := limit ["of baseline (" value ")"] ["with ..."] ["," which "of the repeats"]

`≤`, `≥` and `±` may be written for `<=`, `>=` and `+-`. A tolerance without a centre is about 0. A
percentage after a centre is a fraction of the centre. Bounds belong to what is accepted; `<` and
`>` leave them out. Of the baseline, limits are shares (`95 % .. 105 % of baseline`). With
confidence it is the whole interval that has to keep the bounds. A `text` stands in a suite; what a
result states of it (`stated`) says besides what the baseline's value was, and which repeat counts.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache

from eha_bench.core.errors import UnitError
from eha_bench.core.limit import Bounds
from eha_bench.core.units import has_unit, parse, parse_difference

CONFIDENCE = 95.0
"""Per cent: what the intervals of all metrics are for."""

_CONFIDENCE = re.compile(r"^(.*?)\s*\bwith\s+([\d.]+)\s*%\s+confidence\s*$", re.DOTALL)
_BASELINE = re.compile(r"^(.*?)\s*\bof\s+(?:the\s+)?baseline\s*$", re.DOTALL)
_STATED_BASELINE = re.compile(r"^(.*?)\s*\bof\s+baseline\s*\([^)]*\)(.*)$", re.DOTALL)
_REPEATS = re.compile(r",\s*\w+ of the repeats\s*$")
_COMPARE = re.compile(r"(<=|>=|[<>](?!=))\s*([^<>]+)")
_SPELLINGS = {"≤": "<=", "≥": ">=", "±": "+-", "+/-": "+-", "…": ".."}


@dataclass(frozen=True)
class LimitWords:
    """A limit's text taken apart.

    Attributes:
        bounds: what is left for `parse_bounds`.
        confident: whether it ends in `with 95 % confidence`.
        relative: whether the bounds are shares of the baseline's value.
    """

    bounds: str
    confident: bool
    relative: bool


@lru_cache(4096)
def split_words(text: str) -> LimitWords:
    """Return a limit's text without the words after its bounds.

    Raises:
        UnitError: a confidence other than 95 %, for which there are no intervals.
    """
    confident = relative = False
    match = _CONFIDENCE.match(text)
    if match is not None:
        text, confident = match[1], True
        if float(match[2].strip(".") or "nan") != CONFIDENCE:
            raise UnitError(
                f"a confidence of {match[2]} %", hint=f"intervals are for {CONFIDENCE:g} %"
            )
    match = _BASELINE.match(text)
    if match is not None:
        text, relative = match[1], True
    return LimitWords(text.strip(), confident, relative)


def split_stated(text: str) -> LimitWords:
    """Return the text of a limit as a result states it, without what follows its bounds.

    Raises:
        UnitError: as `split_words`.
    """
    text = _REPEATS.sub("", text)
    match = _STATED_BASELINE.match(text)
    return split_words(text if match is None else f"{match[1]} of baseline{match[2]}")


@lru_cache(4096)
def parse_bounds(text: str, unit: str) -> Bounds:
    """Return the bounds that `text` means for a value in the SI unit `unit`.

    Raises:
        UnitError: not a limit, a quantity of the wrong dimension, or nothing would be accepted.
    """
    plain = text.strip()
    for spelling, meaning in _SPELLINGS.items():
        plain = plain.replace(spelling, meaning)
    if ".." in plain:
        bounds = _range(plain, unit)
    elif "+-" in plain:
        bounds = _tolerance(plain, unit)
    elif plain[:1] in ("<", ">"):
        bounds = _comparisons(plain, unit)
    else:
        raise UnitError(f"'{text}' is not a limit", hint=examples(unit))
    if not bounds.low <= bounds.high:
        raise UnitError(f"'{text}' accepts no value", hint="its lower bound is above the upper one")
    return bounds


def examples(unit: str) -> str:
    """Return a hint with limits on a value in `unit`."""
    one = f"1 {unit}".strip()
    two = f"2 {unit}".strip()
    return f"write '<= {one}', '>= {one}', '{one} .. {two}' or '{one} +- 5 %'"


def _comparisons(text: str, unit: str) -> Bounds:
    low, high = -math.inf, math.inf
    for clause in re.split(r"\s*,\s*|\s+and\s+", text):
        match = _COMPARE.fullmatch(clause.strip())
        if match is None:
            raise UnitError(f"'{clause}' is not a limit", hint=examples(unit))
        value = parse(match[2].strip(), unit)
        if match[1].startswith("<"):
            high = min(high, value if match[1] == "<=" else math.nextafter(value, -math.inf))
        else:
            low = max(low, value if match[1] == ">=" else math.nextafter(value, math.inf))
    return Bounds(low, high)


def _range(text: str, unit: str) -> Bounds:
    parts = [part.strip() for part in text.split("..")]
    if len(parts) != 2 or not all(parts):
        raise UnitError(f"'{text}' is not a range", hint=examples(unit))
    low, high = (parse(part, unit) for part in parts)
    if has_unit(parts[1]) and not has_unit(parts[0]) and low != 0:
        raise UnitError(
            f"'{parts[0]}' in '{text}' has no unit", hint="give the unit on both sides of '..'"
        )
    return Bounds(low, high)


def _tolerance(text: str, unit: str) -> Bounds:
    left, _, right = (part.strip() for part in text.partition("+-"))
    if not right or "+-" in right:
        raise UnitError(f"'{text}' is not a tolerance", hint=examples(unit))
    centre = parse(left, unit) if left else 0.0
    if left and right.endswith("%"):
        margin = abs(centre) * parse(right, "")
    else:
        margin = parse_difference(right, unit)
    if margin < 0:
        raise UnitError(f"the tolerance in '{text}' is negative", hint=examples(unit))
    return Bounds(centre - margin, centre + margin)

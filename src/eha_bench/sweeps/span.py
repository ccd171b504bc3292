"""What one factor may be: certain levels, or a range, linear or by ratios; SI."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field

from eha_bench.core.errors import InputError
from eha_bench.core.located import Located
from eha_bench.core.yaml_file import NUMBER, Real, StrictModel, validate

Value = float | str
Reader = Callable[[Any, Any], Value]
"""Turns what a file says into a value in SI; the second argument is its place."""

MOST_LEVELS = 10_000


class RangeFile(StrictModel):
    """A range as keys."""

    from_: Annotated[Real | str, Field(alias="from", description="first value")]
    to: Annotated[Real | str, Field(description="last value")]
    steps: Annotated[
        int, Field(ge=2, le=MOST_LEVELS, description="levels on a grid, both ends included"), NUMBER
    ] = 5
    scale: Annotated[
        Literal["linear", "log"], Field(description="log: equal ratios from level to level")
    ] = "linear"


class Span(ABC):
    """What a factor may be."""

    @property
    @abstractmethod
    def levels(self) -> tuple[Value, ...]:
        """Values on a grid."""

    @abstractmethod
    def at(self, share: float) -> Value:
        """Return the value at a share of the span, 0 ... 1 (exclusive)."""


@dataclass(frozen=True)
class Levels(Span):
    """Certain values and no others."""

    values: tuple[Value, ...]

    @property
    def levels(self) -> tuple[Value, ...]:
        """All of them."""
        return self.values

    def at(self, share: float) -> Value:
        """Return the level whose part of the span this share lies in."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]


@dataclass(frozen=True)
class Range(Span):
    """All values from `low` to `high`, SI; `steps` of them on a grid."""

    low: float
    high: float
    steps: int
    log: bool

    @property
    def levels(self) -> tuple[Value, ...]:
        """`steps` of them, both ends included."""
        return tuple(self.at(k / (self.steps - 1)) for k in range(self.steps))

    def at(self, share: float) -> float:
        """Return the value at a share of the range."""
        if share >= 1.0:
            return self.high
        if self.log:
            return self.low * math.exp(share * math.log(self.high / self.low))
        return self.low + share * (self.high - self.low)

    def share(self, value: float) -> float:
        """Return where a value lies in the range, 0 ... 1, the ends for those outside."""
        if self.log:
            found = math.log(max(value, 1e-300) / self.low) / math.log(self.high / self.low)
        else:
            found = (value - self.low) / (self.high - self.low)
        return min(max(found, 0.0), 1.0)


def span_of(content: Located, read: Reader) -> Span:
    """Return the span that a factor's entry says: a list of values, or `from` and `to`.

    Args:
        content: the entry. read: turns a value into SI, and knows what is wrong with it.

    Raises:
        InputError: neither, an empty or unordered range, a value of a wrong unit or size.
    """
    if isinstance(content.value, list):
        found = tuple(read(item.value, item.place()) for item in content.each())
        if not found:
            raise content.error("the list is empty", hint="name at least one value")
        if len(set(found)) < len(found):
            raise content.error("a value is given twice", hint="give each value once")
        return Levels(found)
    if not isinstance(content.value, dict):
        raise content.error(
            f"'{content.value}' is not a range",
            hint="write {from: ..., to: ...}, or a list of values",
        )
    where = content.place()
    form = validate(RangeFile, content.value, where.file, places=content.place)
    low, high = (
        read(raw, content.place((key,))) for key, raw in (("from", form.from_), ("to", form.to))
    )
    if isinstance(low, str) or isinstance(high, str):
        raise content.error("a range goes from one number to another", hint="list words as [a, b]")
    if not low < high:
        raise InputError(
            f"the range is empty: it goes from {form.from_} to {form.to}",
            where=content.place(("to",)),
            hint="let 'to' be greater than 'from'",
        )
    if form.scale == "log" and low <= 0.0:
        raise InputError(
            f"a logarithmic range cannot start at {form.from_}",
            where=content.place(("from",)),
            hint="start above 0, or use 'scale: linear'",
        )
    return Range(low, high, form.steps, form.scale == "log")

"""What may be missing: every registered effect, and parameters that may be declared wrongly.

A plant parameter whose value is only assumed is a candidate too, and so are a number of a drawing
or of a maker's sheet that is not calibrated, and the size of an effect that the model declares:
where one explains the residual as well as an effect does, no effect is named.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.effect import BoundEffect
from eha_bench.plants.layout import Layout
from eha_bench.plants.parameter import Parameter

LEARNED = "learned"
"""Id of the effect that holds a learned curve; it is never a named cause."""

_AT = 1e-3
"""Distance of a strength from its bound, in starting strengths, that is none."""
_OFF = 1e-9
"""Share of the first strength that is rounding."""
_ASSUMED_OFF_BY, _DECLARED_OFF_BY = 2.0, 10.0
"""Factor by which an assumed value, and the size of a declared effect, may be wrong."""
_SAME = 0.01
"""Relative difference of two parameters that are declared the same."""


@dataclass(frozen=True)
class Start:
    """One point from which a candidate's search begins.

    Attributes:
        candidate: effect's id, or `parameter:name` for an assumed parameter.
        settings: place in the vector -> value, the strength's included.
        strength_at: place of the strength; neutral: its value where the candidate is off.
        strength: its starting size.
        low, high: bounds of the strength.
        keys: what a refit moves.
        equation: balance it acts in ("" for a parameter).
    """

    candidate: str
    settings: tuple[tuple[int, float], ...]
    strength_at: int
    neutral: float
    strength: float
    low: float
    high: float
    keys: tuple[str, ...]
    equation: str

    def apply(self, vector: FloatArray, share: float = 1.0) -> FloatArray:
        """Return a vector with the candidate on, at a share of its starting strength."""
        out = vector.copy()
        for at, value in self.settings:
            out[at] = value
        out[self._sizes] = self.neutral + share * (self.strength - self.neutral)
        return out

    def as_in(self, other: FloatArray, vector: FloatArray) -> FloatArray:
        """Return a vector with the candidate as it is in another one."""
        out = vector.copy()
        for at, _ in self.settings:
            out[at] = other[at]
        return out

    def off(self, vector: FloatArray) -> FloatArray:
        """Return a vector with the candidate off, its settings as they are."""
        out = vector.copy()
        out[self._sizes] = self.neutral
        return out

    def clipped(self, vector: FloatArray) -> FloatArray:
        """Return a vector with the strength within its bounds."""
        out = vector.copy()
        out[self._sizes] = np.clip(out[self._sizes], self.low, self.high)
        return out

    @property
    def _sizes(self) -> list[int]:
        """Places of what is its strength."""
        return [self.strength_at]

    def at(self, new: Mapping[int, float]) -> Start:
        """Return the start with other settings at some places of the vector."""
        settings = tuple((at, new.get(at, value)) for at, value in self.settings)
        return replace(self, settings=settings)

    def bound_met(self, vector: FloatArray) -> float | None:
        """Return the bound that the strength stands at in a vector, SI; None where it is inside."""
        near = _AT * abs(self.strength - self.neutral)
        for strength in vector[self._sizes]:
            for bound in (self.low, self.high):
                if bound != self.neutral and abs(strength - bound) <= near:
                    return bound
        return None

    def is_off(self, vector: FloatArray) -> bool:
        """Whether the strength in a vector is one at which the effect does nothing."""
        away = abs(float(vector[self.strength_at]) - self.neutral)
        return away <= _OFF * abs(self.strength - self.neutral)

    @property
    def is_parameter(self) -> bool:
        """Whether it is a parameter's value that may be wrong, not an effect."""
        return self.candidate.startswith("parameter:")


@dataclass(frozen=True)
class SameNumber(Start):
    """A number that several parts were declared with: both areas of a rod that goes through.

    Attributes:
        also: places of the number of the other parts, which move with the strength.
    """

    also: tuple[int, ...] = ()

    @classmethod
    def of(cls, start: Start, names: Sequence[str], places: Sequence[int]) -> Self:
        """Return the number of all parts, from that of the first one."""
        return cls(**{**vars(start), "keys": tuple(names)}, also=tuple(places[1:]))

    def is_one(self, vector: FloatArray) -> bool:
        """Whether parts that were fitted each for itself still have one number."""
        sizes = vector[self._sizes]
        return float(np.ptp(sizes)) <= _SAME * float(np.abs(sizes).max())

    @property
    def _sizes(self) -> list[int]:
        return [self.strength_at, *self.also]


@dataclass(frozen=True)
class SheetNumber(SameNumber):
    """A number of a maker's sheet, from which each part differs a little."""

    def is_within(self, vector: FloatArray) -> bool:
        """Whether parts differ from their sheet by less than may be."""
        sizes = vector[self._sizes]
        return bool(np.all((self.low < sizes) & (sizes < self.high)))


def effect_starts(layout: Layout, effect: BoundEffect, *, refined: bool = False) -> list[Start]:
    """Return the starting points of an effect: its defaults, its `starts`, and every choice.

    Choices that only refine what is there are tried one at a time.

    Args:
        layout: of the plant. effect: one of its effects.
        refined: with the words of choices that only refine what is there.
    """
    refinements = [item.name for item in effect.parameters if item.refines]
    refining = set() if refined else {*refinements}
    words: dict[str, Sequence[int]] = {}
    for parameter in effect.parameters:
        if parameter.choices:
            allowed = effect.words(parameter)
            words[parameter.name] = [parameter.choices.index(word) for word in allowed]
    points = [dict(start) for start in effect.starts]
    found = []
    seen = set()
    for point in points:
        if any(int(point[name]) not in words[name] for name in words if name in point):
            # a part that this plant does not have
            continue
        if any(point.get(name) for name in refining):
            continue
        open_choices = [name for name in words if name not in point and name not in refining]
        for combination in itertools.product(*(words[name] for name in open_choices)):
            values = {parameter.name: parameter.default for parameter in effect.parameters}
            values |= point
            values |= {name: float(k) for name, k in zip(open_choices, combination, strict=True)}
            if sum(values[name] != 0.0 for name in refinements) > 1:
                continue
            # what a form does not have tells no two starts apart
            own = {*words, *(item.name for item in effect.search_parameters(values))}
            key = tuple((name, value) for name, value in values.items() if name in own)
            if key in seen:
                continue
            seen.add(key)
            found.append(_start(layout, effect, values))
    return [start for start in found if start.strength != start.neutral]


def one_of_each_form(layout: Layout, starts: Sequence[Start]) -> list[Start]:
    """Return the first start of one effect for each combination of its choices."""
    forms: dict[tuple[float, ...], Start] = {}
    for start in starts:
        effect, settings = layout.effect(start.candidate), dict(start.settings)
        places = [layout.index[f"{effect.id}.{p.name}"] for p in effect.parameters if p.choices]
        forms.setdefault(tuple(settings[at] for at in places), start)
    return list(forms.values())


def _start(layout: Layout, effect: BoundEffect, values: dict[str, float]) -> Start:
    settings = []
    for parameter in effect.parameters:
        at = layout.index[f"{effect.id}.{parameter.name}"]
        settings += [(at + k, values[parameter.name]) for k in range(parameter.size)]
    keys = [f"{effect.id}.{parameter.name}" for parameter in effect.search_parameters(values)]
    strength = effect.strength
    return Start(
        effect.id,
        tuple(settings),
        layout.index[f"{effect.id}.{strength.name}"],
        effect.neutral,
        values[strength.name],
        strength.low,
        strength.high,
        tuple(keys),
        str(effect.equation(values).value),
    )


def all_starts(
    layout: Layout, vector: FloatArray, declared: Sequence[str], calibrated: Sequence[str]
) -> list[Start]:
    """Return the starting points of everything that may be missing and is not declared.

    Args:
        layout: of the plant.
        vector: calibrated parameters.
        declared: ids of effects that the model has.
        calibrated: keys that are estimated anyway.
    """
    found: list[Start] = []
    for effect in layout.effects:
        if effect.id in declared or effect.id == LEARNED:
            continue
        starts = effect_starts(layout, effect)
        found += [start for start in starts if _can_be_missing(layout, effect, start, vector)]
    found += sheet_numbers(layout, vector, calibrated)
    doubted = {
        item.name
        for item in layout.parameters
        if item.name not in calibrated and item.size == 1 and (item.assumed or item.drawn)
    }
    # a single rod is an effect: two areas that are declared the same are in doubt together
    pairs = pairs_alike(layout, vector)
    paired = {name for pair in pairs for name in pair}
    singles = [(item.name,) for item in layout.parameters if item.name in doubted - paired]
    for names in (*singles, *(pair for pair in pairs if set(pair) <= doubted)):
        first, places = layout.by_key[names[0]], [layout.index[name] for name in names]
        value = float(vector[places[0]])
        if value == 0.0 or not np.isfinite(value):
            continue
        off_by = _ASSUMED_OFF_BY if first.assumed else _DECLARED_OFF_BY
        start = value_start("+".join(names), first, places[0], value, off_by, 1.1)
        found.append(SameNumber.of(start, names, places) if names[1:] else start)
    return found


def sheet_numbers(
    layout: Layout, vector: FloatArray, calibrated: Sequence[str]
) -> list[SheetNumber]:
    """Return numbers of makers' sheets as candidates: each part differs from its sheet a little.

    Parts that are declared the same are of one sheet (two check valves of a closed circuit).
    """
    sheets: dict[tuple[str, float], list[str]] = {}
    for parameter in layout.parameters:
        value = float(vector[layout.index[parameter.name]])
        if parameter.tolerance and value and parameter.name not in calibrated:
            sheets.setdefault((parameter.name.rpartition(".")[2], value), []).append(parameter.name)
    found = []
    for (_, value), names in sheets.items():
        first, places = layout.by_key[names[0]], [layout.index[name] for name in names]
        start = value_start("+".join(names), first, places[0], value, 1.0 + first.tolerance, 1.1)
        found.append(SheetNumber.of(start, names, places))
    return found


def declared_sizes(
    layout: Layout, vector: FloatArray, declared: Sequence[str], calibrated: Sequence[str]
) -> list[Start]:
    """Return the strengths of declared effects as candidates: they may be declared wrongly.

    Args:
        layout: of the plant. vector: parameters. declared: ids of effects that the model has.
        calibrated: keys that are estimated anyway.
    """
    found = []
    for effect in layout.effects:
        key = f"{effect.id}.{effect.strength.name}"
        if effect.id not in declared or effect.id == LEARNED or key in calibrated:
            continue
        at = layout.index[key]
        value = float(vector[at])
        if np.isfinite(value) and value != effect.neutral:
            found.append(value_start(key, effect.strength, at, value, _DECLARED_OFF_BY, 1.5))
    return found


def value_start(
    key: str, parameter: Parameter, at: int, value: float, off_by: float, probed: float
) -> Start:
    """Return a parameter whose value may be wrong as a candidate.

    Args:
        key: of the parameter. at: its place in the vector. value: that may be wrong, SI.
        off_by: factor by which, either way. probed: factor at which that is tried.
    """
    ends = sorted((value / off_by, value * off_by))
    low, high = max(parameter.low, ends[0]), min(parameter.high, ends[1])
    return Start(f"parameter:{key}", (), at, value, value * probed, low, high, (key,), "")


def pairs_alike(layout: Layout, vector: FloatArray) -> list[tuple[str, ...]]:
    """Return pairs of parameters that are declared the same, and that an effect makes unequal."""
    pairs = [effect.alike() for effect in layout.effects]
    return [pair for pair in pairs if _are_same(layout, pair, vector)]


def is_drawn(layout: Layout, start: Start) -> bool:
    """Whether a candidate is a number of a drawing that may be declared wrongly."""
    return start.is_parameter and layout.by_key[start.keys[0]].drawn


def start_values(layout: Layout, effect: BoundEffect, start: Start) -> dict[str, float]:
    """Return an effect's parameters at a starting point, by name; words as their numbers."""
    settings = dict(start.settings)
    return {p.name: settings[layout.index[f"{effect.id}.{p.name}"]] for p in effect.parameters}


def _can_be_missing(layout: Layout, effect: BoundEffect, start: Start, vector: FloatArray) -> bool:
    """Return whether a model without it lacks something: nothing in it says the same already."""
    values = start_values(layout, effect, start)
    twin = effect.repeats(values)
    if twin and vector[layout.index[twin]] != 0.0:
        return False
    needed = effect.needed(values)
    if needed is not None and (not needed or vector[layout.index[needed]] == 0.0):
        return False
    alike = effect.alike(values)
    return len(alike) < 2 or _are_same(layout, alike, vector)


def _are_same(layout: Layout, names: Sequence[str], vector: FloatArray) -> bool:
    """Whether there are two parameters, and they are declared the same."""
    values = [float(vector[layout.index[name]]) for name in names]
    return len(values) == 2 and abs(values[0] - values[1]) <= _SAME * abs(values[0])

"""What may wear: a parameter of the plant, or the strength of an effect at a place."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.candidates import Start, effect_starts
from eha_bench.plants.effect import AT, EVERYWHERE, BoundEffect
from eha_bench.plants.layout import Layout
from eha_bench.plants.model import Model

NOT_FOLLOWED = frozenset({"learned", "viscosity_temperature"})
"""A learned curve names nothing; what oil temperature does is taken out as a known influence."""

_SHARE = 0.1
"""Of a parameter's size: a change that may show."""


@dataclass(frozen=True)
class Cause:
    """One number of the machine that is followed.

    Attributes:
        id: the parameter's key, or the effect's id.
        at: where the effect acts, "" for a parameter and where there is one place only.
        key: of the number: `leakage`, `entrained_air.air_fraction`.
        place: of the number in a vector of parameters.
        settings: further places of the vector with the values that they have while it acts.
        low, high: bounds, SI. step: a change that shows, SI. unit: SI.
        is_calibrated: whether every night's calibration moves it.
    """

    id: str
    at: str
    key: str
    place: int
    settings: tuple[tuple[int, float], ...]
    low: float
    high: float
    step: float
    unit: str
    is_calibrated: bool = False

    @property
    def name(self) -> str:
        """What people call it: `entrained_air at chamber_a`."""
        return f"{self.id} at {self.at}" if self.at else self.id

    @property
    def is_effect(self) -> bool:
        """Whether it is the strength of an effect, and no parameter of the plant."""
        return self.key != self.id

    def apply(self, vector: FloatArray, value: float) -> FloatArray:
        """Return a vector with this number at a value, SI, within its bounds."""
        out = vector.copy()
        for place, setting in self.settings:
            out[place] = setting
        out[self.place] = min(max(value, self.low), self.high)
        return out


def causes_of(model: Model, follow: Sequence[str] = ()) -> tuple[Cause, ...]:
    """Return what of a model can be followed.

    Args:
        model: its plant with parameters and effects.
        follow: parameters and effects by name; all under `calibrate`, the strengths of declared
            effects, and every other effect that the plant has a place for, if empty. A name that
            the plant does not have gives nothing.
    """
    layout, vector = model.plant.layout, model.vector()
    wanted = {layout.key(name) for name in follow}
    found: list[Cause] = []
    own = {item.name for item in layout.parameters}
    # what is calibrated is followed as well: it may imitate what is asked for
    keys = [key for key in layout.by_key if key in own and key in {*model.calibrate, *wanted}]
    found += [_of_parameter(layout, key, vector) for key in keys]
    found = [replace(item, is_calibrated=item.key in model.calibrate) for item in found]
    declared = {item.id for item in model.effects}
    for effect in layout.effects:
        if follow and effect.id not in wanted:
            continue
        if not follow and effect.id in NOT_FOLLOWED:
            continue
        if effect.id in declared:
            key = f"{effect.id}.{effect.strength.name}"
            if effect.strength.size == 1:
                found.append(_of_parameter(layout, key, vector, effect.id))
            continue
        found += _of_effect(layout, effect)
    return tuple(found)


def _of_parameter(layout: Layout, key: str, vector: FloatArray, name: str = "") -> Cause:
    parameter = layout.by_key[key]
    size = max(abs(float(vector[layout.index[key]])), 0.1 * abs(parameter.default))
    width = parameter.high - parameter.low
    step = _SHARE * size or (0.01 * width if math.isfinite(width) else 1.0)
    return Cause(
        name or key, "", key, layout.index[key], (), parameter.low, parameter.high, step,
        parameter.unit,
    )  # fmt: skip


def _of_effect(layout: Layout, effect: BoundEffect) -> Iterator[Cause]:
    """Yield an effect at each of its places, as its search would begin there."""
    phased = any(item.unit == "rad" and item.name == "phase" for item in effect.parameters)
    if phased:
        return  # its size means nothing without an angle that every run begins at again
    places = [item for item in effect.parameters if item.name in (AT, "side")]
    seen: set[tuple[float, ...]] = set()
    for start in effect_starts(layout, effect):
        settings = dict(start.settings)
        words = tuple(settings[layout.index[f"{effect.id}.{item.name}"]] for item in places)
        if words in seen or start.strength == start.neutral:
            continue  # of several forms at one place the usual one stands for all
        seen.add(words)
        yield _of_start(layout, effect, start)


def _of_start(layout: Layout, effect: BoundEffect, start: Start) -> Cause:
    values = {
        item.name: dict(start.settings)[layout.index[f"{effect.id}.{item.name}"]]
        for item in effect.parameters
    }
    strength = effect.parameter_at(effect.strength.name, values)
    # what only refines what is there stands at its default, and makes no other cause
    words = [item.choices[round(values[item.name])] for item in effect.parameters
             if item.choices and not item.refines]  # fmt: skip
    place = effect.place(values) if AT in values else ""
    others = [word for word in words if word not in (place, EVERYWHERE)]
    at = ", ".join(part for part in (place, *others) if part)
    rest = tuple(item for item in start.settings if item[0] != start.strength_at)
    return Cause(
        effect.id, at, f"{effect.id}.{effect.strength.name}", start.strength_at, rest,
        start.low, start.high, abs(start.strength - start.neutral), strength.unit,
    )  # fmt: skip

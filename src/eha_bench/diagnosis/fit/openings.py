"""Settings that an effect opens at, held against what was measured.

A valve that is open most of the time is a leak with another name: above its setting, a relief valve
that drains to a tank is a leak that drains to a vessel of that pressure, and no recording tells the
two apart. So a setting is no lower than what is reached half of the time.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.gate import Measured
from eha_bench.plants.effect import BoundEffect
from eha_bench.plants.layout import Layout

_SAMPLES = 2000
"""Samples that a median is taken over, evenly spread."""


@dataclass(frozen=True)
class LeastSetting:
    """The least that a setting may be.

    Attributes:
        key: `effect.setting`. choices: places of the choices that it depends on.
        least: their values -> the setting, SI.
    """

    key: str
    choices: tuple[int, ...]
    least: dict[tuple[float, ...], float]

    def at(self, vector: FloatArray) -> float:
        """Return it for the choices of a vector of parameters, SI."""
        return self.least.get(tuple(float(vector[place]) for place in self.choices), -np.inf)


def least_settings(layout: Layout, runs: Iterable[Measured]) -> tuple[LeastSetting, ...]:
    """Return the least settings of a plant's effects.

    Args:
        layout: of the plant. runs: what was measured; those without both pressures say nothing.
    """
    opening = [effect for effect in layout.effects if effect.action.opens is not None]
    if not opening:
        return ()
    pairs = [pair for run in runs if (pair := _pair(run)).size]
    if not pairs:
        return ()
    pressures = np.concatenate(pairs)
    pressures = pressures[:: max(1, len(pressures) // _SAMPLES)]
    return tuple(_least(layout, effect, pressures) for effect in opening)


def _least(layout: Layout, effect: BoundEffect, pressures: FloatArray) -> LeastSetting:
    opening = effect.action.opens
    assert opening is not None
    names = [name for name in inspect.signature(opening.reached).parameters
             if name not in ("p_a", "p_b")]  # fmt: skip
    words = [range(len(effect.parameter(name).choices)) for name in names]
    least = {}
    for chosen in product(*words):
        values = tuple(map(float, chosen))
        reached = [opening.reached(p_a, p_b, *values) for p_a, p_b in pressures.tolist()]
        least[values] = float(np.median(reached))
    places = tuple(layout.index[f"{effect.id}.{name}"] for name in names)
    return LeastSetting(f"{effect.id}.{opening.setting}", places, least)


def _pair(run: Measured) -> FloatArray:
    """Return both pressures where both were read, (k, 2) Pa; none where they were not."""
    read = [run.inputs[name] if name in run.inputs else run.column(name) for name in run.roles.pair]
    known = [values for values in read if values is not None]
    if len(known) != 2:
        return np.zeros((0, 2))
    both = np.column_stack(known)
    return np.asarray(both[np.isfinite(both).all(axis=1)])

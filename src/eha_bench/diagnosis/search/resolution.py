"""What is too small to be told from how a log is read.

A delay is told from when a sample was stamped, and a play from where a sensor says that a part is.
Both may explain something significantly, and still be what a clock and the steps of an encoder do:
thousands of samples average noise out, and not what is always the same.
"""

from __future__ import annotations

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.search.state import Search
from eha_bench.plants.effect import BoundEffect


def below_reading(search: Search, start: Start, vector: FloatArray) -> str:
    """Say that an effect is smaller than its log can tell, as a clause, or nothing.

    Args:
        search: with the channels that are compared. start: of the effect. vector: as fitted.
    """
    if start.is_parameter:
        return ""
    layout = search.problem.plant.layout
    effect = layout.effect(start.candidate)
    size = abs(float(vector[start.strength_at]) - start.neutral)
    if effect.strength.unit == "s":
        return _within_stamps(search, effect, size)
    if effect.reversing:
        return _within_noise(search, effect, size, vector)
    return ""


def _within_stamps(search: Search, effect: BoundEffect, size: float) -> str:
    """Say that a delay or lag is shorter than stamps tell, or nothing."""
    tick = float(np.median([window.measured.tick for window in search.problem.windows]))
    if size >= search.thresholds.instant * tick:
        return ""
    return (
        f"its {effect.strength.name} of {1e3 * size:.2g} ms is too short to be told from time "
        f"stamps that are {1e3 * tick:.3g} ms apart"
    )


def _within_noise(search: Search, effect: BoundEffect, size: float, vector: FloatArray) -> str:
    """Say that a play is narrower than the noise of every sensor that would show it, or nothing."""
    problem = search.problem
    values = problem.plant.layout.choice_values(effect, vector)
    unit = effect.parameter_at(effect.strength.name, values).unit
    units = problem.plant.units
    read = {name: noise for name, noise in problem.noise.items() if units.get(name) == unit}
    own = {spot.motion[0] for spot in effect.spots_at(values)} & read.keys()
    finest = min(own or read, key=lambda name: read[name], default=None)
    if finest is None or size >= search.thresholds.narrow * read[finest]:
        return ""
    return (
        f"its {effect.strength.name} of {size:.2g} {unit} is within the noise of '{finest}', "
        f"{read[finest]:.2g} {unit}: the steps of a sensor make as much"
    )

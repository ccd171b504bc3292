"""An effect that is only the mean of what follows a variable.

A constant force explains half of what a spring that stiffens does, and a sensor's offset half of a
gain that is off. Where a curve of one variable explains nearly all that such a constant leaves at
its own place, that curve holds the constant as well, and nothing says that it is there.

A law of a speed is odd, and its mean is nothing: a weight beside a friction is no mean of that. Nor
is a zero beside what changes with the time.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from eha_bench.core.per_cent import per_cent
from eha_bench.diagnosis.outcome.refusal import Refusal
from eha_bench.diagnosis.outcome.remainder import Remainder
from eha_bench.diagnosis.search.state import Search
from eha_bench.plants.effect import BoundEffect

_TRIED = (-2.0, 0.0, 3.0)
"""Values to which a constant adds the same."""
_SAME = 1e-9


def only_a_mean(search: Search, left: Remainder) -> Refusal | None:
    """Return the effect that is no more than the mean of what remains, None for none.

    Args:
        search: with it. left: what remains beside the effects, and what that follows.
    """
    limits = search.thresholds
    if left.variable in ("", "time", *search.problem.plant.roles.rates):
        return None
    if left.share < 1.0 - limits.nearly_all:
        return None
    if left.explained < limits.nearly_all:
        return None
    layout = search.problem.plant.layout
    for item in search.effects:
        name = item.start.candidate
        if name in left.found_there and is_constant(layout.effect(name)):
            share = per_cent(min(item.comparison.share, item.comparison.share_out, 1.0))
            return Refusal(
                item,
                f"it is constant and explains {share}, and a curve of {left.variable} at its "
                f"place {per_cent(left.explained)} of what it leaves: it is the mean of what "
                f"follows {left.variable}",
            )
    return None


def is_constant(effect: BoundEffect) -> bool:
    """Whether an effect adds the same to a balance or a reading, whatever that is."""
    own = {item.name: float(item.default) for item in effect.parameters if item.size == 1}
    hooks = effect.action.hooks.values()
    return bool(hooks) and all(_adds_the_same(function, own) for function in hooks)


def _adds_the_same(function: Callable[..., Any], own: Mapping[str, float]) -> bool:
    """Whether a function of its first argument and of an effect's own numbers only shifts it."""
    _, *names = inspect.signature(function).parameters
    if not own.keys() >= set(names):
        return False
    added = [function(value, *(own[name] for name in names)) - value for value in _TRIED]
    return bool(np.ptp(added) < _SAME * max(1.0, *map(abs, added)))

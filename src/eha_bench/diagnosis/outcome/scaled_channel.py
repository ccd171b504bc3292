"""A channel of the wrong scale, which another number of a drawing imitates.

A pump's speed that is read 1.2 times too large looks like a pump of a smaller displacement, with a
motor's constant, an inertia and a drag that are off by powers of 1.2: the readings tell no
difference, but what is believed of these does. So where a number that nobody calibrates explains
what is missing, and takes others beyond what is believed of them, the channels are read with that
factor instead, and everything is calibrated anew with the number as declared.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from typing import Final

import numpy as np

from eha_bench.core.errors import InputError
from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.data.map_correction import Scaled
from eha_bench.diagnosis.fit.baseline import COARSE, Baseline, calibrated_baseline, gather
from eha_bench.diagnosis.fit.beliefs import contradicted
from eha_bench.diagnosis.fit.candidates import is_drawn
from eha_bench.diagnosis.fit.channel_mistakes import Suspect
from eha_bench.diagnosis.fit.evidence import excess
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.search.state import ALL_BUT_A_FORM, Search

_FAR: Final = 1.5
"""Multiple of what is given under `within` from which a number takes another one too far."""
_MOST: Final = 2
"""Most readings with which everything is calibrated anew: each takes as long as the first time."""


def with_scaled_channel(base: Baseline, search: Search, progress: ProgressHook) -> Baseline | None:
    """Return a calibration with the channel read right that a number imitates, or None for none.

    Args:
        base: as calibrated. search: finished.
        progress: called with the stage and the fraction of it done.
    """
    if search.effects or search.is_unexplained or base.dataset.computed:
        return None
    layout = search.problem.plant.layout
    numbers = [item.start for item in search.accepted if is_drawn(layout, item.start)]
    vector = search.fit.vector
    if len(numbers) != 1 or not contradicted(search.problem.beliefs, vector, _FAR):
        return None
    (number,) = numbers
    factor = float(vector[number.strength_at]) / number.neutral
    before = max(search.excess_base.relative, 0.0) + 1.0
    for suspect in _likeliest(base, factor):
        # what cannot be calibrated is no better reading
        with suppress(InputError):
            other = calibrated_baseline(suspect.corrects(base.dataset), progress)
            if holds(search, base, other):
                note = suspect.correction.note(math.sqrt(before), suspect.where)
                return other.noting_its_map(note)
    return None


def _likeliest(base: Baseline, factor: float) -> list[Suspect]:
    """Return speeds and positions that may be off by a factor, the best as declared first."""
    costs: dict[Suspect, float] = {}
    for suspect in _suspects(base, factor):
        with suppress(InputError):
            dataset = suspect.corrects(base.dataset)
            _, windows, noise, _ = gather(dataset)
            problem = Problem(dataset.model.plant, windows, noise, COARSE)
            vector = problem.places.lengthened(dataset.model.vector())
            problem.prepare(vector)
            costs[suspect] = float(np.abs(problem.residual(vector)).sum())
    return sorted(costs, key=lambda item: costs[item])[:_MOST]


def _suspects(base: Baseline, factor: float) -> Iterator[Suspect]:
    """Yield speeds and positions that may be read too large or too small by a factor."""
    maps = frozenset(run.channels for run in base.dataset.runs)
    roles = base.problem.plant.roles
    for name in base.problem.noise:
        if name in roles.rates or name in roles.rate_of:
            for scale in (factor, 1.0 / factor):
                yield Suspect(Scaled(name, scale), maps)


def holds(search: Search, base: Baseline, other: Baseline) -> bool:
    """Whether a calibration with a channel read otherwise leaves nothing of what was missing.

    It has all channels and runs that there were, and contradicts nothing that is believed.

    Args:
        search: without it. base: calibrated without it. other: with it.
    """
    left = excess(other.problem, other.fit)
    next_to_nothing = left.total < ALL_BUT_A_FORM * search.excess_base.total
    return (
        base.problem.noise.keys() <= other.problem.noise.keys()
        and len(other.left_out) <= len(base.left_out)
        and (next_to_nothing or not search.thresholds.is_unexplained(left))
        and not contradicted(other.problem.beliefs, other.fit.vector, _FAR)
    )

"""Drifting zeros, estimated from what a fitted model leaves, and a problem that knows of them.

A little that is slow and that no balance and no effect explains may as well be the sensors' own. So
it is asked only then; an effect that a drifting zero could imitate has had its turn before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.quiet import with_colours
from eha_bench.diagnosis.data.wander import NoiseStretch, Wander, wander_of
from eha_bench.diagnosis.fit.evidence import refined_noise
from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.residual_colour import steady_noise_of_residual

_QUIETER = 0.7
"""Level of a residual, in the noise, from which that was taken too large."""


def wandering(problem: Problem, fit: Fit) -> dict[str, Wander]:
    """Return the channels whose zeros wander, by what a fit leaves of their readings.

    Args:
        problem: prepared at the fit. fit: of a model that leaves hardly more than noise.
    """
    left = problem.with_best_start(fit.vector)
    names = problem.plant.outputs
    stretches: dict[str, list[NoiseStretch]] = {}
    for piece in problem.pieces:
        window = problem.windows[piece.window]
        for channel, rows in piece.by_channel():
            time = window.measured.time[window.first + piece.ticks[rows]]
            colour = window.measured.colours.get(names[channel])
            if time.size > 1:
                own = NoiseStretch(time, left[piece.rows][rows], colour)
                stretches.setdefault(names[channel], []).append(own)
    found = {name: wander_of(own) for name, own in stretches.items()}
    return {name: wander for name, wander in found.items() if wander is not None}


def with_noise_of_residual(problem: Problem, vector: FloatArray) -> Problem:
    """Return the same problem with levels and colours of noise as a fitted model leaves them.

    What nothing moves in for a while tells colours to a tenth; a zero that wanders is smaller. It
    needs `prepare`.

    Args:
        problem: prepared at the vector. vector: of the fitted model.
    """
    seen = steady_noise_of_residual(problem, vector)
    # a channel whose level is seen, and no colour, is white
    coloured = problem.with_measured(
        lambda item: with_colours(
            item,
            {name: own for name, own in item.colours.items() if name not in seen.levels}
            | dict(seen.colours),
        ),
    )
    # where no stretch is long enough, a channel is no louder than what is left of it
    refined = refined_noise(problem, problem.residual(vector), problem.noise)
    quieter = {
        name: level
        for name, level in refined.items()
        if name not in seen.levels and level < _QUIETER * problem.noise[name]
    }
    return coloured.with_noise({**problem.noise, **seen.levels, **quieter})


def with_wander(problem: Problem, wander: Mapping[str, Wander]) -> Problem:
    """Return the same problem, to which wandering zeros are noise; it needs `prepare`."""
    return problem.with_measured(lambda item: replace(item, wander=wander))


def refit_with_noise(problem: Problem, fit: Fit) -> Fit:
    """Return the fit in a problem whose noise is another one."""
    problem.prepare(fit.vector)
    problem.scale_to(problem.residual(fit.vector))
    return levenberg_marquardt(problem, fit.vector, fit.free, refresh=1)

"""By how much commands lead what was logged of them, estimated from what a calibration leaves.

No machine answers before it is asked, so no effect can take what a lead explains, and a lead takes
nothing from an effect: a delay or a lag asks for the opposite. What the calibrated parameters can
do as well is not counted as the lead's (the slope is projected on what no parameter does).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.note import Note
from eha_bench.diagnosis.data.command_lead import MOST, led, period_of, share_of
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.windows import Window, runs_of
from eha_bench.diagnosis.fit.evidence import FURTHEST
from eha_bench.diagnosis.fit.least_squares import (
    Fit,
    calibrated_directions,
    levenberg_marquardt,
)
from eha_bench.diagnosis.fit.problem import Problem

_TRIED = 0.25
"""Share of a sample period at which a lead's slope is taken."""
_GAIN = 30.0
"""Least fall of the cost that says that there is one: 5.5 standard deviations."""
_SHARE = 0.02
"""... and as a share of the cost: beside a large effect its errors have some of every shape."""
_LEAST = 0.02
"""Least lead, as a share of a sample period, that is worth a word."""
_SELDOM = 0.2
"""Share of a sample period below which a command as good as goes straight between samples."""
_OFTEN = (
    "'{channel}' was given about every {given:.2g} ms and logged every {logged:.3g} ms: it is "
    "taken to act {lead:.2g} ms before it was logged, which is no effect"
)
_CONTINUOUS = (
    "'{channel}' goes on between the samples of its log, {logged:.3g} ms apart: it is taken to act "
    "{lead:.2g} ms before it was logged, which is no effect"
)
_LOUD = 6.0
"""Mean square of a residual, in the noise's, from which it tells nothing of a lead: a wrong model's
errors have some of every shape. It is asked again beside what was found."""
_PART = 0.3
"""Part of what is left beyond the noise that a lead takes, as well: beside a cause that is not
found yet it would take a few per cent, and bias what is found then."""
_ROUNDS = 3
_THERE = 0.01
"""Change of a lead up to which it has arrived."""


def command_leads(problem: Problem, fit: Fit) -> tuple[dict[str, float], Problem, Fit]:
    """Return how often commands were given (input -> s), and the problem and the fit with that.

    Empty, and what they were, where each value that was given is in the log.

    Args:
        problem: of runs as they were logged, prepared at the fit. fit: of the calibrated model.
    """
    found: dict[str, float] = {}
    if not problem.windows:
        return found, problem, fit
    pending, before = _commands(problem), -1
    # what is much of the rest beside one that was found may not have been before
    while pending and len(found) > before:
        before = len(found)
        for name in pending:
            period, reached = _lead_of(problem, fit, found, name)
            if period is not None:
                found[name], fit = period, reached
        pending = [name for name in pending if name not in found]
    if not found:
        return found, problem, fit
    done = _with(problem, found, fit)
    return found, done, levenberg_marquardt(done, fit.vector, fit.free)


def _lead_of(
    problem: Problem, fit: Fit, found: Mapping[str, float], name: str
) -> tuple[float | None, Fit]:
    """Return how often a command was given, s, and the fit with that; None where no lead is seen.

    Args:
        problem, fit: as of `command_leads`. found: of other commands. name: of this one.
    """
    tick = float(np.median([window.measured.tick for window in problem.windows]))
    share, there, best = 0.0, problem, fit
    for _ in range(_ROUNDS):
        least = max(_GAIN, _SHARE * best.cost) if share == 0.0 else _GAIN
        new, gain = _better(problem, there, best, found, name, share, tick)
        if gain < least or abs(new - share) < _THERE:
            break
        share = new
        there = _with(problem, {**found, name: period_of(share, tick)}, best)
        best = levenberg_marquardt(there, best.vector, best.free)
    if share < _LEAST or not best.cost < fit.cost - _GAIN:
        return None, fit
    # rows that were lost, beside which a lead is one error for another, must not decide, nor a
    # fit that stopped short of its bottom with a lag too long
    alone = levenberg_marquardt(_with(problem, found, best), best.vector, best.free)
    little = _squares(best) < _LOUD * best.residual.size
    beyond = _squares(alone) - alone.residual.size
    if little and _squares(alone) - _squares(best) > max(_GAIN, _PART * beyond):
        return period_of(share, tick), best
    return None, fit


def with_leads(
    measured: Sequence[Measured], windows: Sequence[Window], periods: Mapping[str, float]
) -> tuple[tuple[Measured, ...], list[Window]]:
    """Return runs and windows whose commands lead what was logged of them."""
    own = {item.run.name: led(item, periods) for item in measured}
    return tuple(own.values()), [
        replace(window, measured=own[window.measured.run.name]) for window in windows
    ]


def lead_notes(measured: Sequence[Measured]) -> tuple[Note, ...]:
    """Say which commands were given more often than they were logged."""
    first = measured[0]
    return tuple(
        Note(
            _CONTINUOUS if period < _SELDOM * first.tick else _OFTEN,
            channel=name,
            given=1e3 * period,
            logged=1e3 * first.tick,
            lead=1e3 * first.tick * share_of(period, first.tick),
        )
        for name, period in first.given_every.items()
    )


def _commands(problem: Problem) -> list[str]:
    """Return inputs that are held between samples and change from one to the next."""
    held, runs = problem.plant.held_inputs, runs_of(problem.windows)
    return [
        name
        for name in held
        if any(name in item.inputs and np.ptp(item.inputs[name]) > 0.0 for item in runs)
    ]


def _better(
    problem: Problem,
    there: Problem,
    fit: Fit,
    others: Mapping[str, float],
    name: str,
    share: float,
    tick: float,
) -> tuple[float, float]:
    """Return the lead of a command that leaves least, to first order, and the fall of the cost."""
    tried = share + _TRIED if share + _TRIED <= MOST else share - _TRIED
    other = _with(problem, {**others, name: period_of(tried, tick)}, fit)
    left, weight, basis = calibrated_directions(fit, there.soft)
    left = _beside(left, basis)
    slope = (other.residual(fit.vector) - fit.residual) / (tried - share)
    slope = _beside(slope * weight, basis)
    size, along = float(slope @ slope), float(left @ slope)
    if not size > 0.0:
        return share, 0.0
    new = float(np.clip(share - along / size, 0.0, MOST))
    further = new - share
    return new, -2.0 * further * along - further**2 * size


def _squares(fit: Fit) -> float:
    """Return the sum of squares of a residual in which no reading counts for more than a few."""
    return float(np.sum(np.clip(fit.residual, -FURTHEST, FURTHEST) ** 2))


def _with(problem: Problem, periods: Mapping[str, float], fit: Fit) -> Problem:
    """Return the problem of runs whose commands lead, prepared at a fit."""
    other = problem.with_measured(lambda item: led(item, periods))
    other.prepare(fit.vector)
    other.scale_to(other.residual(fit.vector))
    return other


def _beside(column: FloatArray, basis: FloatArray) -> FloatArray:
    return np.asarray(column - basis @ (basis.T @ column), dtype=np.float64)

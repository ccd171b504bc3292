"""Where a model holds: its error by the value of every channel, and beyond what it was fitted to.

For an error e of one channel and the value q of another (or of itself) at the same samples, over
whole replays of all runs,

    error(bin) = sqrt(mean of e^2 over the samples whose q lies in the bin).

Five bins of equal width part what the fitted runs covered of q; one more lies below, one above. A
model that is right errs alike in all of them; where it does not, it lacks something that acts
there, or was never there before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray
from eha_bench.core.finite import finite_or_none
from eha_bench.diagnosis.data.dataset import Use
from eha_bench.diagnosis.replay.replay import Replay
from eha_bench.posterior.covered import Beyond, Covered, CoveredSetup, setup_of

_INNER: Final = 5
_FEWEST: Final = 10
"""Samples from which on a bin has an error."""
_MOVES: Final = 10.0
"""Standard deviations of its noise that a channel has to move to be asked where it is."""
_WORSE: Final = 2.0
"""An error beyond what was fitted that is so many times the one within it is said."""
_SEEN: Final = 3.0
"""So many noise floors that error has to be."""


@dataclass(frozen=True)
class ErrorBin:
    """The error where a channel lies between two values.

    Attributes:
        low, high: the values, SI. error: root mean square, SI; NaN with too few samples.
        seconds: of all runs there. fitted: of the training runs there, s.
    """

    low: float
    high: float
    error: float
    seconds: float
    fitted: float

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "low": self.low,
            "high": self.high,
            "error": finite_or_none(self.error),
            "seconds": self.seconds,
            "fitted_seconds": self.fitted,
        }


@dataclass(frozen=True)
class ErrorByValue:
    """The error of a channel by the value of another, or of itself.

    Attributes:
        channel, unit: whose error it is. by, by_unit: whose value parts it.
        below, above: beyond what the fitted runs covered; None where no run goes there.
        bins: within it, in order.
    """

    channel: str
    unit: str
    by: str
    by_unit: str
    below: ErrorBin | None
    bins: tuple[ErrorBin, ...]
    above: ErrorBin | None

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "channel": self.channel,
            "unit": self.unit,
            "by": self.by,
            "by_unit": self.by_unit,
            "below": None if self.below is None else self.below.to_dict(),
            "bins": [item.to_dict() for item in self.bins],
            "above": None if self.above is None else self.above.to_dict(),
        }


def errors_by_value(replays: Sequence[Replay], covered: Covered) -> tuple[ErrorByValue, ...]:
    """Return the last model's errors by the value of every channel that moves.

    Args:
        replays: of all runs. covered: where the fitted ones have been.
    """
    ranges = _ranges(covered)
    names = sorted({name for item in replays for name in item.measured})
    rows = []
    for name in names:
        own = [item for item in replays if name in item.measured and item.time.size > 1]
        errors = [(item, item.errors(name)[-1]) for item in own]
        for by, ends in ranges.items():
            row = _row(errors, name, by, ends, covered.margin(by, ends))
            if row is not None:
                rows.append(row)
    return tuple(rows)


def _ranges(covered: Covered) -> dict[str, tuple[float, float]]:
    """Return what was covered of each channel that moves, in any setup."""
    found: dict[str, tuple[float, float]] = {}
    for setup in covered.setups:
        for name, (low, high) in setup.extremes.items():
            known = found.get(name, (low, high))
            found[name] = min(low, known[0]), max(high, known[1])
    return {
        name: ends
        for name, ends in found.items()
        if ends[1] - ends[0] > _MOVES * covered.noise.get(name, 0.0)
    }


def _row(
    errors: Sequence[tuple[Replay, FloatArray]],
    name: str,
    by: str,
    ends: tuple[float, float],
    margin: float,
) -> ErrorByValue | None:
    """Return the error of a channel by the value of another; None where both are in no run."""
    edges = np.linspace(*ends, _INNER + 1)
    squares, counts = np.zeros(_INNER + 2), np.zeros(_INNER + 2)
    seconds, fitted = np.zeros(_INNER + 2), np.zeros(_INNER + 2)
    lowest, highest = ends
    unit = by_unit = ""
    for item, error in errors:
        value = _values(item, by)
        if value is None:
            continue
        unit, by_unit = item.unit(name), item.unit(by)
        there = np.isfinite(error) & np.isfinite(value)
        where = np.clip(np.digitize(value, edges[1:-1]) + 1, 1, _INNER)
        where[value < ends[0] - margin] = 0
        where[value > ends[1] + margin] = _INNER + 1
        where = where[there]
        count = np.bincount(where, minlength=_INNER + 2)
        squares += np.bincount(where, error[there] ** 2, minlength=_INNER + 2)
        counts += count
        seconds += count * item.tick
        fitted += count * item.tick * (item.use is Use.TRAIN)
        if there.any():
            lowest = min(lowest, float(value[there].min()))
            highest = max(highest, float(value[there].max()))
    if not counts.any():
        return None

    def part(number: int, low: float, high: float) -> ErrorBin:
        enough = counts[number] >= _FEWEST
        error = math.sqrt(squares[number] / counts[number]) if enough else math.nan
        return ErrorBin(low, high, error, float(seconds[number]), float(fitted[number]))

    inner = (part(k + 1, float(edges[k]), float(edges[k + 1])) for k in range(_INNER))
    return ErrorByValue(
        name,
        unit,
        by,
        by_unit,
        part(0, lowest, ends[0]) if counts[0] else None,
        tuple(inner),
        part(_INNER + 1, ends[1], highest) if counts[-1] else None,
    )


def _values(item: Replay, name: str) -> FloatArray | None:
    """Return a channel of a run, measured or imposed; None where it has none."""
    found = item.measured.get(name)
    return item.inputs.get(name) if found is None else found


def beyond_notes(
    replays: Sequence[Replay], covered: Covered, floors: Mapping[str, float]
) -> Iterator[str]:
    """Say where held-out runs go beyond what was fitted, and the last model errs more there.

    Args:
        replays: of all runs. covered: where the fitted ones have been.
        floors: channel -> noise floor, SI.
    """
    for item in replays:
        if item.use is Use.TRAIN or item.time.size < 2:
            continue
        setup = covered.setup(*setup_of(locked=item.locked, bypass_open=item.bypass_open))
        if setup is None:
            continue
        worst = max(
            (
                (error / inside, beyond, name, error, inside)
                for beyond in covered.beyond(setup, _extremes(item, setup))
                for name in item.measured
                for error, inside in [_beyond_and_within(replays, item, beyond, name)]
                if error > _WORSE * inside and error > _SEEN * floors.get(name, 0.0)
            ),
            key=lambda found: found[0],
            default=None,
        )
        if worst is None:
            continue
        _, beyond, name, error, inside = worst
        unit, by = item.unit(name), item.unit(beyond.channel)
        yield (
            f"{item.run} ({item.use.value}) takes '{beyond.channel}' to {beyond.reached:.3g} {by}, "
            f"and fitted runs went from {beyond.low:.3g} to {beyond.high:.3g}: beyond that the "
            f"model errs by {error:.3g} {unit} in '{name}', within it by {inside:.3g}"
        )


def _extremes(item: Replay, setup: CoveredSetup) -> dict[str, tuple[float, float]]:
    found = {}
    for name in setup.extremes:
        values = _values(item, name)
        known = None if values is None else values[np.isfinite(values)]
        if known is not None and known.size:
            found[name] = float(known.min()), float(known.max())
    return found


def _beyond_and_within(
    replays: Sequence[Replay], item: Replay, beyond: Beyond, name: str
) -> tuple[float, float]:
    """Return a channel's error in a run beyond what was fitted, and in all runs within it."""
    outside = _rms([(item, _is_beyond(item, beyond))], name)
    inside = [(other, ~_is_beyond(other, beyond)) for other in replays if name in other.measured]
    return outside, _rms(inside, name)


def _is_beyond(item: Replay, beyond: Beyond) -> BoolArray:
    values = _values(item, beyond.channel)
    if values is None:
        return np.zeros(item.time.size, bool)
    return (values < beyond.low) | (values > beyond.high)


def _rms(parts: Sequence[tuple[Replay, BoolArray]], name: str) -> float:
    """Return the last model's error over parts of runs; NaN over too few samples."""
    errors = [item.errors(name)[-1][where] for item, where in parts]
    together = np.concatenate([error[np.isfinite(error)] for error in errors] or [np.empty(0)])
    return float(np.sqrt(np.mean(together**2))) if together.size >= _FEWEST else math.nan

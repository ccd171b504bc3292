"""Calibrates with a topic read earlier than it is stamped, where its clock is late by much.

A logger stamps what comes over another bus when it arrives, always late by the same. A fit takes up
two milliseconds of it (`fit.own_parameters`) and no more: of what moves slowly, a time by which all
is late and a lag of its sensors are nearly one. Where a topic's readings are much nearer to what
was simulated some time before, everything is calibrated anew with that topic read earlier, and
again with a lag of its sensors instead. It is the clock where next to nothing is left of what was
missing, and a lag leaves no less. Where a lag leaves as little, the clock is taken all the same, as
it accuses nothing of the machine, and the lag is said.

Only a topic beside which another one is read can be late: if all are, the machine may be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import ndtr

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import InputError
from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.data.dataset import Dataset
from eha_bench.diagnosis.fit.baseline import (
    COARSE,
    STEP,
    Baseline,
    CalibrationInterrupted,
    calibrated_baseline,
)
from eha_bench.diagnosis.fit.candidates import Start, start_values
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN
from eha_bench.diagnosis.fit.least_squares import levenberg_marquardt
from eha_bench.diagnosis.fit.own_parameters import is_latest
from eha_bench.diagnosis.fit.problem import Problem, soften
from eha_bench.diagnosis.fit.thresholds import DEFAULT
from eha_bench.diagnosis.search.refit import free_of
from eha_bench.diagnosis.search.state import Accepted, Search, begin, starts_of

_FURTHEST: Final = 50e-3
"""Most that a topic is looked for to be late by, s; early likewise."""
_FINE: Final = 1e-3
"""Step in which that is looked for, s: the fit finds the rest."""
_NEARER: Final = 0.5
"""Mean square distance of its readings from a simulation of another time, over that from one of
their own, from which a topic may be late."""
_FEWEST: Final = 20
"""Fewest readings that are compared."""
_ROUNDS: Final = 3
"""Most calibrations until a topic is read at its time: what it is late by bends parameters."""
_LEFT: Final = 0.1
"""Largest share of the excess that a late clock leaves."""
_BLOCK: Final = 0.1
"""Length of the blocks by which two calibrations are compared, s."""


@dataclass(frozen=True)
class _Costs:
    """Cost of readings with their noise, soft-L1, by run and block."""

    of_blocks: Mapping[tuple[str, int], float]
    readings: int

    @property
    def total(self) -> float:
        """Cost of all."""
        return sum(self.of_blocks.values())

    @property
    def excess(self) -> float:
        """Cost beyond the noise's."""
        return max(self.total - SOFT_MEAN * self.readings, 0.0)

    def is_behind(self, other: _Costs, least: float, chance: float) -> bool:
        """Whether another one costs clearly less.

        Args:
            other: of about the same readings. least: difference of the cost. chance: probability
                up to which it is clear, as of a normal sum over blocks.
        """
        both = self.of_blocks.keys() & other.of_blocks.keys()
        more = np.array([self.of_blocks[key] - other.of_blocks[key] for key in both])
        spread = float(more.std()) * np.sqrt(more.size)
        gain = float(more.sum())
        return gain > least and float(ndtr(-gain / max(spread, 1e-300))) < chance


def with_late_topics(base: Baseline, progress: ProgressHook, *, loud: bool) -> Baseline:
    """Return a calibration with late topics read earlier, or the same where none is late.

    Args:
        base: a calibration. progress: called with the stage and the fraction of it done.
        loud: whether its error is far above the noise.

    Raises:
        CalibrationInterrupted: Ctrl-C; with the calibration so far.
    """
    try:
        for clock, channels in _topics(base).items():
            if loud or _is_at_bound(base, clock):
                base = _with_late_topic(base, clock, channels, progress)
    except KeyboardInterrupt as stop:
        raise CalibrationInterrupted(base) from stop
    return base


def with_clock_instead(base: Baseline, search: Search, progress: ProgressHook) -> Baseline | None:
    """Return a calibration with a topic read earlier, where a lag stands for its clock; or None.

    Beside another cause a late clock does not explain nearly all: only once that is found does it
    show that the clock leaves no more than the lag that was found with it.

    Args:
        base: as calibrated. search: finished.
        progress: called with the stage and the fraction of it done.
    """
    for item in search.effects:
        for clock, channels in _topics(base).items():
            if _is_lag(search, item.start, channels):
                # what cannot be calibrated is no better reading
                with suppress(InputError):
                    found = _instead_of(base, search, item, clock, channels, progress)
                    if found is not None:
                        return found
    return None


def _instead_of(
    base: Baseline,
    search: Search,
    lag: Accepted,
    clock: str,
    channels: tuple[str, ...],
    progress: ProgressHook,
) -> Baseline | None:
    """Return a calibration with a topic read earlier, beside all else that was found, or None."""
    places, vector = search.problem.places, search.fit.vector
    constant = float(vector[lag.start.strength_at])
    by = constant + places.lateness(vector).get(clock, 0.0)
    others = [item.start for item in search.accepted if item is not lag]
    own, size = places.values(vector), places.layout.size
    vector, other = lag.start.off(vector), base
    for _ in range(_ROUNDS):
        other = calibrated_baseline(_read_earlier(other, clock, channels, by), progress)
        if not _has_all_of(base, other):
            return None
        there = other.problem.places
        begun = there.with_values(there.lengthened(vector[:size]), own)
        problem = other.problem.with_noise(other.problem.noise).at_step(COARSE)
        problem.prepare(begun)
        problem.scale_to(problem.residual(begun))
        free = free_of(begin(other, search.thresholds), begun, others)
        vector = levenberg_marquardt(problem, begun, free).vector
        by = there.lateness(vector).get(clock, 0.0)
        if not is_latest(by):
            break
    noise = other.problem.noise
    costs = _costs(other.problem, vector, noise)
    of_lag = _costs(search.problem, search.fit.vector, noise)
    limits = search.thresholds
    if costs.is_behind(of_lag, limits.gain, limits.p_value):
        return None
    if of_lag.is_behind(costs, limits.behind, limits.chance):
        return other
    return other.noting_its_map(_either(channels, lag.start, constant))


def _either(channels: Sequence[str], lag: Start, constant: float) -> str:
    """Say that a late clock and a lag of a time constant, s, explain as much."""
    names = " and ".join(f"'{name}'" for name in channels)
    return (
        f"CAUTION: that the stamps of {names} are late is not distinguished here from "
        f"{lag.candidate} of {1e3 * constant:.3g} ms: compare their clock with that of the inputs"
    )


def _topics(base: Baseline) -> dict[str, tuple[str, ...]]:
    """Return clock -> channels, of topics that drive nothing and beside which others are read."""
    found: dict[str, dict[str, None]] = {}
    compared = base.problem.noise.keys()
    for measured in base.measured:
        for name, clock in measured.topic_of.items():
            if name in compared:
                found.setdefault(clock, {})[name] = None
    return {clock: (*own,) for clock, own in found.items() if compared - own.keys()}


def _is_at_bound(base: Baseline, clock: str) -> bool:
    return is_latest(base.problem.places.lateness(base.fit.vector).get(clock, 0.0))


def _with_late_topic(
    base: Baseline, clock: str, channels: tuple[str, ...], progress: ProgressHook
) -> Baseline:
    """Return a calibration with a topic read earlier, or the same where it is not late."""
    best = base
    for _ in range(_ROUNDS):
        by = _later_by(best, clock, channels)
        if by == 0.0:
            break
        # what cannot be calibrated is no better reading
        with suppress(InputError):
            other = calibrated_baseline(_read_earlier(best, clock, channels, by), progress)
            if _has_all_of(best, other):
                best = other
                continue
        break
    if best is base or not _is_late(base, best):
        return base
    noise = best.problem.noise
    late, lag = _costs(best.problem, best.fit.vector, noise), _with_lag(base, best, clock, channels)
    if lag is None:
        return best
    start, costs, constant = lag
    if late.is_behind(costs, DEFAULT.gain, DEFAULT.p_value):
        return base
    if costs.is_behind(late, DEFAULT.behind, DEFAULT.chance):
        return best
    return best.noting_its_map(_either(channels, start, constant))


def _later_by(base: Baseline, clock: str, channels: Sequence[str]) -> float:
    """Return how much later than they are simulated a topic's readings come, s; 0 for not at all.

    What a fit takes up counts.
    """
    problem, vector = base.problem, base.fit.vector
    late = problem.places.lateness(vector)
    lags = np.arange(-round(_FURTHEST / _FINE), round(_FURTHEST / _FINE) + 1) * _FINE
    left, count = np.zeros(lags.size), 0
    columns = {name: problem.plant.outputs.index(name) for name in channels}
    for window, simulated in zip(problem.windows, problem.corrected_outputs(vector), strict=True):
        measured = replace(window.measured, lateness={**window.measured.lateness, **late})
        span = slice(window.first, window.last)
        time = measured.time[span]
        for name, column in columns.items():
            read = measured.column(name)
            if read is None:
                continue
            taken = measured.at(name, span)
            there = np.isfinite(read[span])
            there &= (taken >= time[0] + _FURTHEST) & (taken <= time[-1] - _FURTHEST)
            if np.count_nonzero(there) < 2:
                continue
            instants = taken[there] - lags[:, None]
            earlier = np.interp(instants, time, simulated[: time.size, column])
            apart = (read[span][there] - earlier) / problem.noise[name]
            left += np.sum((apart - apart.mean(axis=1, keepdims=True)) ** 2, axis=1)
            count += int(np.count_nonzero(there))
    own = lags.size // 2
    best = int(np.argmin(left))
    nearer = float(left[best]) < _NEARER * float(left[own])
    if count < _FEWEST or not (nearer or _is_at_bound(base, clock)):
        return 0.0
    return float(lags[best]) + late.get(clock, 0.0)


def _read_earlier(base: Baseline, clock: str, channels: Sequence[str], by: float) -> Dataset:
    """Return a dataset of which a topic is read earlier, by more than it is."""
    runs = []
    for run in base.dataset.runs:
        before = run.stamped_late.get(clock, 0.0)
        late = {**run.stamped_late, **dict.fromkeys((clock, *channels), before + by)}
        runs.append(replace(run, stamped_late=late))
    return replace(base.dataset, runs=tuple(runs))


def _has_all_of(base: Baseline, other: Baseline) -> bool:
    """Whether another calibration has the channels and runs that there were."""
    has_channels = base.problem.noise.keys() <= other.problem.noise.keys()
    return has_channels and len(other.left_out) <= len(base.left_out)


def _is_late(base: Baseline, other: Baseline) -> bool:
    """Whether a topic that is read earlier leaves next to nothing of what was missing."""
    noise = other.problem.noise
    before = _costs(base.problem, base.fit.vector, noise)
    after = _costs(other.problem, other.fit.vector, noise)
    return before.is_behind(after, DEFAULT.gain, DEFAULT.p_value) and (
        after.excess / max(after.readings, 1) < _LEFT * before.excess / max(before.readings, 1)
    )


def _with_lag(
    base: Baseline, late: Baseline, clock: str, channels: Sequence[str]
) -> tuple[Start, _Costs, float] | None:
    """Return a lag of a topic's sensors that leaves least, its costs, and its time constant, s.

    It begins from parameters that a late clock does not bend, and from those that it does.

    Args:
        base: a calibration with stamps as they are. late: with the topic read earlier.
        clock, channels: of the topic.
    """
    search = begin(base)
    noise, size = late.problem.noise, base.problem.plant.layout.size
    problem = base.problem.with_noise(noise).at_step(COARSE)
    unbent = problem.places.lengthened(late.fit.vector[:size])
    unbent = problem.places.with_values(unbent, late.problem.places.values(late.fit.vector))
    by = max((item.read_earlier for item in late.problem.places.late if item.clock == clock),
             default=0.0)  # fmt: skip
    if not by > 0.0:
        # no lag makes readings early
        return None
    found = []
    for start in (item for item in starts_of(search) if _is_lag(search, item, channels)):
        for begun, share in ((unbent, by / start.strength), (base.fit.vector, 1.0)):
            vector = start.clipped(start.apply(begun, share))
            problem.prepare(vector)
            problem.scale_to(problem.residual(vector))
            fit = levenberg_marquardt(problem, vector, free_of(search, vector, [start]))
            costs = _costs(problem.at_step(STEP), fit.vector, noise)
            found.append((start, costs, float(fit.vector[start.strength_at])))
    return min(found, key=lambda item: item[1].total) if found else None


def _is_lag(search: Search, start: Start, channels: Sequence[str]) -> bool:
    """Whether a candidate is a lag of sensors of which a topic has some."""
    if start.is_parameter:
        return False
    layout = search.problem.plant.layout
    effect = layout.effect(start.candidate)
    spots = effect.spots_at(start_values(layout, effect, start))
    sensors = {name for spot in spots for name in spot.sensors}
    return effect.strength.unit == "s" and not sensors.isdisjoint(channels)


def _costs(problem: Problem, vector: FloatArray, noise: Mapping[str, float]) -> _Costs:
    """Return the costs of a calibration by a noise."""
    weighted = problem.with_noise(noise)
    weighted.prepare(vector)
    soft, _ = soften(weighted.residual(vector))
    squares = soft[: weighted.size] ** 2
    found: dict[tuple[str, int], float] = {}
    for piece in weighted.pieces:
        window = weighted.windows[piece.window]
        numbers = np.floor(window.measured.time[window.first + piece.ticks] / _BLOCK).astype(int)
        own = squares[piece.rows]
        for number in np.unique(numbers):
            key = (window.measured.run.name, int(number))
            found[key] = found.get(key, 0.0) + float(own[numbers == number].sum())
    return _Costs(found, weighted.size)

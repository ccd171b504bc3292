"""A sensor of another gain, which explains all that no effect explains.

A pressure sensor that reads 12 % low bends every parameter, and an offset of it explains half of
that. A gain is no effect of the machine: a constant factor of one channel is fitted beside what is
calibrated instead (`followed_doubt`). It is believed only where it leaves next to nothing,
contradicts nothing that is believed, and does better than the effects that were found. What is
missing is then known, but acts in a sensor, so the verdict is no pass.

Source: IEC 61298-2:2008 (span error of measuring devices).
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

from eha_bench.core.errors import InputError
from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.data.map_correction import Scaled
from eha_bench.diagnosis.fit.baseline import Baseline, calibrated_baseline
from eha_bench.diagnosis.fit.channel_mistakes import Suspect, tied_channels
from eha_bench.diagnosis.fit.evidence import excess
from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem, cost_of
from eha_bench.diagnosis.outcome.decide import Decision
from eha_bench.diagnosis.outcome.diagnosis import Unknown, Verdict
from eha_bench.diagnosis.outcome.doubt import ChannelScale
from eha_bench.diagnosis.outcome.followed_doubt import promised, promised_further
from eha_bench.diagnosis.outcome.scaled_channel import holds
from eha_bench.diagnosis.search.state import Search

_FOLLOWED: Final = 2
"""Sensors that are followed, the most promising ones."""
_ROUNDS: Final = 8
_FURTHEST: Final = 10.0
"""Factor by which a sensor may be off at most."""
_ENDED: Final = 3e-4
"""Relative step of a factor that ends it: a third of the noise of a range of a thousand times."""
_LEAST: Final = 0.03
"""Least relative error of a gain: less is within a sensor's class, or a form of what is there."""


@dataclass(frozen=True)
class ScaledSensor:
    """A sensor that reads a factor of what there is.

    Attributes:
        channel: it. gain: what it reads of what there is. share: of what was missing that goes.
        base: calibrated with it read right.
    """

    channel: str
    gain: float
    share: float
    base: Baseline

    def decided(self, decision: Decision) -> Decision:
        """Return the verdict on readings that were put right, where nothing else is missing."""
        if decision.verdict is not Verdict.NONE:
            return decision
        unknown = Unknown(
            "measurement", (self.channel,), self.base.notes[0], self.share,
            at=f"{self.channel}.sensor",
            sensor=f"'{self.channel}' reads {self.gain:.4g} times what there is",
        )  # fmt: skip
        return replace(decision, verdict=Verdict.UNKNOWN, unknown=unknown)


def scaled_sensor(base: Baseline, search: Search, progress: ProgressHook) -> ScaledSensor | None:
    """Return the sensor whose gain explains what no effect does, None for none.

    Args:
        base: as calibrated. search: finished.
        progress: called with the stage and the fraction of it done.
    """
    limits = search.thresholds
    if not search.is_unexplained or base.dataset.computed:
        return None
    problem = search.problem.apart()
    problem.prepare(search.base.vector)
    fit = replace(search.base, cost=cost_of(problem, search.base.vector))
    promises = promised(problem, fit, map(ChannelScale, _with_a_gain(base)))
    least = limits.explained * search.excess_base.total
    falls = {doubt: item.fall for doubt, item in promises.items() if item.fall > least}
    promising = sorted(falls, key=lambda doubt: -falls[doubt])
    fitted: list[tuple[float, str, float]] = []
    for doubt in promising[:_FOLLOWED]:
        factor, end = _fitted(problem, fit, doubt)
        if abs(math.log(factor)) > _LEAST and end.cost < search.fit.cost - limits.behind:
            fitted.append((end.cost, doubt.channel, factor))
    for _, channel, factor in sorted(fitted):
        found = _read_right(base, search, channel, factor, progress)
        if found is not None:
            return found
    return None


def _with_a_gain(base: Baseline) -> list[str]:
    """Return the compared channels of which a factor says something, each on its own."""
    units = base.problem.plant.units
    alone = base.problem.noise.keys() - tied_channels(base)
    # a factor of kelvins is an offset
    return sorted(name for name in alone if units.get(name) != "K")


def _fitted(problem: Problem, fit: Fit, doubt: ChannelScale) -> tuple[float, Fit]:
    """Return the factor of a sensor, and the fit of what is calibrated; 1 where none is reached.

    Far from the right gain its slopes hold only nearby, and so do those of what is calibrated. The
    factor of a sensor that reads noise alone grows without end: it would make its noise small.
    """
    factor, end = 1.0, fit
    for _ in range(_ROUNDS):
        # what is calibrated stays where it is: far from the right gain it would make up for it
        step = promised_further(problem, end, doubt, factor).factor
        factor *= step
        if abs(math.log(factor)) > math.log(_FURTHEST):
            break
        other, vector = doubt.times(problem, end.vector, factor)
        end = levenberg_marquardt(other, vector, fit.free)
        if abs(math.log(step)) < _ENDED:
            return factor, end
    return 1.0, fit


def _read_right(
    base: Baseline, search: Search, channel: str, factor: float, progress: ProgressHook
) -> ScaledSensor | None:
    """Return a sensor with everything calibrated anew, None where that does not hold."""
    maps = frozenset(run.channels for run in base.dataset.runs)
    suspect = Suspect(Scaled(channel, factor), maps)
    # what cannot be calibrated is no better reading
    with suppress(InputError):
        other = calibrated_baseline(suspect.corrects(base.dataset), progress)
        if not holds(search, base, other):
            return None
        before, left = search.excess_base, excess(other.problem, other.fit)
        times = math.sqrt((1.0 + before.relative) / (1.0 + max(left.relative, 0.0)))
        note = suspect.correction.note(times, suspect.where)
        share = 1.0 - max(left.total, 0.0) / before.total
        return ScaledSensor(channel, 1.0 / factor, share, other.noting_its_map(note))
    return None

"""Where a cause takes a suite's metrics to their acceptance limits.

The suite is simulated along the cause, all else as on the healthy machine, at places that lie a
factor of the root of two apart, until a limit is missed; in between, metrics follow straight lines.
What the measured metrics are off the simulated ones, night by night at the cause's value of the
night, is added: the way to a limit is that of the measured metric. A season does not average out,
and where the model is off at the healthy machine it may be off by other than that at the limit:
both stand in the place's uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from eha_bench.causes.cause import Cause
from eha_bench.causes.keeping import Kept
from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.limit import AcceptanceLimit
from eha_bench.diagnosis.outcome.revise import revised
from eha_bench.plants.model import Model
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.evaluation import evaluated, score_key
from eha_bench.trends.wear import LimitCrossing

_FIRST: Final = 0.125
"""Of a cause's step: the first place that is simulated."""
_APART: Final = math.sqrt(2.0)
_MOST: Final = 40
_DISCREPANCY: Final = 1.0 / 3.0
"""Of what the model is off by on the healthy machine: standard deviation of what more it may be."""
_TO_SIGMA: Final = 1.4826


@dataclass(frozen=True)
class Metered:
    """A measured metric over the nights.

    Attributes:
        values: (nights,) SI, NaN where it was not scored. healthy: how many of them, from the
            first on, are of the healthy machine.
    """

    values: FloatArray
    healthy: int

    @property
    def level(self) -> float:
        """On the healthy machine: the median; NaN where it was never scored."""
        known = self.values[: self.healthy]
        known = known[np.isfinite(known)]
        return float(np.median(known)) if known.size else math.nan


@dataclass(frozen=True)
class _Limited:
    """A limit, its metric's column, and the metric as measured."""

    trial: str
    limit: AcceptanceLimit
    key: str
    metered: Metered

    def inside(self, value: float) -> float:
        """Return how far a metric is inside of the limit, SI; negative outside, also unscored."""
        if not math.isfinite(value):
            return -math.inf
        return min(value - self.limit.bounds.low, self.limit.bounds.high - value)


class CauseLimits:
    """A suite's limits along causes of a machine.

    Args:
        case: suite and simulator. model: declared. healthy: (layout.size,) vector of the machine.
        metered: `trial.metric` as `score_key` writes it -> measured; those that are not are taken
            as simulated.
        kept: where simulated metrics are kept from night to night.
    """

    def __init__(
        self,
        case: Case,
        model: Model,
        healthy: FloatArray,
        metered: Mapping[str, Metered],
        kept: Kept,
    ) -> None:
        self._case, self._model, self._healthy, self._kept = case, model, healthy, kept
        known = self._simulated(healthy, "")
        missed = []
        self._limits = []
        for trial in case.suite.trials:
            for limit in trial.limits:
                key = score_key(trial, limit.metric, limit.channel)
                simulated = known.get(key, math.nan)
                item = _Limited(
                    trial.id, limit, key, metered.get(key, Metered(np.array([simulated]), 1))
                )
                if math.isfinite(simulated) and item.inside(item.metered.level) >= 0.0:
                    self._limits.append(item)
                else:
                    missed.append(f"{key} {limit.text}")
        self.missed = tuple(missed)

    @property
    def some(self) -> bool:
        """Whether there is any limit that can be simulated."""
        return bool(self._limits)

    def first(self, cause: Cause, values: FloatArray, side: float) -> LimitCrossing | None:
        """Return where a cause meets its first limit; None where it meets none within its bounds.

        Args:
            cause: what moves. values: (nights,) of it, SI; NaN where a night is blind to it.
            side: positive for growing, negative for falling.
        """
        places, curves = [float(self._healthy[cause.place])], [self._at(cause, None)]
        for place in self._places(cause, math.copysign(1.0, side)):
            places.append(place)
            curves.append(self._at(cause, place))
            found = [
                crossing
                for item in self._limits
                if (crossing := _crossing(item, places, curves, values)) is not None
            ]
            if found:
                return min(found, key=lambda crossing: abs(crossing.value - places[0]))
        return None

    def _places(self, cause: Cause, side: float) -> Iterator[float]:
        """Yield values of a cause, ever further from the healthy machine, to its bound."""
        start = float(self._healthy[cause.place])
        end = cause.high if side > 0.0 else cause.low
        size = _FIRST * cause.step
        for _ in range(_MOST):
            value = start + side * size
            if side * (value - end) >= 0.0:
                if end != start:
                    yield end
                return
            yield value
            size *= _APART

    def _at(self, cause: Cause, value: float | None) -> Mapping[str, float]:
        if value is None:
            return self._simulated(self._healthy, "")
        declared = {item.id for item in self._model.effects}
        added = cause.id if cause.is_effect and cause.id not in declared else ""
        return self._simulated(cause.applied(self._healthy, value), added)

    def _simulated(self, vector: FloatArray, effect: str) -> Mapping[str, float]:
        made_of = f"{self._case.suite.sha256}\0{effect}\0{vector.tolist()}"
        known = self._kept.metrics(made_of)
        if known is not None:
            return known
        effects = (effect,) if effect else ()
        own = self._model.vector()
        changed = tuple(
            key
            for key, place in self._model.plant.layout.index.items()
            if vector[place] != own[place]
        )
        model = revised(self._model, vector, changed, effects)
        try:
            simulator = self._case.simulator.varied(model=model)
            values = dict(evaluated(Case(self._case.suite, simulator)).values)
        except EhaBenchError:
            values = {}
        self._kept.keep_metrics(made_of, values)
        return values


def _crossing(
    item: _Limited,
    places: list[float],
    curves: list[Mapping[str, float]],
    values: FloatArray,
) -> LimitCrossing | None:
    """Return where a metric meets its limit between the last two places; None where it does not."""
    along = [curve.get(item.key, math.nan) for curve in curves]
    offset, deviation = _offset(item, places, along, values)
    near, far = item.inside(along[-2] + offset), item.inside(along[-1] + offset)
    if far >= 0.0:
        return None
    gap = places[-1] - places[-2]
    if not math.isfinite(far):
        place, known = places[-2] + 0.5 * gap, 0.25 * abs(gap)
    else:
        # where it is beyond already by its offset, the line is followed back
        share = max(near / (near - far), -1.0) if near != far else 0.5
        place, known = places[-2] + share * gap, deviation * abs(gap / (far - near))
    trial, limit = item.trial, item.limit
    return LimitCrossing(place, known, trial, limit.metric, limit.text)


def _offset(
    item: _Limited, places: list[float], along: list[float], values: FloatArray
) -> tuple[float, float]:
    """Return how far the measured metric is off the simulated one, and its standard deviation."""
    healthy = item.metered.level - along[0]
    known = np.isfinite(along)
    order = np.argsort(np.array(places)[known])
    x, y = np.array(places)[known][order], np.array(along)[known][order]
    measured = item.metered.values
    if measured.size != values.size:
        return healthy, 0.0
    nights = measured - np.interp(values, x, y)
    nights = nights[np.isfinite(nights)]
    if not nights.size:
        return healthy, 0.0
    offset = float(np.median(nights))
    spread = _TO_SIGMA * float(np.median(np.abs(nights - offset)))
    return offset, math.hypot(spread, _DISCREPANCY * offset)

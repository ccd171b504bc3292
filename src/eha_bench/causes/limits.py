"""Where a cause takes a suite's metrics to their acceptance limits.

The suite is simulated along the cause, all else as on the healthy machine, at places that lie a
factor of the root of two apart, until a limit is missed at two of them; in between, metrics follow
straight lines. What the measured metrics are off the simulated ones (`correction`) is added: the
way to a limit is that of the measured metric. Simulated metrics need not be smooth along a cause (a
delay moves what is sampled by whole samples), so a rough one is as steep as a parabola along
several places says, and meets its limit where that does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.polynomial import Polynomial

from eha_bench.causes.cause import Cause
from eha_bench.causes.correction import Correction, Metered, correction_of
from eha_bench.causes.keeping import Kept
from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.limit import AcceptanceLimit
from eha_bench.diagnosis.outcome.revise import revised_model
from eha_bench.plants.model import Model
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.evaluation import figures_of_case, score_key
from eha_bench.trends.wear import LimitCrossing

_FIRST: Final = 0.125
"""Of a cause's step: the first place that is simulated."""
_APART: Final = math.sqrt(2.0)
_MOST: Final = 40
_PLACES: Final = 6
"""The last places, along which a metric is smoothed."""
_ROUGH: Final = 0.1
"""Of what a metric changes by between two places: roughness from which on it is smoothed."""
_LEAST: Final = 0.2
"""Of the slope between two places: the least that a rough metric is taken to have."""


@dataclass(frozen=True)
class _Limited:
    """A limit, its metric's column, and the metric as measured."""

    trial: str
    limit: AcceptanceLimit
    key: str
    metered: Metered

    def along(self, curves: Sequence[Mapping[str, float]]) -> FloatArray:
        """Return the simulated metric at every place, (places,) SI, NaN where it is not scored."""
        return np.array([metrics.get(self.key, math.nan) for metrics in curves])

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
        beyond: list[tuple[_Limited, LimitCrossing]] = []
        for place in self._places(cause, math.copysign(1.0, side)):
            places.append(place)
            curves.append(self._at(cause, place))
            # where it is beyond at one place alone, it is rough
            stayed = [
                crossing for item, crossing in beyond if _missed(item, places, curves, values)
            ]
            if stayed:
                return min(stayed, key=lambda crossing: abs(crossing.value - places[0]))
            beyond = [
                (item, crossing)
                for item in self._limits
                if (crossing := _crossing(item, places, curves, values)) is not None
            ]
        found = [crossing for _, crossing in beyond]
        return min(found, key=lambda crossing: abs(crossing.value - places[0]), default=None)

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
        model = revised_model(self._model, vector, changed, effects)
        try:
            simulator = self._case.simulator.varied(model=model)
            values = dict(figures_of_case(Case(self._case.suite, simulator)).values)
        except EhaBenchError:
            values = {}
        self._kept.keep_metrics(made_of, values)
        return values


def _correction(
    item: _Limited,
    places: list[float],
    curves: list[Mapping[str, float]],
    values: FloatArray,
) -> Correction:
    """Return what makes the measured metric of the simulated one."""
    along = item.along(curves)
    known = np.isfinite(along)
    order = np.argsort(np.array(places)[known])
    at, simulated = np.array(places)[known][order], along[known][order]
    nights = np.interp(values, at, simulated)
    return correction_of(item.metered, nights, float(along[0]))


def _missed(
    item: _Limited,
    places: list[float],
    curves: list[Mapping[str, float]],
    values: FloatArray,
) -> bool:
    """Return whether a metric misses its limit at the last place."""
    correction = _correction(item, places, curves, values)
    return item.inside(correction.measured(float(item.along(curves)[-1]))) < 0.0


def _crossing(
    item: _Limited,
    places: list[float],
    curves: list[Mapping[str, float]],
    values: FloatArray,
) -> LimitCrossing | None:
    """Return where a metric meets its limit between the last two places; None where it does not."""
    correction, along = _correction(item, places, curves, values), item.along(curves)
    near, far = (item.inside(correction.measured(float(metric))) for metric in along[-2:])
    if far >= 0.0:
        return None
    gap = places[-1] - places[-2]
    if not math.isfinite(far):
        place, deviation = places[-2] + 0.5 * gap, 0.25 * abs(gap)
    else:
        # where it is beyond already by its offset, the line is followed back
        share = max(near / (near - far), -1.0) if near != far else 0.5
        place, steep = places[-2] + share * gap, abs((far - near) / gap)
        curve, rough = _parabola(np.array(places), along)
        slope = abs(float(curve.deriv()(place)))
        if rough > _ROUGH * abs(far - near):
            # one step of a rough metric may be steep, or be beyond the limit, by chance
            steep = max(min(slope, steep), _LEAST * steep)
            inside = max(item.inside(correction.measured(float(curve(place)))), 0.0)
            place += math.copysign(min(inside / steep, 2.0 * abs(gap)), gap)
        deviation = math.hypot(correction.deviation(float(curve(place))), rough) / steep
    trial, limit = item.trial, item.limit
    return LimitCrossing(place, deviation, trial, limit.metric, limit.text)


def _parabola(places: FloatArray, metric: FloatArray) -> tuple[Polynomial, float]:
    """Return the parabola along the last places, and the standard deviation that it leaves."""
    known = np.flatnonzero(np.isfinite(metric))[-_PLACES:]
    x, y = places[known], metric[known]
    parabola = Polynomial.fit(x, y, min(2, known.size - 1))
    rest = y - parabola(x)
    return parabola, math.sqrt(float(rest @ rest) / max(known.size - 3, 1))

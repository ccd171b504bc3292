"""Where a cause takes a suite's metrics to their acceptance limits.

The suite is simulated along the cause, all else as on the healthy machine, at places that lie a
factor of the root of two apart, until it is clear where a limit is met (`crossing`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from eha_bench.causes.cause import Cause
from eha_bench.causes.correction import Metered
from eha_bench.causes.crossing import LimitedMetric, drawn_crossings
from eha_bench.causes.keeping import Kept
from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import EhaBenchError
from eha_bench.diagnosis.outcome.revise import revised_model
from eha_bench.plants.model import Model
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.evaluation import figures_of_case, score_key
from eha_bench.trends.wear import LimitCrossing

_FIRST: Final = 0.125
"""Of a cause's step: the first place that is simulated."""
_APART: Final = math.sqrt(2.0)
_MOST: Final = 40


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
                item = LimitedMetric(
                    trial.id, limit, key, metered.get(key, Metered(np.array([simulated]), 1))
                )
                if math.isfinite(simulated) and item.inside(np.array(item.metered.level)) >= 0.0:
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
        found = None
        for place in self._places(cause, math.copysign(1.0, side)):
            places.append(place)
            curves.append(self._at(cause, place))
            found = drawn_crossings(self._limits, places, curves, values)
            # where it is beyond at one place alone, it is rough
            if found.settled(places[-2]):
                break
        return found.crossing(self._limits) if found is not None else None

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
        return self._simulated(cause.apply(self._healthy, value), added)

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

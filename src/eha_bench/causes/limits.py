"""Where a cause takes a suite's metrics to their acceptance limits.

The suite is simulated along the cause, all else as on the healthy machine. What the measured
metrics were off the simulated ones on healthy nights is added: the way to a limit is that of the
measured metric. Steps along the cause double until a limit is missed; that limit's place is then
found between the last two (regula falsi, Illinois variant: Dowell, Jarratt, BIT 11 (1971) 168,
doi:10.1007/BF01934364).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from eha_bench.causes.cause import Cause
from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.limit import AcceptanceLimit
from eha_bench.diagnosis.outcome.revise import revised
from eha_bench.plants.model import Model
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.evaluation import evaluated, score_key
from eha_bench.trends.wear import LimitCrossing

_DOUBLINGS: Final = 12
_ROUNDS: Final = 7
_NEAR: Final = 0.01


@dataclass(frozen=True)
class Metered:
    """A metric on healthy nights: its median, SI, and the standard deviation of that."""

    value: float
    deviation: float


@dataclass(frozen=True)
class _Limited:
    """A limit, its metric's column, and what the measured metric is off the simulated."""

    trial: str
    limit: AcceptanceLimit
    key: str
    beside: float
    deviation: float

    def left(self, values: Mapping[str, float]) -> float:
        """Return how far a metric is inside of the limit, SI; negative outside, also unscored."""
        value = values.get(self.key, math.nan) + self.beside
        if not math.isfinite(value):
            return -math.inf
        bounds = self.limit.bounds
        return min(value - bounds.low, bounds.high - value)


class CauseLimits:
    """A suite's limits along causes of a machine.

    Args:
        case: suite and simulator. model: declared. healthy: (layout.size,) vector of the machine.
        calibrated: keys in which it differs from the declared one.
        metered: `trial.metric` as `score_key` writes it -> measured on healthy nights.
    """

    def __init__(
        self,
        case: Case,
        model: Model,
        healthy: FloatArray,
        calibrated: tuple[str, ...],
        metered: Mapping[str, Metered],
    ) -> None:
        self._case, self._model, self._healthy = case, model, healthy
        self._calibrated = calibrated
        known = self._simulated(healthy, "")
        missed = []
        self._limits = []
        for trial in case.suite.trials:
            for limit in trial.limits:
                key = score_key(trial, limit.metric, limit.channel)
                seen = metered.get(key, Metered(known.get(key, math.nan), 0.0))
                beside = seen.value - known.get(key, math.nan)
                item = _Limited(trial.id, limit, key, beside, seen.deviation)
                if math.isfinite(beside) and item.left(known) >= 0.0:
                    self._limits.append(item)
                else:
                    missed.append(f"{key} {limit.text}")
        self.missed = tuple(missed)

    @property
    def some(self) -> bool:
        """Whether there is any limit that can be simulated."""
        return bool(self._limits)

    def first(self, cause: Cause, towards: float) -> LimitCrossing | None:
        """Return where a cause meets its first limit; None where it meets none within its bounds.

        Args:
            cause: what moves. towards: its sign is the direction, its size a first step, SI.
        """
        start = float(self._healthy[cause.place])
        end = cause.high if towards > 0.0 else cause.low
        inside, at_inside = start, self._left(cause, start)
        step = towards
        for _ in range(_DOUBLINGS):
            value = min(max(start + step, cause.low), cause.high)
            left = self._left(cause, value)
            if min(left) < 0.0:
                return self._between(cause, (inside, at_inside), (value, left))
            if value == end:
                return None
            inside, at_inside = value, left
            step *= 2.0
        return None

    def _between(
        self,
        cause: Cause,
        inside: tuple[float, list[float]],
        outside: tuple[float, list[float]],
    ) -> LimitCrossing:
        (a, left_a), (b, left_b) = inside, outside
        for _ in range(_ROUNDS):
            places = [_zero(a, p, b, q) for p, q in zip(left_a, left_b, strict=True) if q < 0.0]
            guess = min(places, key=lambda place: abs(place - a))
            # a guess at an end halves nothing
            share = min(max((guess - a) / (b - a), 0.05), 0.95)
            value = a + share * (b - a)
            left = self._left(cause, value)
            if min(left) < 0.0:
                b, left_b = value, left
            else:
                a, left_a = value, left
            if abs(b - a) < _NEAR * abs(b - self._healthy[cause.place]):
                break
        found = [
            (_zero(a, p, b, q), item, (q - p) / (b - a))
            for p, q, item in zip(left_a, left_b, self._limits, strict=True)
            if q < 0.0
        ]
        place, item, slope = min(found, key=lambda entry: abs(entry[0] - a))
        known = item.deviation / abs(slope) if math.isfinite(slope) and slope else 0.0
        deviation = math.hypot(known, 0.25 * abs(b - a))
        return LimitCrossing(place, deviation, item.trial, item.limit.metric, item.limit.text)

    def _left(self, cause: Cause, value: float) -> list[float]:
        at = cause.applied(self._healthy, value)
        values = self._simulated(at, cause.id if cause.settings else "")
        return [item.left(values) for item in self._limits]

    def _simulated(self, vector: FloatArray, effect: str) -> Mapping[str, float]:
        effects = (effect,) if effect else ()
        changed = tuple(
            key
            for key, place in self._model.plant.layout.index.items()
            if vector[place] != self._healthy[place] or key in self._calibrated
        )
        model = revised(self._model, vector, changed, effects)
        try:
            simulator = self._case.simulator.varied(model=model)
            return evaluated(Case(self._case.suite, simulator)).values
        except EhaBenchError:
            return {}


def _zero(a: float, left_a: float, b: float, left_b: float) -> float:
    """Return where a straight line through two points is 0; the middle where one is unscored."""
    if not math.isfinite(left_b) or left_a == left_b:
        return 0.5 * (a + b)
    return a + (b - a) * left_a / (left_a - left_b)

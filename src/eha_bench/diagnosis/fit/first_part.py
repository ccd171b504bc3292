"""A run's own parameters (`per_run`), estimated from its first part only.

A held-out run may not be fitted, or its error would say nothing. But a run cannot be predicted
whose load is unknown. So a run's own parameters are estimated over its first part, everything
else held at what was found before, and the rest of the run shows whether it is right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eha_bench.core.note import Note
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.windows import Window, cut_windows
from eha_bench.diagnosis.fit.evidence import groups_of
from eha_bench.diagnosis.fit.least_squares import free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.own_parameters import with_own
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.starts import best_fit_of_starts
from eha_bench.diagnosis.fit.steady_windows import steady_problem
from eha_bench.diagnosis.fit.uncertainty import Estimate, estimates
from eha_bench.plants.model import Model

SHARE = 1.0 / 3.0
"""Part of a run from which its own parameters are estimated."""
_STEP = 2e-4
_FEWEST = 4
"""Ticks of the shortest window."""
_MOST = 0.6
"""Share of the part that may be left out as unsure: a run's own parameters are few."""


@dataclass(frozen=True)
class FirstPart:
    """What the first part of a run says of the run's own parameters.

    Attributes:
        run: its name. until: end of that part, s from the run's start.
        estimates: parameter -> value with its 95 % interval, SI; one that the part does not
            determine has an interval without end, and the value that was declared.
    """

    run: str
    until: float
    estimates: Mapping[str, Estimate] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, float]:
        """Parameter -> value, SI."""
        return {key: item.value for key, item in self.estimates.items()}

    def notes(self) -> list[Note]:
        """Return a note on every estimate: its value, or that the part does not determine it."""
        return [self._note(key, item) for key, item in self.estimates.items()]

    def _note(self, key: str, item: Estimate) -> Note:
        unit = f" {item.unit}" if item.unit else ""
        if np.isfinite(item.low) and np.isfinite(item.high):
            return Note(
                "{run}: {key} = {value:.4g}{unit} ({low:.4g} to {high:.4g}) was estimated from its "
                "first {until:.3g} s only",
                run=self.run,
                key=key,
                value=item.value,
                unit=unit,
                low=item.low,
                high=item.high,
                until=self.until,
            )
        return Note(
            "{run}: its first {until:.3g} s do not determine {key}, which keeps its declared "
            "value, {value:.4g}{unit}",
            run=self.run,
            key=key,
            value=item.value,
            unit=unit,
            until=self.until,
        )


def first_part(measured: Measured, model: Model, noise: Mapping[str, float]) -> FirstPart:
    """Return what the first part of a run says of the model's `per_run` parameters.

    Args:
        measured: the run. model: everything else. noise: channel -> standard deviation, SI.
    """
    plant = model.plant
    until = SHARE * float(measured.time[-1])
    run = with_own(plant.layout, [measured.run], model.per_run)[0]
    if not run.own:
        return FirstPart(run.name, until)
    windows = _until(cut_windows(replace(measured, run=run), noise), until)
    known = {name: level for name, level in noise.items() if name in measured.outputs}
    problem = Problem(plant, windows, known, _STEP)
    vector = problem.places.lengthened(model.vector()) if windows else model.vector()
    units = {key: plant.layout.by_key[key].unit for key in run.own}
    if not problem.size:
        return FirstPart(run.name, until, {
            key: Estimate(float(vector[plant.layout.index[key]]), -np.inf, np.inf, units[key])
            for key in run.own
        })  # fmt: skip
    problem.prepare(vector)
    problem.scale_to(problem.residual(vector))
    keys = [item.key for item in problem.places.own]
    free = free_parameters(problem.places, keys, vector)
    # a load that is far from the declared one starts the run elsewhere: one start is not enough
    fit = best_fit_of_starts(problem, vector, free, lambda _: None).fit
    # windows that began with another load had other starts
    problem = steady_problem(problem, fit.vector, _MOST)
    problem.scale_to(problem.residual(fit.vector))
    fit = levenberg_marquardt(problem, fit.vector, free, iterations=4)
    intervals = estimates(fit, groups_of(problem), {})
    found = {}
    for item in problem.places.own:
        value = intervals[item.key]
        if not (np.isfinite(value.low) and np.isfinite(value.high)):
            value = replace(value, value=float(vector[item.place]))
        found[item.parameter] = replace(value, unit=units[item.parameter])
    return FirstPart(run.name, until, found)


def _until(windows: Sequence[Window], until: float) -> list[Window]:
    """Return windows, or their parts, that end before a time in s."""
    found = []
    for window in windows:
        last = int(np.searchsorted(window.measured.time, until))
        if last - window.first >= _FEWEST:
            found.append(replace(window, last=min(window.last, last)))
    return found

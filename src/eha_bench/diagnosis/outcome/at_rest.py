"""Friction at rest in a calibration: noted where it was estimated, declared where it cannot be.

How friction behaves at rest is fitted although no model lists it under `calibrate`: a diagnosis
would name an effect for it otherwise. A calibration promises only what is listed, so it says what
it also estimated, and keeps what was declared where the data leave it open.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from eha_bench.diagnosis.fit.baseline import Baseline
from eha_bench.diagnosis.fit.convergence import Convergence, convergence
from eha_bench.diagnosis.fit.evidence import Groups
from eha_bench.diagnosis.fit.finish import ConvergedFit, converged_fit
from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.fit.uncertainty import Estimate, estimates, spreads

_LOOSE = 0.3
"""Share of a value that one standard deviation may be: beyond it the value is not determined."""


@dataclass(frozen=True)
class Calibrated:
    """A calibration with what it says of friction at rest.

    Attributes:
        end: the finished fit. keys: parameters that it changed. notes: one sentence each.
        convergence: how the fit ended.
    """

    end: ConvergedFit
    keys: tuple[str, ...]
    notes: tuple[str, ...]
    convergence: Convergence


def with_friction_at_rest(base: Baseline, groups: Groups, units: dict[str, str]) -> Calibrated:
    """Return the finished calibration, its friction at rest as far as the data determine it.

    Args:
        base: calibrated. groups: rows by block and by run. units: of the parameters, by key.
    """
    layout = base.problem.plant.layout
    declared = base.dataset.model.vector()
    end = converged_fit(base.problem, base.fit)
    found = estimates(end.fit, groups, units, shift=end.shifts)
    deviations = {key: item.deviation for key, item in spreads(end.fit, groups).items()}
    kept: dict[str, Estimate] = {}
    notes = []
    for key in base.nuisance:
        at = layout.index[key]
        if key in found and _is_open(found[key], deviations[key], float(declared[at])):
            kept[key] = found[key]
        elif end.fit.vector[at] != declared[at]:
            notes.append(_estimate_note(key, float(end.fit.vector[at]), found.get(key), units[key]))
    if kept:
        end = converged_fit(base.problem, _refit_as_declared(base, end.fit, tuple(kept)))
    for key, item in kept.items():
        value = f"{float(declared[layout.index[key]]):.3g} {units[key]}"
        told = math.isfinite(item.low) and math.isfinite(item.high)
        between = f" ({item.low:.3g} to {item.high:.3g} {units[key]})" if told else ""
        notes.append(
            f"friction at rest: these data do not determine {key}{between}, so it keeps its "
            f"declared value, {value}"
        )
    changed = tuple(
        key
        for key in base.keys
        if key not in base.nuisance
        or (key not in kept and end.fit.vector[layout.index[key]] != declared[layout.index[key]])
    )
    ended = convergence(end.fit, base.starts, base.agreed)
    return Calibrated(end, changed, tuple(notes), ended)


def _is_open(item: Estimate, deviation: float, declared: float) -> bool:
    return item.low <= declared <= item.high or deviation > _LOOSE * abs(item.value)


def _estimate_note(key: str, value: float, item: Estimate | None, unit: str) -> str:
    interval = f" ({item.low:.3g} to {item.high:.3g})" if item is not None else ""
    return (
        f"friction at rest was estimated, though not listed under `calibrate`: {key} = "
        f"{value:.3g}{interval} {unit}"
    )


def _refit_as_declared(base: Baseline, fit: Fit, kept: tuple[str, ...]) -> Fit:
    """Return the fit of what is left where some of it is as declared."""
    declared = base.dataset.model.vector()
    vector = fit.vector.copy()
    for item in fit.free:
        if item.key in kept:
            vector[item.at] = declared[item.at]
    free = tuple(item for item in fit.free if item.key not in kept)
    base.problem.prepare(vector)
    known = {key: column for key, column in fit.columns.items() if key not in kept}
    return levenberg_marquardt(base.problem, vector, free, known=known, refresh=1)

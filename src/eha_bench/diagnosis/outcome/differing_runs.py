"""Whether something is missing because a load or a mass differs from run to run.

A mass that is bolted on, or a load that pulls harder in one recording than in another, is no effect
of the machine: the runs are declared alike, and are not. Fitted with one value for all, the
parameters bend until they imitate it. So where something is missing that no effect explains, the
loads and masses that the plant declares are given a value of their own in each run.

A first look takes slopes only: where the residual r has the columns J of what is fitted, and c_k of
the value in run k, the fall of |r|^2 by all c_k beside J, less that by their sum. Only where that
is much are the parameters fitted again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.per_cent import per_cent
from eha_bench.diagnosis.fit.baseline import Baseline, calibrated_baseline
from eha_bench.diagnosis.fit.evidence import Excess, excess
from eha_bench.diagnosis.fit.least_squares import free_parameters, jacobian

_PROMISED: Final = 0.05
"""Share of the residual that slopes promise, from which the parameters are fitted again: little, as
windows begin where the readings are, and parameters that have bent take most of it."""
_NEARLY_ALL: Final = 0.9
"""Share that leaves nothing for another parameter to explain."""
_ENOUGH: Final = 0.5
"""Share of what is missing that goes, from which the runs differ."""


@dataclass(frozen=True)
class DifferingParameter:
    """A parameter that differs from run to run.

    Attributes:
        key: of the plant. unit: SI. values: run -> value, SI. share: of what was missing.
    """

    key: str
    unit: str
    values: dict[str, float]
    share: float

    @property
    def note(self) -> str:
        """What it is and how it is declared, as a sentence."""
        values = ", ".join(f"{value:.4g} in {run}" for run, value in self.values.items())
        return (
            f"{self.key} seems to differ from run to run ({self.unit}: {values}): with a value of "
            f"its own in each run {per_cent(self.share)} of what is missing goes. If it does, "
            "declare it under `per_run`, or its values under the runs' `parameters`"
        )


def differing_parameter(base: Baseline, missing: Excess) -> DifferingParameter | None:
    """Return the load or mass whose differences between runs explain what is missing, if any.

    Args:
        base: calibrated, with one value for all runs. missing: what is left beside it.
    """
    model, layout = base.dataset.model, base.dataset.model.plant.layout
    keys = [key for key in model.plant.changed_between_runs if key not in model.per_run]
    promised = _promised_shares(base, keys) if keys else {}
    found: list[DifferingParameter] = []
    for key in sorted(promised, key=lambda key: -promised[key]):
        if promised[key] < _PROMISED or any(item.share >= _NEARLY_ALL for item in found):
            break
        shared = tuple(other for other in model.calibrate if other != key)
        own = replace(model, calibrate=shared, per_run=(*model.per_run, key))
        other = calibrated_baseline(replace(base.dataset, model=own))
        left = excess(other.problem, other.fit)
        share = 1.0 - max(left.relative, 0.0) / missing.relative
        if share < _ENOUGH:
            continue
        values = {
            item.run: float(other.fit.vector[item.place])
            for item in other.problem.places.own
            if item.parameter == key
        }
        found.append(DifferingParameter(key, layout.by_key[key].unit, values, share))
    return max(found, key=lambda item: item.share, default=None)


def _promised_shares(base: Baseline, keys: Sequence[str]) -> dict[str, float]:
    """Return the share of the residual that slopes promise, for each value that may differ by run.

    Of a key that fewer than two runs leave open nothing is promised: it is left out.
    """
    fit, problem = base.fit, base.problem
    # a search has moved the start states since, and with them residual and slopes
    residual = problem.residual(fit.vector)
    shared = jacobian(problem, fit.vector, fit.free, residual)
    whole = max(float(residual @ residual), 1e-300)
    promised = {}
    for key in keys:
        runs = [item.run.name for item in base.measured if key not in item.run.parameters]
        if len(runs) < 2:
            continue
        [free] = free_parameters(base.dataset.model.plant.layout, [key], fit.vector)
        own = [replace(free, key=f"{key} in {run}", run=run) for run in runs]
        columns = jacobian(problem, fit.vector, own, residual)
        alike = columns.sum(axis=1, keepdims=True)
        gain = _squares_left(residual, shared, alike) - _squares_left(residual, shared, columns)
        promised[key] = gain / whole
    return promised


def _squares_left(residual: FloatArray, *columns: FloatArray) -> float:
    """Return the sum of squares that least squares over columns leave of a residual."""
    design = np.column_stack(columns)
    design = design / np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    left = residual - design @ np.linalg.lstsq(design, residual, rcond=1e-10)[0]
    return float(left @ left)

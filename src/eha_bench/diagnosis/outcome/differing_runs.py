"""Whether something is missing because runs differ that are declared alike.

A mass that is bolted on, or a load that pulls harder in one recording than in another, is no effect
of the machine; nor is oil that was warmer in the next recording, by which friction falls and
leakage grows. Fitted with one value for all runs, the parameters bend until they imitate it. So
where something is missing that no effect explains, the loads and masses that the plant declares are
given a value of their own in each run, one after the other, and then all friction and leakage that
is calibrated at once.

A first look takes slopes only: where the residual r has the columns J of what is fitted, and c_k of
the value in run k, the fall of |r|^2 by all c_k beside J, less that by their sum. Only where that
is much are the parameters fitted again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.per_cent import per_cent
from eha_bench.diagnosis.fit.baseline import Baseline, calibrated_baseline
from eha_bench.diagnosis.fit.evidence import Excess, excess
from eha_bench.diagnosis.fit.least_squares import free_parameters, jacobian
from eha_bench.plants.model import Model

_PROMISED: Final = 0.05
"""Share of the residual that slopes promise, from which the parameters are fitted again: little, as
windows begin where the readings are, and parameters that have bent take most of it."""
_BESIDE: Final = 0.5
"""Least that slopes promise, in what one curve for all runs explains where that is nearly all."""
_NEARLY_ALL: Final = 0.8
"""Share that leaves nothing for another parameter to explain."""
_ENOUGH: Final = 0.5
"""Share of what is missing that goes, from which the runs differ."""
_ALIKE: Final = 0.05
"""Spread of a parameter over the runs, as a share of its size, up to which it does not differ."""
_ABSURD: Final = 10.0
"""Multiple of the size of a mass or inertia beyond which one is of no such machine: it imitates."""
_MASSES: Final = ("kg", "kg*m^2")


@dataclass(frozen=True)
class DifferingParameters:
    """Parameters that differ from run to run.

    Attributes:
        values: key of the plant -> run -> value, SI. units: key -> SI unit.
        share: of what was missing that goes.
    """

    values: dict[str, dict[str, float]]
    units: dict[str, str]
    share: float

    @property
    def is_all_of_it(self) -> bool:
        """Whether one parameter's own values leave nothing for another cause to explain."""
        return len(self.values) == 1 and self.share >= _NEARLY_ALL

    @property
    def note(self) -> str:
        """What they are and how they are declared, as a sentence."""
        differing = {key: runs for key, runs in self.values.items() if _spread(runs) > _ALIKE}
        differing = differing or self.values
        said = "; ".join(
            f"{key}, {self.units[key]}: "
            + ", ".join(f"{value:.4g} in {run}" for run, value in runs.items())
            for key, runs in differing.items()
        )
        alone = len(differing) == 1
        what = next(iter(differing)) if alone else "friction and leakage"
        verb, own, them = (
            ("seems", "a value of its own", "it")
            if alone
            else ("seem", "values of their own", "them")
        )
        warm = "" if alone else ", as with oil that warms up"
        return (
            f"{what} {verb} to differ from run to run{warm} ({said}): with {own} in each run "
            f"{per_cent(self.share)} of what is missing goes. If so, declare {them} under "
            "`per_run`, or the values under the runs' `parameters`"
        )


def _spread(runs: Mapping[str, float]) -> float:
    """Return how far values of the runs lie apart, as a share of the largest."""
    largest = max(map(abs, runs.values()))
    return (max(runs.values()) - min(runs.values())) / largest if largest > 0.0 else 0.0


def differing_parameters(
    base: Baseline, missing: Excess, explained: float = 0.0
) -> DifferingParameters | None:
    """Return the parameters whose differences between runs explain what is missing, if any.

    Args:
        base: calibrated, with one value for all runs. missing: what is left beside it.
        explained: share of it that goes with one curve for all runs, where that is nearly all: it
            does not differ between them then, unless their differences explain more.
    """
    model = base.dataset.model
    if len({item.run.log for item in base.measured}) < 2:
        # what is bolted on, and the oil, stay the same within one log
        return None
    single = [(key,) for key in model.plant.changed_between_runs if key not in model.per_run]
    together = tuple(
        key
        for key in model.plant.changed_by_warmth
        if key in model.calibrate and key not in model.per_run
    )
    groups = [*single, together] if together else single
    promised = _promised_shares(base, groups) if groups else {}
    least = max(_PROMISED, _BESIDE * explained)
    hopeful = [keys for keys in promised if promised[keys] >= least]
    hopeful.sort(key=lambda keys: -promised[keys])
    alone = _found(base, missing, [keys for keys in hopeful if keys != together])
    found = max(alone, key=lambda item: item.share, default=None)
    found = found or next(
        _found(base, missing, [keys for keys in hopeful if keys == together]), None
    )
    return found if found is None or found.share >= explained else None


def _found(
    base: Baseline, missing: Excess, groups: Sequence[tuple[str, ...]]
) -> Iterator[DifferingParameters]:
    """Yield the groups of parameters that explain enough, each with values of its own by run."""
    for keys in groups:
        own = _with_own_values(base.dataset.model, keys)
        other = calibrated_baseline(replace(base.dataset, model=own))
        left = excess(other.problem, other.fit)
        share = 1.0 - max(left.relative, 0.0) / missing.relative
        if share < _ENOUGH:
            continue
        vector, places = other.fit.vector, other.problem.places.own
        values = {
            key: {item.run: float(vector[item.place]) for item in places if item.parameter == key}
            for key in keys
        }
        layout = own.plant.layout
        declared = {
            key: max(
                abs(base.dataset.model.value(key)), abs(float(base.fit.vector[layout.index[key]]))
            )
            for key in keys
            if layout.by_key[key].unit in _MASSES
        }
        if any(
            abs(value) > _ABSURD * declared.get(key, 0.0) > 0.0
            for key, runs in values.items()
            for value in runs.values()
        ):
            continue
        yield DifferingParameters(values, {key: layout.by_key[key].unit for key in keys}, share)
        if share >= _NEARLY_ALL:
            return


def _with_own_values(model: Model, keys: Sequence[str]) -> Model:
    """Return a model in which some parameters have a value of their own in each run."""
    shared = tuple(key for key in model.calibrate if key not in keys)
    return replace(model, calibrate=shared, per_run=(*model.per_run, *keys))


def _promised_shares(
    base: Baseline, groups: Sequence[tuple[str, ...]]
) -> dict[tuple[str, ...], float]:
    """Return the share of the residual that slopes promise, for what may differ by run.

    Of a group that fewer than two runs leave open nothing is promised: it is left out.
    """
    fit, problem = base.fit, base.problem
    # a search has moved the start states since, and with them residual and slopes
    residual = problem.residual(fit.vector)
    shared = jacobian(problem, fit.vector, fit.free, residual)
    whole = max(float(residual @ residual), 1e-300)
    promised = {}
    for keys in groups:
        runs = [item.run.name for item in base.measured if not set(keys) & set(item.run.parameters)]
        if len(runs) < 2:
            continue
        frees = free_parameters(base.dataset.model.plant.layout, keys, fit.vector)
        columns, alike = [], []
        for free in frees:
            own = [replace(free, key=f"{free.key} in {run}", run=run) for run in runs]
            columns.append(jacobian(problem, fit.vector, own, residual))
            alike.append(columns[-1].sum(axis=1, keepdims=True))
        before = _squares_left(residual, shared, *alike)
        promised[keys] = (before - _squares_left(residual, shared, *columns)) / whole
    return promised


def _squares_left(residual: FloatArray, *columns: FloatArray) -> float:
    """Return the sum of squares that least squares over columns leave of a residual."""
    design = np.column_stack(columns)
    design = design / np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    left = residual - design @ np.linalg.lstsq(design, residual, rcond=1e-10)[0]
    return float(left @ left)

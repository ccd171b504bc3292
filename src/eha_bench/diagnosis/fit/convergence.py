"""Whether a calibration has arrived, what it left, and where it went.

At a minimum the cost falls no further: what one more Gauss-Newton step is predicted to gain is the
square of how many standard deviations away the minimum is (the Newton decrement: Boyd,
Vandenberghe, Convex Optimization, 2004, section 9.5.1), where a standard deviation is that of the
residual as it is. Parameters that stand at a bound, and would go beyond, do not count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.core.note import Note, Value
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import soften
from eha_bench.diagnosis.fit.uncertainty import LOOSE
from eha_bench.plants.model import Model

NEAR = 2.0
"""Standard deviations from the minimum within which a fit has converged."""
MOST = 2.0
"""Residual over its floor from which no interval is given: it would be one of another model."""
FAR = 3.0
"""Factor from which a parameter that has moved is reported."""
_AT = 1e-3
"""Distance from a bound, in scales, that is none."""
_BELIEVED = 0.5
"""Part of a direction's information from which it is what is believed that tells it."""


@dataclass(frozen=True)
class Convergence:
    """How a calibration ended.

    Attributes:
        distance: of the minimum, in standard deviations of the parameters.
        ratio: root mean square of the residual over windows, over its floor.
        starts: how many there were. agreed: how many of them ended at the same cost.
        at_bounds: parameter -> the bound that it stands at, SI.
    """

    distance: float
    ratio: float
    starts: int
    agreed: int
    at_bounds: Mapping[str, float]

    @property
    def converged(self) -> bool:
        """Whether the fit is at the bottom of its cost."""
        return self.distance < NEAR

    @property
    def has_intervals(self) -> bool:
        """Whether the fit says how well it knows what it found."""
        return self.converged and self.ratio <= MOST

    def notes(self, added: Sequence[str] = ()) -> list[str]:
        """Say what a reader has to know, one sentence each.

        Args:
            added: to the calibrated model, of which the fit is then.
        """
        causes = f"with {' and '.join(added)}"
        fitted = f"the fit {causes}" if added else "the calibration"
        after = causes if added else "after calibration"
        found = []
        if not self.converged:
            found.append(
                f"{fitted} has not converged: from {self.starts} start(s) the best end is "
                f"{self.distance:.2g} standard deviations from a minimum; no interval is given"
            )
        if self.ratio > MOST:
            found.append(
                f"{after} the residual is {self.ratio:.3g} times its floor: something "
                f"{'else ' if added else ''}is missing, or the fit ended in a local minimum; no "
                "interval is given"
            )
        return found

    def to_dict(self) -> dict[str, object]:
        """Return it as it stands in JSON."""
        return {
            "converged": self.converged,
            "distance": self.distance if np.isfinite(self.distance) else None,
            "residual_over_floor": self.ratio if np.isfinite(self.ratio) else None,
            "starts": self.starts,
            "agreed": self.agreed,
            "at_bounds": dict(self.at_bounds),
        }


def convergence(fit: Fit, starts: int = 1, agreed: int = 1) -> Convergence:
    """Return how a fit ended.

    Args:
        fit: with the Jacobian at its own place. starts, agreed: as `MultistartFit` has them.
    """
    decrement = left_to_gain(fit)
    readings = fit.residual[: fit.residual.size - fit.beliefs]
    ratio = float(np.sqrt(np.mean(readings**2))) if readings.size else float("nan")
    level, bounds = _level(fit), _bounds(fit)
    return Convergence(float(np.sqrt(decrement / level)), ratio, starts, agreed, bounds)


def left_to_gain(fit: Fit) -> float:
    """Return by how much one more Gauss-Newton step is predicted to lower a fit's cost.

    Args:
        fit: with the Jacobian at its own place.
    """
    found = determined_directions(fit)
    return max(float(np.sum(found.slopes**2 / found.information)), 0.0)


@dataclass(frozen=True)
class DeterminedDirections:
    """What a cost says near a fit: its slope and curvature along what the data determine.

    Attributes:
        inside: (q,) which of the free parameters no bound holds.
        directions: (q, k) changes of these in SI by one unit along each eigenvector.
        slopes: (k,) of the cost's half along each. information: (k,) its curvature there.
    """

    inside: IndexArray
    directions: FloatArray
    slopes: FloatArray
    information: FloatArray


def determined_directions(fit: Fit) -> DeterminedDirections:
    """Return the eigenvectors of a fit's information that the data, or beliefs, determine.

    What neither determines has no minimum to arrive at: a direction along which a standard
    deviation is more than `LOOSE`, unless it is what is believed that tells most of it. Parameters
    that stand at a bound, and would go beyond, are left out.

    Args:
        fit: with the Jacobian at its own place.
    """
    soft, weight = soften(fit.residual, fit.soft)
    matrix = fit.jacobian * weight[:, None]
    gradient, bounds = matrix.T @ soft, _bounds(fit)
    inside = np.array([
        k for k, item in enumerate(fit.free)
        if item.key not in bounds or (gradient[k] > 0.0) is (bounds[item.key] != item.low)
    ], dtype=np.intp)  # fmt: skip
    sizes = np.array([abs(fit.vector[i.at]) or i.scale for i in fit.free])[inside]
    units = sizes / np.array([item.scale for item in fit.free])[inside]
    own = matrix[:, inside] * units
    values, vectors = np.linalg.eigh(own.T @ own)
    believed = np.sum((own[own.shape[0] - fit.beliefs :] @ vectors) ** 2, axis=0)
    kept = (values > _level(fit) / LOOSE**2) | (believed > _BELIEVED * values)
    along = vectors[:, kept]
    return DeterminedDirections(
        inside, along * sizes[:, None], along.T @ (gradient[inside] * units), values[kept]
    )


def _level(fit: Fit) -> float:
    """Return the cost over that of the noise alone, at least 1."""
    return max(1.0, fit.cost / (SOFT_MEAN * max(1, fit.residual.size)))


def _bounds(fit: Fit) -> dict[str, float]:
    found = {}
    for item in fit.free:
        value, near = fit.vector[item.at], _AT * item.scale
        if value - item.low <= near:
            found[item.key] = item.low
        elif item.high - value <= near:
            found[item.key] = item.high
    return found


AT_BOUND: Final = (
    "CAUTION: {key} is at its bound, {bound:.4g}{unit}: it hides a missing effect, or these data "
    "do not determine it"
)
MOVED_FAR: Final = (
    "CAUTION: {key} has moved by a factor of {factor:.3g}, from {before:.4g} to {value:.4g}"
    "{unit}: check that the model is of this machine; a parameter that moves so far may hide a "
    "missing effect"
)
MOVED_OUT: Final = (
    "CAUTION: {key} has moved from {before:.4g} to {value:.4g}{unit}, more than the "
    "{within:.3g}{unit} given under `within`"
)


def has_gone_far(before: float, now: float) -> bool:
    """Return whether a value is a factor of more than FAR from what it was; not where it was 0."""
    return before != 0.0 and not 1.0 / FAR <= now / before <= FAR


def moved_notes(
    model: Model,
    values: Mapping[str, float],
    at_bounds: Mapping[str, float],
    intervals: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> list[Note]:
    """Return a note of each parameter that went far from what was declared.

    Args:
        model: declared. values: parameter -> estimate, SI. at_bounds: as `Convergence` has them.
        intervals: parameter -> its interval, SI: one that reaches what is given under `within` has
            not been told from it.
    """
    notes = []
    layout = model.plant.layout
    declared, index = model.vector(), layout.index
    units = layout.units_at(declared)
    for key in dict.fromkeys(model.calibrate):
        if key not in values:
            continue
        before, unit = float(declared[index[key]]), units[key]
        known: dict[str, Value] = {
            "key": key, "before": before, "value": values[key], "unit": f" {unit}" if unit else "",
        }  # fmt: skip
        if key in at_bounds:
            notes.append(Note(AT_BOUND, bound=at_bounds[key], **known))
        elif has_gone_far(before, values[key]):
            notes.append(Note(MOVED_FAR, factor=values[key] / before, **known))
        elif key in model.within and _is_beyond(
            values[key], intervals.get(key), before, model.within[key]
        ):
            notes.append(Note(MOVED_OUT, within=model.within[key], **known))
    return notes


def _is_beyond(
    value: float, interval: tuple[float, float] | None, before: float, within: float
) -> bool:
    """Whether a value, and its interval where it has one, is further off than it may be."""
    low, high = interval if interval and np.isfinite(interval).all() else (value, value)
    return low > before + within or high < before - within

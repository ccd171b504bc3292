"""Intervals that respect correlated residuals, and directions that the data do not determine.

The variance is the larger of the usual one, scaled by the mean square of the residual, and of the
sandwich H^-1 (sum over blocks g g') H^-1 with blocks of 0.1 s, which stays right where residuals
are correlated (White, Econometrica 48 (1980) 817, doi:10.2307/1912934; Liang, Zeger, Biometrika 73
(1986) 13, doi:10.1093/biomet/73.1.13). Where an equation's form is not quite right, runs made under
other conditions ask for other values: where leaving runs out changes more than chance would, the
variance grows by the ratio of the two (Birge, Phys. Rev. 40 (1932) 207,
doi:10.1103/PhysRev.40.207).

Where a stick event jumps, the cost is no parabola, and no Jacobian tells how well it determines a
parameter. The sizes of effects are therefore checked against their profile (`profile`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from eha_bench.diagnosis.evidence import Groups
from eha_bench.diagnosis.fit import Fit
from eha_bench.diagnosis.problem import soften

FloatArray = NDArray[np.float64]

_Z = 1.96
_LOOSE = 0.3
_RIDGE = 0.02
_CONCERNED = 0.01
_CHANCE = 0.05


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval, SI."""

    value: float
    low: float
    high: float
    unit: str


def deviations(fit: Fit, groups: Groups) -> dict[str, float]:
    """Return the standard deviation of every fitted number, SI, by key (inf: not determined)."""
    if not fit.free:
        return {}
    soft, weight = soften(fit.residual, fit.soft)
    weighted = fit.jacobian * weight[:, None]
    normal = weighted.T @ weighted
    dead = np.diag(normal) < 1e-6
    scale = np.sqrt(np.where(dead, 1.0, np.diag(normal)))
    unit = normal / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(unit)
    inverse = vectors @ np.diag(1.0 / np.maximum(values, 1e-12)) @ vectors.T
    scores = np.array([(weighted[rows].T @ soft[rows]) / scale for rows in groups.blocks])
    middle = scores.T @ scores
    sandwich = np.diag(inverse @ middle @ inverse)
    usual = np.diag(inverse) * max(1.0, float(soft @ soft) / max(1, soft.size - len(fit.free)))
    wider = _disagreement(weighted / scale, soft, groups)
    variance = np.maximum(sandwich, usual * wider) / scale**2
    return {
        item.key: float("inf") if dead[k] else float(np.sqrt(variance[k]) * item.scale)
        for k, item in enumerate(fit.free)
    }


def _disagreement(matrix: FloatArray, soft: FloatArray, groups: Groups) -> FloatArray:
    """Return by how much runs disagree about each parameter, (p,): 1 where chance makes as much.

    Every run is left out in turn, to first order, and the square of what that changes is held
    against what noise would change.
    """
    normal = matrix.T @ matrix
    gradient = matrix.T @ soft
    # what a left-out run alone determines stays near where it was
    ridge = _RIDGE * np.diag(np.diag(normal))
    to_the_end = -np.linalg.pinv(normal + ridge, rcond=1e-10) @ gradient
    total = np.zeros(matrix.shape[1])
    counts = np.zeros(matrix.shape[1])
    for rows in groups.runs:
        part = matrix[rows]
        own = part.T @ part
        inverse = np.linalg.pinv(normal - own + ridge, rcond=1e-10)
        step = inverse @ (part.T @ soft[rows] - gradient) - to_the_end
        expected = np.diag(inverse @ own @ inverse)
        # a run that says nothing about a parameter has no say
        concerned = np.diag(own) > _CONCERNED * np.diag(normal)
        total += np.where(concerned, step**2 / np.maximum(expected, 1e-300), 0.0)
        counts += concerned
    ratio = total / np.maximum(counts, 1.0)
    degrees = np.maximum(counts - 1.0, 1.0)
    telling = (counts > 1) & (ratio > chdtri(degrees, _CHANCE) / degrees)
    return np.where(telling, ratio, 1.0)


def estimates(
    fit: Fit,
    groups: Groups,
    units: dict[str, str],
    profiled: Mapping[str, float] | None = None,
) -> dict[str, Estimate]:
    """Return every fitted number with its 95 % interval inside its bounds, by key.

    Args:
        fit: with a Jacobian of its own place. groups: rows by block and by run.
        units: by key. profiled: standard deviations by the profile, SI, where there is one.
    """
    spread = deviations(fit, groups)
    for key, value in (profiled or {}).items():
        spread[key] = max(spread[key], value)
    found = {}
    for item in fit.free:
        value = float(fit.vector[item.at])
        low = max(item.low, value - _Z * spread[item.key])
        high = min(item.high, value + _Z * spread[item.key])
        found[item.key] = Estimate(value, low, high, units.get(item.key, ""))
    return found


def undetermined(fit: Fit) -> tuple[str, ...]:
    """Return, in words, the directions in which the parameters could move unnoticed.

    A direction counts where one standard deviation along it changes parameters by 30 %.
    """
    free = [item for item in fit.free if "." not in item.key and "[" not in item.key]
    columns = [k for k, item in enumerate(fit.free) if item in free]
    if not columns:
        return ()
    _, weight = soften(fit.residual, fit.soft)
    size = np.array([abs(fit.vector[item.at]) or item.scale for item in free])
    scale = np.array([item.scale for item in free])
    matrix = fit.jacobian[:, columns] * weight[:, None] * (size / scale)
    level = float(np.sqrt(max(1.0, fit.cost / max(1, fit.residual.size))))
    values, vectors = np.linalg.eigh(matrix.T @ matrix)
    found = []
    for k in range(values.size):
        if level / np.sqrt(max(values[k], 1e-300)) < _LOOSE:
            continue
        direction = vectors[:, k]
        order = np.argsort(-np.abs(direction))
        main = [int(j) for j in order if abs(direction[j]) > 0.4 * abs(direction[order[0]])]
        names = [free[j].key for j in main]
        if len(names) == 1:
            found.append(f"{names[0]} is not determined by these data")
        elif len(names) == 2:
            same = direction[main[0]] * direction[main[1]] > 0
            found.append(f"{names[0]} and {names[1]} only as a {'ratio' if same else 'product'}")
        else:
            found.append(f"{', '.join(names[:-1])} and {names[-1]} only in combination")
    return tuple(found)

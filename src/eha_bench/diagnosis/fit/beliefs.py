"""What is believed of parameters before any recording: `within:` of the model.

A tolerance of a data sheet bounds a value and says nothing more, so the value is taken as equally
likely anywhere in it; that has a standard deviation of the tolerance over the root of three
(JCGM 100:2008, 4.3.7). In a fit it counts as one more reading of the parameter, with that as its
noise: a normal prior about the declared value. It decides only what the recordings leave open.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.model import Model

FAR = 3.0
"""Multiple of what is given under `within` from which a value contradicts it."""


@dataclass(frozen=True)
class Belief:
    """What is believed of one parameter.

    Attributes:
        key: of the parameter. at: its place in the vector.
        value: declared, SI. deviation: standard deviation about it, SI.
    """

    key: str
    at: int
    value: float
    deviation: float

    @property
    def within(self) -> float:
        """What is given under `within`, SI."""
        return math.sqrt(3.0) * self.deviation


def beliefs_of(model: Model) -> tuple[Belief, ...]:
    """Return what a model says of the parameters under `calibrate`."""
    vector, index = model.vector(), model.plant.layout.index
    return tuple(
        Belief(key, index[key], float(vector[index[key]]), model.within[key] / math.sqrt(3.0))
        for key in dict.fromkeys(model.calibrate)
        if key in model.within
    )


def believed_residual(beliefs: Sequence[Belief], vector: FloatArray) -> FloatArray:
    """Return how far parameters are from what is believed, in standard deviations, (k,)."""
    return np.array([(item.value - vector[item.at]) / item.deviation for item in beliefs])


def is_beyond(beliefs: Sequence[Belief], vector: FloatArray) -> bool:
    """Return whether a parameter is outside of what is given under `within`."""
    return bool(contradicted(beliefs, vector))


def contradicted(
    beliefs: Sequence[Belief], vector: FloatArray, multiple: float = 1.0
) -> list[Belief]:
    """Return what is believed of parameters that are further off than so many times `within`."""
    return [item for item in beliefs if abs(vector[item.at] - item.value) > multiple * item.within]

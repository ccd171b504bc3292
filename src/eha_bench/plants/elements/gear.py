"""A rigid gear: the node `from` turns `ratio` times as fast as the node `to`.

    w_from = n w_to,    T_to = n T_from

What is on `from` (inertia, friction, a motor) is felt on `to` through the ratio: inertia by n^2.
A spindle or a rack is a gear between a rotation and a translation (n in rad/m).

Source: Karnopp, Margolis, Rosenberg, System Dynamics, Wiley 2012 (transformers).
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import MECHANICAL, Anatomy, ElementKind, Port, Tie
from eha_bench.plants.parameter import Parameter

_RATIO = Parameter("ratio", "{ratio}", 1.0, -math.inf, math.inf, "n", nonzero=True, drawn=True)


def ratio_of(ratio: float) -> float:
    """Return how much faster `from` turns than `to`."""
    return ratio


def input_angle(position: float, ratio: float) -> float:
    """Return the angle of `from` at one of `to`, rad."""
    return ratio * position


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy((_RATIO,), (Tie("from", "to", ratio_of, input_angle),))


KIND = ElementKind(
    id="gear",
    summary="A rigid gear, spindle or rack.",
    ports=(Port("from", MECHANICAL), Port("to", MECHANICAL)),
    parameters=(_RATIO,),
    anatomy=_anatomy,
    required=("ratio",),
    source="Karnopp, Margolis, Rosenberg, System Dynamics, Wiley 2012",
)

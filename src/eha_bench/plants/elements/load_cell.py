"""A load cell between two parts that slide or turn: a stiff spring with a damper in parallel.

    F = k (x_first - x_second) + c (v_first - v_second)

pushes the second part forwards and the first one back, and is what it reads.

Source: Karnopp, Margolis, Rosenberg, System Dynamics, Wiley 2012.
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import (
    MECHANICAL,
    Anatomy,
    Effort,
    ElementKind,
    Port,
    Quantity,
)
from eha_bench.plants.parameter import Parameter

_STIFFNESS = Parameter("stiffness", "{effort}/{position}", 1e5, 0.0, math.inf, "k")
_DAMPING = Parameter("damping", "{damping}", 0.0, 0.0, math.inf, "c")


def force_on_second(
    position_first: float,
    position_second: float,
    speed_first: float,
    speed_second: float,
    stiffness: float,
    damping: float,
) -> float:
    """Return the force (or torque) from the first part on the second, N (or N*m)."""
    return stiffness * (position_first - position_second) + damping * (speed_first - speed_second)


def force_on_first(
    position_first: float,
    position_second: float,
    speed_first: float,
    speed_second: float,
    stiffness: float,
    damping: float,
) -> float:
    """Return the force (or torque) back on the first part, N (or N*m)."""
    return stiffness * (position_second - position_first) + damping * (speed_second - speed_first)


def stiffness_of(stiffness: float) -> float:
    """Return the stiffness, N/m (or N*m/rad)."""
    return stiffness


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy(
        (_STIFFNESS, _DAMPING),
        (
            Effort("first", force_on_first, stiffness=stiffness_of),
            Effort("second", force_on_second, stiffness=stiffness_of),
        ),
        quantities=(Quantity("force", "{effort}", force_on_second),),
    )


KIND = ElementKind(
    id="load_cell",
    summary="A stiff spring with a damper between two parts, whose force a channel may show.",
    ports=(Port("first", MECHANICAL), Port("second", MECHANICAL)),
    parameters=(_STIFFNESS, _DAMPING),
    anatomy=_anatomy,
    required=("stiffness",),
    source="Karnopp, Margolis, Rosenberg, System Dynamics, Wiley 2012",
)

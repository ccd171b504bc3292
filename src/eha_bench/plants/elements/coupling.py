"""An elastic coupling between two parts, with its play: a belt, a series spring, a gear's teeth.

    d = x_first - x_second
    F = k s + c (v_first - v_second),  s = d - min(max(d, -g/2), g/2)

pushes the second part forwards and the first one back. Within its play g it pushes nothing, and at
the ends of the play it only pushes; without play it is a spring with a damper in parallel.

Source: Nordin, Gutman, Automatica 38 (2002) 1633, doi:10.1016/S0005-1098(02)00047-X.
"""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit
from eha_bench.plants.network.element import (
    MECHANICAL,
    Anatomy,
    Effort,
    ElementKind,
    Port,
    Quantity,
)
from eha_bench.plants.parameter import Parameter

_STIFFNESS = Parameter("stiffness", "{effort}/{position}", 1e3, 0.0, math.inf, "k")
_DAMPING = Parameter("damping", "{damping}", 0.0, 0.0, math.inf, "c")
_PLAY = Parameter("play", "{position}", 0.0, 0.0, math.inf, "g", "from end to end")


@njit()
def transmitted(bent: float, rate: float, stiffness: float, damping: float, play: float) -> float:
    """Return the force from the first part on the second, N (or N*m).

    Args:
        bent: x_first - x_second, m (or rad). rate: of it.
        stiffness, damping, play: of the coupling.
    """
    squeeze = bent - min(max(bent, -0.5 * play), 0.5 * play)
    if play > 0.0 and squeeze == 0.0:
        return 0.0
    force = stiffness * squeeze + damping * rate
    return force if play <= 0.0 or force * squeeze > 0.0 else 0.0


def force_on_second(
    position_first: float,
    position_second: float,
    speed_first: float,
    speed_second: float,
    stiffness: float,
    damping: float,
    play: float,
) -> float:
    """Return the force (or torque) from the first part on the second, N (or N*m)."""
    bent, rate = position_first - position_second, speed_first - speed_second
    return transmitted(bent, rate, stiffness, damping, play)


def force_on_first(
    position_first: float,
    position_second: float,
    speed_first: float,
    speed_second: float,
    stiffness: float,
    damping: float,
    play: float,
) -> float:
    """Return the force (or torque) back on the first part, N (or N*m)."""
    bent, rate = position_first - position_second, speed_first - speed_second
    return -transmitted(bent, rate, stiffness, damping, play)


def stiffness_of(stiffness: float) -> float:
    """Return the stiffness, N/m (or N*m/rad)."""
    return stiffness


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy(
        (_STIFFNESS, _DAMPING, _PLAY),
        (
            Effort("first", force_on_first, stiffness=stiffness_of),
            Effort("second", force_on_second, stiffness=stiffness_of),
        ),
        quantities=(Quantity("force", "{effort}", force_on_second),),
    )


KIND = ElementKind(
    id="coupling",
    summary="An elastic coupling between two parts, with its play.",
    ports=(Port("first", MECHANICAL), Port("second", MECHANICAL)),
    parameters=(_STIFFNESS, _DAMPING, _PLAY),
    anatomy=_anatomy,
    required=("stiffness",),
    source="Nordin, Gutman, Automatica 38 (2002) 1633, doi:10.1016/S0005-1098(02)00047-X",
)

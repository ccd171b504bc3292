"""Dry and viscous friction of a shaft or a rod; at rest it takes any value up to the static level.

    F = sign(v) [F_c + (F_s - F_c) exp(-(v/v_s)^2)] + B v

`creep_speed` v_0: 0, and it sticks; else sign(v) is tanh(v / v_0), and it creeps (the usual
regularisation: Quinn, J. Vib. Acoust. 126 (2004) 391, doi:10.1115/1.1760564).

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083,
doi:10.1016/0005-1098(94)90209-7.
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import MECHANICAL, Anatomy, ElementKind, Friction, Port
from eha_bench.plants.parameter import Parameter

_INF = math.inf
_COULOMB = Parameter("coulomb", "{effort}", 0.0, 0.0, _INF, "F_c")
_STATIC = Parameter(
    "static",
    "{effort}",
    0.0,
    0.0,
    _INF,
    "F_s",
    "at rest, `coulomb` or more; where it is left out nothing falls with the speed",
)
_STRIBECK = Parameter("stribeck_speed", "{speed}", 1.0, 1e-9, _INF, "v_s")
_VISCOUS = Parameter("viscous", "{damping}", 0.0, 0.0, _INF, "B")
_CREEP = Parameter(
    "creep_speed", "{speed}", 0.0, 0.0, 10.0, "v_0", "0: friction sticks at rest, else it creeps"
)


def stribeck(speed: float, coulomb: float, static: float, stribeck_speed: float) -> float:
    """Return the dry friction that falls from its static level with speed, N or N*m."""
    ratio = speed / stribeck_speed
    return coulomb + (static - coulomb) * math.exp(-ratio * ratio)


def constant(coulomb: float) -> float:
    """Return the dry friction that is the same at all speeds, N or N*m."""
    return coulomb


def _anatomy(declared: frozenset[str]) -> Anatomy:
    if not {"coulomb", "static", "stribeck_speed", "creep_speed"} & declared:
        return Anatomy((_VISCOUS,), (Friction("on", None, "viscous"),))
    falls = bool({"static", "stribeck_speed"} & declared)
    parameters = (_COULOMB, *((_STATIC, _STRIBECK) if falls else ()), _VISCOUS, _CREEP)
    friction = Friction("on", stribeck if falls else constant, "viscous", "creep_speed")
    return Anatomy(parameters, (friction,))


KIND = ElementKind(
    id="friction",
    summary="Dry and viscous friction that sticks at rest.",
    ports=(Port("on", MECHANICAL),),
    parameters=(_COULOMB, _STATIC, _STRIBECK, _VISCOUS, _CREEP),
    anatomy=_anatomy,
    source="Armstrong-Helouvry et al., Automatica 30 (1994) 1083",
    changed_by_warmth=("coulomb", "static", "viscous"),
)

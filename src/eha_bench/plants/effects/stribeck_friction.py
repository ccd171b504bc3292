"""Dry friction that is larger at low speed than at high speed, where one level is declared.

    F = -sign(v) [F_c + F_e exp(-|v / v_s|^d)];  at rest any force up to F_c + F_e

F_c is the declared level, F_e the excess at rest, v_s the Stribeck velocity; d is 2
(`gaussian`) or 1 (`exponential`, Tustin's law). Lubricated seals, guides and gears do so: their
surfaces lift off as they slide faster. Where no dry friction is declared, `coulomb_friction` has
this fall among its forms; where a static level is declared, the plant has this law already.

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083,
doi:10.1016/0005-1098(94)90209-7.
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_GAUSSIAN = 0.0


def falling_friction(
    level: float, speed: float, excess_force: float, form: float, stribeck_velocity: float
) -> float:
    """Return the dry friction, N (or N*m)."""
    ratio = abs(speed / stribeck_velocity)
    return level + excess_force * math.exp(-ratio * ratio if form == _GAUSSIAN else -ratio)


EFFECT = Effect(
    id="stribeck_friction",
    summary="Dry friction is larger at low speed than the one level that is declared.",
    parameters=(
        Parameter("excess_force", "{effort}", 0.4, 0.0, 1e6, "F_e"),
        choice("form", ("gaussian", "exponential"), "how it falls with speed"),
        Parameter(
            "stribeck_velocity", "{stribeck}", 1.0, 1e-6, 100.0, "v_s",
            "lubricated seals, guides and gears",
        ),
    ),
    actions={
        "friction": Action(
            {"dry": falling_friction},
            same_as="static",
            needs="coulomb",
            fades_by="stribeck_velocity",
        ),
    },
    source=(
        "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, "
        "doi:10.1016/0005-1098(94)90209-7"
    ),
    separate="move at several constant speeds, slow ones too: the force falls as the speed rises",
    starts=({"stribeck_velocity": 0.2},),
)  # fmt: skip

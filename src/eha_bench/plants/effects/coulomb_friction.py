"""Dry friction, for something that moves and is declared without it.

    F = -sign(v) F_c [1 + (r - 1) exp(-|v / v_s|^d)];  at rest any force up to r F_c

r is the ratio of static to Coulomb friction: 1, the default, is Coulomb's law alone; v_s is the
Stribeck velocity, and d is 2 (`stribeck`) or 1 (`exponential`, Tustin's law): measured ones lie
between.

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083,
doi:10.1016/0005-1098(94)90209-7.
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_CONSTANT, _STRIBECK = 0.0, 1.0


_FALLING = ("stribeck", "exponential")


def dry_friction(
    level: float,
    speed: float,
    friction_force: float,
    form: float,
    static_ratio: float,
    stribeck_velocity: float,
) -> float:
    """Return the dry friction, N (or N*m)."""
    if form == _CONSTANT:
        return level + friction_force
    ratio = abs(speed / stribeck_velocity)
    fall = math.exp(-ratio * ratio) if form == _STRIBECK else math.exp(-ratio)
    return level + friction_force * (1.0 + (static_ratio - 1.0) * fall)


EFFECT = Effect(
    id="coulomb_friction",
    summary="Dry friction that the plant is declared without.",
    parameters=(
        Parameter("friction_force", "{effort}", 0.4, 0.0, 1e6, "F_c"),
        choice("form", ("constant", "stribeck", "exponential"), "how it falls with speed"),
        Parameter("static_ratio", "", 1.3, 1.0, 5.0, "r", when=("form", _FALLING)),
        Parameter(
            "stribeck_velocity", "{stribeck}", 1.0, 1e-6, 100.0, "v_s",
            "lubricated seals, guides and gears", when=("form", _FALLING),
        ),
    ),
    actions={"friction": Action({"dry": dry_friction}, same_as="coulomb")},
    source=(
        "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, "
        "doi:10.1016/0005-1098(94)90209-7"
    ),
    separate="move at several constant speeds both ways: the force jumps where motion reverses",
    starts=({"friction_force": 1.2}, {"stribeck_velocity": 0.2, "static_ratio": 2.0}),
)  # fmt: skip

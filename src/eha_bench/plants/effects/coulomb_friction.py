"""Dry (Coulomb) friction of the rod, for a plant declared without it.

    F = -F_c sign(v);  at rest any force up to F_c

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083,
doi:10.1016/0005-1098(94)90209-7, section 2.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter


def rubbed(level: float, friction_force: float) -> float:
    """Return the dry friction of the rod, N."""
    return level + friction_force


EFFECT = Effect(
    id="coulomb_friction",
    summary="Dry friction of the rod (or carriage) that the plant is declared without.",
    parameters=(Parameter("friction_force", "N", 20.0, 0.0, 1e6, "F_c"),),
    actions={
        "eha_knee": Action(Equation.FORCE, {"rod_dry": rubbed}),
        "linear_drive": Action(Equation.FORCE, {"rod_dry": rubbed}),
    },
    source=(
        "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, "
        "doi:10.1016/0005-1098(94)90209-7"
    ),
    separate="move at several constant speeds both ways: the force jumps where motion reverses",
    same_as={"eha_knee": "rod_coulomb", "linear_drive": "coulomb_friction"},
)

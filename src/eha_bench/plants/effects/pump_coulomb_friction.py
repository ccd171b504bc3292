"""Dry (Coulomb) friction of the pump's shaft, for a plant declared without it.

    T = -T_c sign(w);  at rest any torque up to T_c

Source: as `coulomb_friction`.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter


def rubbed(level: float, friction_torque: float) -> float:
    """Return the dry friction of the pump, N*m."""
    return level + friction_torque


EFFECT = Effect(
    id="pump_coulomb_friction",
    summary="Dry friction of the pump's shaft that the plant is declared without.",
    parameters=(Parameter("friction_torque", "N*m", 0.1, 0.0, 1e3, "T_c"),),
    actions={"eha_knee": Action(Equation.TORQUE, {"pump_dry": rubbed})},
    source=(
        "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, "
        "doi:10.1016/0005-1098(94)90209-7"
    ),
    separate="constant currents both ways with the bypass open: current jumps with the direction",
    same_as={"eha_knee": "coulomb_torque"},
)

"""Friction at rest opposes the motion that ended there, or that the load would make.

    T_h = (1 - r) T_sf - r T_cf

At r = 0 the pump's friction always burdens the motor, as Eq. (21) is printed. But where a pressure
step overshoots, the load drives the rotor back before it rests, and friction then helps to hold:
at r = 1 the motor is relieved of the whole Coulomb friction. Between the two lies what stiction
allows.

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083,
doi:10.1016/0005-1098(94)90209-7 (friction opposes motion; at rest it takes what value holds).
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter


def holding(friction: float, coulomb_torque: float, reversal: float) -> float:
    """Return the friction that the motor has to overcome at rest, N*m."""
    return (1.0 - reversal) * friction - reversal * coulomb_torque


EFFECT = Effect(
    id="friction_direction",
    summary="At rest friction helps to hold the load instead of burdening the motor.",
    parameters=(Parameter("reversal", "", 1.0, 0.0, 1.0, "r", "1: helps with all of T_cf"),),
    actions={"holding": Action({"holding_friction": holding})},
    source=(
        "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, "
        "doi:10.1016/0005-1098(94)90209-7"
    ),
    separate="hold the same pressure coming from below and from above: an offset stays, friction "
    "changes sides",
)

"""Friction is stronger in one direction than in the other.

    F_f(+) = F_f (1 + a),   F_f(-) = F_f (1 - a)

of anything that moves: its dry friction, its viscous friction, or both (`kind`). It scales whatever
friction there is, also that of other effects. Bristles that are bent pull as they are bent, also
where the motion has turned back already: their pull, but for its damping, has no jump there.

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083,
doi:10.1016/0005-1098(94)90209-7; EMPS, whose viscous friction is lopsided: Janot,
Gautier, Brunot, Workshop on Nonlinear System Identification Benchmarks 2019.
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_DRY, _VISCOUS, _ALL = 0.0, 1.0, 2.0


def dry(level: float, direction: float, bent: float, asymmetry: float, kind: float) -> float:
    """Return the dry friction for a direction, or for that of bent bristles, N (or N*m)."""
    if kind == _VISCOUS:
        return level
    along = direction if bent == 0.0 else math.copysign(1.0, bent)
    return level * (1.0 + asymmetry * along)


def viscous(coefficient: float, speed: float, asymmetry: float, kind: float) -> float:
    """Return the viscous friction for a direction, N*s/m (or N*m*s/rad)."""
    if kind == _DRY:
        return coefficient
    return coefficient * (1.0 + asymmetry if speed > 0.0 else 1.0 - asymmetry)


EFFECT = Effect(
    id="asymmetric_friction",
    summary="Friction is stronger in one direction than in the other.",
    parameters=(
        # nine times as strong one way as the other; beyond that it is a force that has a direction
        Parameter("asymmetry", "", 0.1, -0.8, 0.8, "a"),
        choice("kind", ("dry", "viscous", "all"), "which friction is lopsided"),
    ),
    actions={"friction": Action({"dry": dry, "viscous": viscous})},
    source=(
        "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, "
        "doi:10.1016/0005-1098(94)90209-7"
    ),
    separate=(
        "move both ways at the same speeds without load: friction then differs by direction, a "
        "sensor's offset does not matter; a constant load (a weight on a drum) looks the same in "
        "motion, and pulls at rest as well"
    ),
    starts=(
        {"asymmetry": -0.1, "kind": _DRY},
        {"asymmetry": 0.3, "kind": _DRY},
        {"asymmetry": -0.3, "kind": _DRY},
        {"asymmetry": 0.1, "kind": _VISCOUS},
        {"asymmetry": 0.1, "kind": _ALL},
    ),
    order=1,
)

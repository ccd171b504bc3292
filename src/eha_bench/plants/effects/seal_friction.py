"""The seals of piston and rod are pressed on by the oil, so the rod's friction grows with pressure.

    F_f += mu A p                  dry: at any speed
    F_f += mu A p |v| / v_0        viscous: with speed, v_0 = 0.1 m/s

p is p_a + p_b, |p_a - p_b|, the higher of both, or that of one chamber, which is all that a rod's
seal sees (the piston's sees the difference). A is the piston area, so mu is the share of the
hydraulic force that the seals take (viscous: at v_0). Dry where the seal touches, viscous where it
rides on a film that the pressure makes thinner; real seals are in between. F_f and v are the rod's:
where it moves r times as fast as the coordinate that it is geared to, the friction there is r F_f.

Source: Bonchis, Corke, Rye, A Pressure-Based, Velocity Independent, Friction Model for Asymmetric
Hydraulic Cylinders, IEEE Int. Conf. Robotics and Automation 1999; Nikas, Proc. IMechE J 224 (2010);
friction of pneumatic seals that grows with pressure and speed: Belforte, Raparelli, Velardocchia,
Study of the behavior of lip seals in pneumatic actuators, Lubrication Engineering 49 (1993) 775.
"""

from __future__ import annotations

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_SUM, _DIFFERENCE, _HIGHER, _A, _B = 0.0, 1.0, 2.0, 3.0, 4.0
_DRY, _VISCOUS = 0.0, 1.0
_SPEED = 0.1


@njit()
def _pressing(p_a: float, p_b: float, pressure: float) -> float:
    """Return the pressure that presses, Pa."""
    if pressure == _SUM:
        return max(0.0, p_a) + max(0.0, p_b)
    if pressure == _DIFFERENCE:
        return abs(p_a - p_b)
    if pressure == _HIGHER:
        return max(0.0, p_a, p_b)
    return max(0.0, p_a if pressure == _A else p_b)


def dry(
    level: float,
    p_a: float,
    p_b: float,
    area_a: float,
    friction_coefficient: float,
    pressure: float,
    kind: float,
    ratio: float = 1.0,
) -> float:
    """Return the dry friction with the rod's seals pressed on, N; `ratio` is the rod's, r."""
    if kind != _DRY:
        return level
    return level + ratio * friction_coefficient * area_a * _pressing(p_a, p_b, pressure)


def viscous(
    coefficient: float,
    p_a: float,
    p_b: float,
    area_a: float,
    friction_coefficient: float,
    pressure: float,
    kind: float,
    ratio: float = 1.0,
) -> float:
    """Return the viscous friction with the rod's seals pressed on, N*s/m."""
    if kind != _VISCOUS:
        return coefficient
    pressed = friction_coefficient * area_a * _pressing(p_a, p_b, pressure)
    return coefficient + ratio * ratio * pressed / _SPEED


EFFECT = Effect(
    id="seal_friction",
    summary="The rod's friction grows with pressure, because the oil presses its seals on.",
    parameters=(
        Parameter("friction_coefficient", "", 0.02, 0.0, 1.0, "mu"),
        choice("pressure", ("sum", "difference", "higher", "a", "b"), "which pressure presses"),
        choice("kind", ("dry", "viscous"), "which friction grows"),
    ),
    actions={"rod": Action({"dry": dry, "viscous": viscous})},
    source=(
        "Bonchis, Corke, Rye, IEEE Int. Conf. Robotics and Automation 1999 (pressure-based "
        "friction of cylinders)"
    ),
    separate="move the rod slowly both ways under several loads; viscosity does not care for load",
    starts=tuple({"pressure": word} for word in (_DIFFERENCE, _HIGHER, _A, _B)),
)

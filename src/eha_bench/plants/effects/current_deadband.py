"""Small currents make no torque: a dead zone of the drive or of the motor.

    i_eff = i - d_+ where i > d_+,   i + d_- where i < -d_-,   0 between
    d_+ = d (1 + a),  d_- = d (1 - a);  a = 0 where the edges are equal

The corners may be rounded (`form: smooth`): dead times of switches vary, and a sensor's noise blurs
an edge. Then the effective current is that of the softened dead zone,

    i_eff = w ln[(1 + e^((i - d_+) / w)) / (1 + e^(-(i + d_-) / w))],   w = d / 3

In the drive (its switches' dead time) the current sensor sees it; in the motor it does not. A motor
that a voltage drives has no current that is commanded, so there it is the voltage's, or the duty
cycle's.

Source: Tao, Kokotovic, IEEE Trans. Automatic Control 39 (1994) 59, doi:10.1109/9.273339 (dead
zones of actuators, with edges of their own on either side); Leonhard, Control of Electrical Drives,
2001 (dead time of inverters).
"""

from __future__ import annotations

from typing import NamedTuple

from eha_bench.plants.compiled import njit
from eha_bench.plants.dead_zone import FORMS, dead_zone
from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_DRIVE, _MOTOR = 0.0, 1.0
_EQUAL, _UNEQUAL = 0.0, 1.0


class DeadZone(NamedTuple):
    """The zone's own parameters."""

    deadband: float
    asymmetry: float
    form: float
    edges: float
    place: float


@njit()
def _effective_current(current: float, own: DeadZone) -> float:
    """Return what a dead zone leaves of a current, A."""
    asymmetry = own.asymmetry if own.edges != _EQUAL else 0.0
    return dead_zone(current, own.deadband, asymmetry, own.form)


def drive(demand: float, own: DeadZone) -> float:
    """Return the current that the drive makes of a demand, A."""
    return _effective_current(demand, own) if own.place == _DRIVE else demand


def motor(torque: float, current: float, own: DeadZone) -> float:
    """Return the motor's torque where the dead zone is behind the current sensor, N*m."""
    if own.place != _MOTOR:
        return torque
    return torque * (_effective_current(current, own) / current) if current != 0.0 else 0.0


EFFECT = Effect(
    id="current_deadband",
    summary="Small currents make no torque.",
    parameters=(
        Parameter("deadband", "{command}", 0.0109, 0.0, 100.0, "d"),
        Parameter(
            "asymmetry", "", 0.3, -1.0, 1.0, "a", "of the two edges", when=("edges", ("unequal",))
        ),
        choice("form", FORMS, "whether the corners are rounded"),
        choice("edges", ("equal", "unequal"), "whether both directions have the same",
               refines=True),
        choice("place", ("drive", "motor"), "whether the current sensor sees it"),
    ),
    actions={"motor_drive": Action({"demand": drive, "torque": motor})},
    source="Tao, Kokotovic, IEEE Trans. Automatic Control 39 (1994) 59, doi:10.1109/9.273339",
    separate="slow current ramps through zero without load: friction sticks, a dead zone takes the "
    "same current from every torque",
    starts=({"edges": _UNEQUAL, "asymmetry": -0.3}, {"deadband": 0.1}),
)  # fmt: skip

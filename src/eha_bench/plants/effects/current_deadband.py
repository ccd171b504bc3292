"""Small currents make no torque: a dead zone of the drive or of the motor.

    i_eff = 0 where |i| <= d,   i - d sign(i) elsewhere

In the drive (its switches' dead time) the current sensor sees it; in the motor it does not.

Source: Tao, Kokotovic, IEEE Trans. Automatic Control 39 (1994) 59, doi:10.1109/9.273339 (dead
zones of actuators); Leonhard, Control of Electrical Drives, 2001 (dead time of inverters).
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_DRIVE, _MOTOR = 0.0, 1.0


def drive(demand: float, deadband: float, place: float) -> float:
    """Return the current that the drive makes of a demand, A."""
    if place != _DRIVE:
        return demand
    if demand > 0.0:
        return max(0.0, demand - deadband)
    return min(0.0, demand + deadband)


def motor(torque: float, current: float, deadband: float, place: float) -> float:
    """Return the motor's torque where the dead zone is behind the current sensor, N*m."""
    if place != _MOTOR:
        return torque
    size = abs(current)
    return torque * (1.0 - deadband / size) if size > deadband else 0.0


EFFECT = Effect(
    id="current_deadband",
    summary="Small currents make no torque.",
    parameters=(
        Parameter("deadband", "{command}", 0.0109, 0.0, 100.0, "d"),
        choice("place", ("drive", "motor"), "whether the current sensor sees it"),
    ),
    actions={"motor_drive": Action({"demand": drive, "torque": motor})},
    source="Tao, Kokotovic, IEEE Trans. Automatic Control 39 (1994) 59, doi:10.1109/9.273339",
    separate="slow current ramps through zero without load: friction sticks, a dead zone takes the "
    "same current from every torque",
    starts=({"place": _MOTOR},),
)

"""Signals that contradict each other: torque against pressure, velocity against position.

Over a short window the motor's torque has to go somewhere, Eq. (3) of the paper integrated::

    K_T i - D_p (P1 - P2) - B w - J (w_end - w_start) / T    within +- friction and a share

and the rod has to get where its velocity takes it. A sensor whose scaling is wrong, or that is
stuck, breaks one of the two although each signal for itself looks well. Only windows without a gap
count.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

_GAP: Final = 1.3
"""Periods between two ticks above which a window begins again: its time stamps are not sure."""
BALANCED: Final = (
    "current",
    "motor_speed",
    "pressure_a",
    "pressure_b",
    "piston_position",
    "piston_velocity",
)
"""Channels whose values a balance uses."""
_TORQUE: Final = ("current", "motor_speed", "pressure_difference")
_MOTION: Final = ("piston_position", "piston_velocity")


@dataclass(frozen=True)
class Tolerance:
    """What a balance may be off: a fixed part, SI, and a share of the larger side."""

    within: float
    share: float


@dataclass(frozen=True)
class TorqueModel:
    """Nominal parameters of the motor and pump, SI."""

    torque_constant: float
    displacement: float
    viscous: float
    inertia: float


@dataclass(frozen=True)
class BalanceLimits:
    """Which balances are checked, over how long a window, s; None for one that is not."""

    length: float
    torque: Tolerance | None
    motion: Tolerance | None
    model: TorqueModel | None


@dataclass(frozen=True)
class _Point:
    """One tick: time s, motor torque, load torque, speed, position, velocity."""

    time: float
    drive: float
    load: float
    speed: float
    position: float
    velocity: float


class Balance:
    """Keeps the last ticks and says which balance they break."""

    def __init__(self, limits: BalanceLimits, period: float) -> None:
        self._limits = limits
        self._period = period
        self._size = max(round(limits.length / period), 2)
        self._points: deque[_Point] = deque(maxlen=self._size + 1)

    def check(self, time: float, readings: Mapping[str, float]) -> str:
        """Return what is wrong, or an empty text.

        Args:
            time: of the readings, s; the same or an earlier one than before is nothing new.
            readings: by channel, SI.
        """
        points = self._points
        if points and time <= points[-1].time:
            return ""
        if points and time - points[-1].time > _GAP * self._period:
            points.clear()
        points.append(self._point(time, readings))
        if len(points) <= self._size:
            return ""
        return self._torque() or self._motion()

    def _point(self, time: float, readings: Mapping[str, float]) -> _Point:
        model = self._limits.model
        drive = load = speed = 0.0
        if model is not None and all(name in readings for name in _TORQUE):
            current, speed, difference = (readings[name] for name in _TORQUE)
            drive = model.torque_constant * current
            load = model.displacement * difference + model.viscous * speed
        if not all(name in readings for name in _MOTION):
            return _Point(time, drive, load, speed, 0.0, 0.0)
        position, velocity = (readings.get(name, 0.0) for name in _MOTION)
        return _Point(time, drive, load, speed, position, velocity)

    def _torque(self) -> str:
        tolerance, model, points = self._limits.torque, self._limits.model, self._points
        if tolerance is None or model is None:
            return ""
        # the current at a tick is what flowed until it; pressures are taken as straight in between
        rest = len(points) - 1
        drive = sum(point.drive for point in points) - points[0].drive
        load = sum(point.load for point in points) - 0.5 * (points[0].load + points[-1].load)
        drive, load = drive / rest, load / rest
        inertia = model.inertia * (points[-1].speed - points[0].speed)
        inertia /= points[-1].time - points[0].time
        off = drive - load - inertia
        if abs(off) <= tolerance.within + tolerance.share * max(abs(drive), abs(load)):
            return ""
        return (
            f"current, motor_speed and pressures contradict each other: {drive:.3g} N*m from the "
            f"motor, {load:.3g} N*m on the pump, {inertia:.3g} N*m to speed it up"
        )

    def _motion(self) -> str:
        tolerance, points = self._limits.motion, self._points
        if tolerance is None:
            return ""
        rest = len(points) - 1
        moved = points[-1].position - points[0].position
        moved /= points[-1].time - points[0].time
        velocity = sum(point.velocity for point in points)
        velocity = (velocity - 0.5 * (points[0].velocity + points[-1].velocity)) / rest
        if abs(moved - velocity) <= tolerance.within + tolerance.share * max(
            abs(moved), abs(velocity)
        ):
            return ""
        return (
            f"piston_position and piston_velocity contradict each other: {moved:.4g} m/s against "
            f"{velocity:.4g} m/s"
        )

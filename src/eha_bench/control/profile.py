"""A reference that a machine can follow: a third-order filter with bounded speed and acceleration.

Three nested loops with the poles of (s + r)^3 while nothing is bounded::

    v* = v_t + clip(f(target - x), v_max),   a* = a_t + clip(r (v* - v), a_max),
    jerk = 3 r (a* - a)

where v_t and a_t are the target's own speed and acceleration (0 at a jump): a smooth target is
followed without lag, and the bounds hold for catching up with it. f is r/3 times the error near the
target and sqrt(2 a |error|) farther away, the speed from which it can still stop with the
acceleration it has (Biagiotti, Melchiorri, Trajectory Planning for
Automatic Machines and Robots, Springer 2008, section 4.6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from eha_bench.control.controller import clip
from eha_bench.core.units import Unit
from eha_bench.core.yaml_file import StrictModel

# share of the acceleration that braking plans with; the rest is for the filter's own lag
_BRAKING = 0.7


class ProfileLimits(StrictModel):
    """Bounds of the reference, SI."""

    rate: Annotated[float, Unit("1/s"), Field(gt=0, description="bandwidth r of the filter")]
    speed: Annotated[float, Unit("m/s"), Field(gt=0, description="largest speed")]
    acceleration: Annotated[float, Unit("m/s^2"), Field(gt=0, description="largest acceleration")]


@dataclass(frozen=True)
class Motion:
    """A point of the profile: position m, velocity m/s, acceleration m/s^2, jerk m/s^3."""

    x: float
    v: float
    a: float
    jerk: float


class Profile:
    """The filter, at rest at its first position until the target moves."""

    def __init__(self, limits: ProfileLimits, period: float, start: float) -> None:
        self._limits = limits
        self._period = period
        self._x, self._v, self._a = start, 0.0, 0.0
        self._target: float | None = None
        self._target_speed = 0.0

    def step(self, target: float) -> Motion:
        """Return where the reference is now, and move it on by one period towards `target` (m)."""
        rate, top = self._limits.rate, self._limits.acceleration
        error = target - self._x
        gain, braking = rate / 3.0, _BRAKING * top
        knee = braking / gain**2
        if abs(error) <= knee:
            speed = gain * error
        else:
            speed = math.copysign(math.sqrt(2.0 * braking * (abs(error) - knee / 2.0)), error)
        target_speed, target_acceleration = self._target_motion(target)
        speed = target_speed + clip(speed, self._limits.speed)
        wanted = target_acceleration + clip(rate * (speed - self._v), top)
        jerk = 3.0 * rate * (wanted - self._a)
        now = Motion(self._x, self._v, self._a, jerk)
        h = self._period
        self._a += h * jerk
        self._v += h * self._a
        self._x += h * self._v
        return now

    def _target_motion(self, target: float) -> tuple[float, float]:
        """Return the target's speed and acceleration; a target that jumps has none."""
        previous, self._target = self._target, target
        speed = 0.0 if previous is None else (target - previous) / self._period
        if abs(speed) > 2.0 * self._limits.speed:
            speed = 0.0
        acceleration = (speed - self._target_speed) / self._period
        self._target_speed = speed
        bound = 2.0 * self._limits.acceleration
        return speed, acceleration if abs(acceleration) <= bound else 0.0

"""Geometry of the knee: rod position and joint angle, Eq. (8)-(10) of the paper.

Two coordinates are kept apart by name: `piston_position` x counts from mid-stroke (as Eq. (4)-(5)
need with V_10 = V_20), the length of the actuator is c = c_0 + x + half the stroke, because c_0
is its length when fully retracted. The joint angle is the absolute angle between the two links::

    cos(angle) = (a^2 + b^2 - c^2) / (2 a b)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray


@dataclass(frozen=True)
class Linkage:
    """The triangle of the two links and the actuator; lengths in m."""

    a: float
    b: float
    c0: float
    half_stroke: float

    def length(self, position: FloatArray) -> FloatArray:
        """Actuator length c in m at a rod position from mid-stroke in m, (n,) -> (n,)."""
        return self.c0 + self.half_stroke + position

    def angle(self, position: FloatArray) -> FloatArray:
        """Absolute joint angle in rad, (n,) -> (n,); NaN where the triangle does not close."""
        c = self.length(np.asarray(position, dtype=np.float64))
        cosine = (self.a**2 + self.b**2 - c**2) / (2 * self.a * self.b)
        inside = np.abs(cosine) <= 1
        result: FloatArray = np.where(inside, np.arccos(np.clip(cosine, -1, 1)), np.nan)
        return result

    def position(self, angle: FloatArray) -> FloatArray:
        """Rod position from mid-stroke in m at an absolute joint angle in rad, (n,) -> (n,)."""
        c_squared = self.a**2 + self.b**2 - 2 * self.a * self.b * np.cos(angle)
        result: FloatArray = np.sqrt(c_squared) - self.c0 - self.half_stroke
        return result

    def position_at(self, angle: float) -> float:
        """Rod position from mid-stroke in m at one absolute joint angle in rad."""
        c_squared = self.a**2 + self.b**2 - 2 * self.a * self.b * math.cos(angle)
        return math.sqrt(c_squared) - self.c0 - self.half_stroke

    def angle_at(self, position: float) -> float:
        """Absolute joint angle in rad at one rod position in m; NaN where there is none."""
        c = self.c0 + self.half_stroke + position
        cosine = (self.a**2 + self.b**2 - c**2) / (2 * self.a * self.b)
        return math.acos(cosine) if abs(cosine) <= 1 else math.nan

    def arm(self, position: FloatArray) -> FloatArray:
        """Moment arm l_el of the actuator about the knee in m, Eq. (10): dc/d(angle)."""
        c = self.length(np.asarray(position, dtype=np.float64))
        return np.asarray(self.a * self.b * np.sin(self.angle(position)) / c, dtype=np.float64)

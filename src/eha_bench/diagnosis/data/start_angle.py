"""Where the shaft stands when a run begins.

Effects of the shaft's angle need the angle, and a speed does not say where an angle begins. So the
angle at the first sample is an unmeasured initial state of each run. It shows only relative to the
phase of those effects: the first run is taken to begin at zero, and the others relative to it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StartAngle:
    """The angle of the shaft at a run's first sample.

    Attributes:
        value: rad. spread: how far it may be off before the run itself is fitted, one standard
            deviation, rad; 0 where it is taken for known.
    """

    value: float = 0.0
    spread: float = 0.0

    @property
    def is_estimated(self) -> bool:
        """Whether it is estimated from the run itself."""
        return self.spread > 0.0


KNOWN = StartAngle()
"""All runs begin at the same angle, which the phase of effects of the angle fixes."""

"""How long a run may take, and why it stopped before its end."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass(frozen=True)
class StopCondition:
    """Says that a run is to stop: it was interrupted, or its time is up.

    Attributes:
        interrupted: whether it was asked for.
        limit: total time from now, s.
    """

    interrupted: Callable[[], bool]
    limit: float = math.inf
    _started: float = field(default_factory=time.monotonic)

    def __call__(self) -> bool:
        """Whether the run is to stop now."""
        return self.interrupted() or time.monotonic() - self._started > self.limit

    @property
    def reason(self) -> str:
        """Why the run is to stop."""
        if self.interrupted():
            return "interrupted"
        return f"the time limit of {self.limit:g} s"

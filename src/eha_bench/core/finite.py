"""Numbers as JSON can hold them, and as readings can be."""

from __future__ import annotations

import math
from typing import Final

LARGEST: Final = 1e100
"""Readings beyond it are none: what is computed of their squares leaves the range of numbers."""


def finite_or_none(value: float) -> float | None:
    """Return a number, or None (JSON's null) for one that is NaN or infinite: JSON has neither."""
    return float(value) if math.isfinite(value) else None

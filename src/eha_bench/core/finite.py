"""Numbers as JSON can hold them."""

from __future__ import annotations

import math


def finite_or_none(value: float) -> float | None:
    """Return a number, or None (JSON's null) for one that is NaN or infinite: JSON has neither."""
    return float(value) if math.isfinite(value) else None

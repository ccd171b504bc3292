"""Moments as results state them: ISO 8601."""

from __future__ import annotations

import math
from datetime import UTC, datetime


def seconds_of(text: str) -> float:
    """Return a moment in s since 1970, NaN where the text is none; without an offset it is UTC."""
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return math.nan
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()

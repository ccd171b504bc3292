"""What a recording says of the plant that made it: constants by name, in its metadata.

Identification needs constants that it does not identify (the pump's displacement, from its data
sheet). Targets that know their plant write every parameter as metadata `model.<name>` (text, SI);
a log made elsewhere may carry them likewise.
"""

from __future__ import annotations

import math

from eha_bench.core.recording import Recording
from eha_bench.metrics.metric import NotScored

PREFIX = "model."


def plant_constant(recording: Recording, name: str) -> float:
    """Return a constant of the plant, SI.

    Raises:
        NotScored: the recording does not carry it.
    """
    value = plant_constant_or_nan(recording, name)
    if not math.isfinite(value):
        raise NotScored(f"no {name}: the recording's metadata have no '{PREFIX}{name}'")
    return value


def plant_constant_or_nan(recording: Recording, name: str) -> float:
    """Return a constant of the plant, SI, or NaN where the recording does not carry it."""
    try:
        return float(recording.metadata.get(PREFIX + name, "nan"))
    except ValueError:
        return math.nan

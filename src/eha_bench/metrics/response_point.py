"""One point of a frequency response."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ResponsePoint:
    """Response over reference at one frequency.

    Attributes:
        frequency: Hz.
        response: complex, channel's unit over the reference's.
        variance: of `response`, both parts together, distortion included where it is known.
        freedom: degrees of freedom of the variance (0: unknown, no interval).
        coherence: share of the channel's power at this frequency that the reference explains.
        noise: standard deviation of `response` by noise alone; NaN where it is not separated.
        distortion: root mean square of what nonlinearity adds to `response`; NaN likewise.
    """

    frequency: float
    response: complex
    variance: float
    freedom: float
    coherence: float
    noise: float = math.nan
    distortion: float = math.nan

"""The root of a pressure difference that orifices share, laminar near zero.

    r(dp) = (dp^2 + p_t^2)^(1/4),   so that dp / r is sign(dp) sqrt(|dp|) but near dp = 0

Source: Borutzky, Barnard, Thoma, Simulation Modelling Practice and Theory 10 (2002) 141,
doi:10.1016/S1569-190X(02)00092-8.
"""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit


@njit()
def smooth_root(difference: float, transition: float) -> float:
    """Return the root of the size of a pressure difference, never less than p_t's, Pa^0.5.

    Args:
        difference: of the pressures, Pa. transition: p_t, below which flow is laminar, Pa.
    """
    return math.sqrt(math.sqrt(difference * difference + transition * transition))

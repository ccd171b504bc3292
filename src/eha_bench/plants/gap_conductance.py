"""The conductance of a gap whose flow follows a power of the pressure.

    q = C d ((d^2 + p_t^2) / p_s^2)^((n - 1) / 2),   p_s = 10 MPa,   p_t = 10 kPa

so that C is the conductance at 10 MPa, and below p_t every flow is laminar.
"""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit

_USUAL, _TRANSITION = 10e6, 1e4


@njit()
def gap_conductance(difference: float, coefficient: float, exponent: float) -> float:
    """Return the flow over the pressure difference, q / d, m^3/(s*Pa).

    Args:
        difference: d, Pa. coefficient: C, m^3/(s*Pa). exponent: n.
    """
    square = (difference * difference + _TRANSITION * _TRANSITION) / (_USUAL * _USUAL)
    return coefficient * math.pow(square, 0.5 * (exponent - 1.0))

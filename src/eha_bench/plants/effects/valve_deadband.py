"""A valve's lands overlap: within a dead band its spool opens nothing.

    o = s - d_+ where s > d_+,   s + d_- where s < -d_-,   0 between
    d_+ = d (1 + a),  d_- = d (1 - a)

The corners may be rounded (`form: smooth`): edges are never sharp, and clearance leaks before they
part. Then the opening is that of the softened dead band,

    o = w ln[(1 + e^((s - d_+) / w)) / (1 + e^(-(s + d_-) / w))],   w = d / 3

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (overlapped valves); Tao, Kokotovic, IEEE
Trans. Automatic Control 39 (1994) 59, doi:10.1109/9.273339.
"""

from __future__ import annotations

from eha_bench.plants.dead_zone import FORMS, dead_zone
from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice


def effective_opening(opening: float, deadband: float, asymmetry: float, form: float) -> float:
    """Return how far the lands are open, as a share of the travel."""
    return dead_zone(opening, deadband, asymmetry, form)


EFFECT = Effect(
    id="valve_deadband",
    summary="Within a dead band the valve's spool opens nothing.",
    parameters=(
        Parameter("deadband", "", 0.02, 0.0, 0.5, "d", "share of the spool's travel"),
        Parameter(
            "asymmetry", "", 0.0, -1.0, 1.0, "a",
            "of the two edges; a bias of the null says the same", searched=False,
        ),
        choice("form", FORMS, "whether the edges are rounded"),
    ),
    actions={"valve": Action({"opening": effective_opening}, Equation.ACTUATION)},
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate="slow ramps of the command through zero: nothing moves within the dead band",
    starts=({"deadband": 0.005}, {"deadband": 0.06}),
)  # fmt: skip

"""A valve is open at no command: its spool's null is off.

    o = s + b

of the spool's travel, before what the lands overlap by. Where a plant declares a null that is off
(`null_bias`), that is the parameter to calibrate; where it is not declared, or 0 and not
calibrated, it may be what is missing. A null of 1 to 3 % is within what data sheets permit.

Source: Merritt, Hydraulic Control Systems, Wiley 1967, section 5.5; ISO 10770-1 (null bias).
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter


def shifted_opening(opening: float, bias: float) -> float:
    """Return how far the lands are open, as a share of the travel."""
    return opening + bias


EFFECT = Effect(
    id="valve_null_bias",
    summary="At no command the valve is open: its null is off.",
    parameters=(
        Parameter("bias", "", 0.01, -0.5, 0.5, "b", "share of the spool's travel"),
    ),
    actions={
        "valve": Action({"opening": shifted_opening}, Equation.ACTUATION, same_as="null_bias")
    },
    # before what the lands overlap by
    order=-1,
    source="Merritt, Hydraulic Control Systems, Wiley 1967, section 5.5",
    separate="hold the command at zero: what creeps one way, and reverses at another command?",
)  # fmt: skip

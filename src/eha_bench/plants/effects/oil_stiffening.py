"""Oil becomes stiffer as the pressure rises.

    beta(p) = beta_0 + m p

with p above the atmosphere. A declared bulk modulus holds at one pressure; mineral oils have a
slope m of 9 to 13 everywhere, so 10 MPa make them 6 to 9 % stiffer. Air in the oil bends the
modulus at low pressure alone, and what is left of it at high pressure is this slope.

Source: Gholizadeh, Burton, Schoenau, Int. J. Fluid Power 12 (2011) no. 3, 5,
doi:10.1080/14399776.2011.10781033 (bulk modulus of oils, a survey); Murnaghan, PNAS 30 (1944) 244,
doi:10.1073/pnas.30.9.244.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter


def stiffer(modulus: float, pressure: float, slope: float) -> float:
    """Return the bulk modulus of oil at a chamber pressure, Pa."""
    return modulus + slope * max(pressure, 0.0)


EFFECT = Effect(
    id="oil_stiffening",
    summary="Oil becomes stiffer as the pressure rises.",
    parameters=(Parameter("slope", "", 10.0, 0.0, 100.0, "m"),),
    actions={"chamber": Action({"bulk": stiffer})},
    together=True,
    source="Gholizadeh, Burton, Schoenau, Int. J. Fluid Power 12 (2011) no. 3, 5",
    separate=(
        "small steps about a middle and about a high pressure, with the piston locked: air has "
        "gone from both, and this slope has not"
    ),
    order=-1,
)

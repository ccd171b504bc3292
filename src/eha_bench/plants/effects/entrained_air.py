"""Air bubbles in the oil make it soft at low pressure.

With the volume fraction phi of air at the reference pressure p_0, compressed with polytropic
index n while the oil is compressed with beta, the effective bulk modulus at pressure p is

    s = phi / (1 - phi) * (p_0 / p)^(1/n)         volume of air per volume of oil
    beta_e = beta (1 + s) / (1 + s beta / (n p))

Bubbles dissolve as the pressure rises (Henry's law): with `dissolution: linear`, s is multiplied by
(p_d - p) / (p_d - p_0) between p_0 and the pressure p_d at which all air is dissolved. That takes
seconds, so the modulus is that of the bubbles that are left at p.

Towards high pressure beta_e goes to beta, towards none to that of the air, n p. Pressures are taken
absolute, as logged, with `gas: absolute`; sensors mostly read gauge pressure, and with `gauge` the
atmosphere is added. With `polytropic` so it is, and n is fitted. `ambient` is added in any case.
Below a tenth of p_0 the value there is held: oil that has lost all its pressure is vapour, not gas.

Source: Murrenhoff, Grundlagen der Fluidtechnik, Shaker (IFAS mixture law); Kim,
Murrenhoff, J. Fluids Eng. 134 (2012) 021201, doi:10.1115/1.4005672.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_LINEAR = 1.0
_ABSOLUTE, _POLYTROPIC = 0.0, 2.0
_GASES = ("absolute", "gauge", "polytropic")
_ATMOSPHERE = 1.01325e5
"""Standard atmosphere, Pa (ISO 2533)."""


def effective_bulk_modulus(
    modulus: float,
    pressure: float,
    air_fraction: float,
    polytropic_index: float,
    reference_pressure: float,
    ambient: float,
    dissolution: float,
    saturation_pressure: float,
    gas: float,
) -> float:
    """Return the bulk modulus of oil with bubbles at a chamber pressure, Pa."""
    outside = ambient if gas == _ABSOLUTE else ambient + _ATMOSPHERE
    p = max(pressure + outside, 0.1 * reference_pressure)
    ratio = reference_pressure / p
    if polytropic_index != 1.0:
        ratio = ratio ** (1.0 / polytropic_index)
    air = air_fraction / (1.0 - air_fraction) * ratio
    if dissolution == _LINEAR and p > reference_pressure:
        left = (saturation_pressure - p) / max(saturation_pressure - reference_pressure, 1.0)
        air *= max(0.0, left)
    return modulus * (1.0 + air) / (1.0 + air * modulus / (polytropic_index * p))


EFFECT = Effect(
    id="entrained_air",
    summary="Air bubbles in the oil make it soft at low pressure.",
    parameters=(
        Parameter("air_fraction", "", 0.01, 0.0, 0.5, "phi"),
        Parameter(
            "polytropic_index", "", 1.0, 1.0, 1.67, "n",
            "isothermal: the bubbles are small and exchange their heat with the oil; a declared "
            "one acts with any gas, and it is fitted",
            when=("gas", ("polytropic",)),
        ),
        Parameter(
            "reference_pressure", "Pa", 1.0e5, 1e3, 1e7, "p_0",
            "the pressure at which the fraction is meant", searched=False,
        ),
        Parameter(
            "ambient", "Pa", 0.0, 0.0, 2e5, "p_atm",
            "added to the chamber pressures where they are gauge", searched=False,
        ),
        choice("dissolution", ("none", "linear"), "what pressure does to bubbles", refines=True),
        Parameter(
            "saturation_pressure", "Pa", 2e7, 1e6, 2e8, "p_d", "the pressure that dissolves all",
            when=("dissolution", ("linear",)),
        ),
        choice("gas", _GASES, "what is read, and how bubbles are compressed", refines=True),
    ),
    actions={"chamber": Action({"bulk": effective_bulk_modulus})},
    together=True,
    source="Kim, Murrenhoff, J. Fluids Eng. 134 (2012) 021201, doi:10.1115/1.4005672",
    separate=(
        "steps with the piston locked from low and from high pressure: air softens only the low "
        "ones; external leakage drains also the high ones"
    ),
    starts=(
        {"dissolution": 0.0, "gas": _POLYTROPIC, "polytropic_index": 1.2},
        *(
            {"dissolution": _LINEAR, "saturation_pressure": all_of_it, "gas": _ABSOLUTE}
            for all_of_it in (5e6, 1e7, 2e7, 4e7)
        ),
    ),
)  # fmt: skip

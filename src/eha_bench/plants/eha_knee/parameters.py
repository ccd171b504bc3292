"""Every parameter of the knee EHA with unit and source: Table 3, corrected, and the assumptions.

Table 3 of Yang et al., "Design and Experiments of Electro-Hydrostatic Actuator for Wheel-Legged
Robot with Fast Force Control Response" (2023). Misprints are corrected where the source says so;
what the paper does not give is marked `assumed` with the reason for its value.
"""

from __future__ import annotations

import math
from typing import Final

from eha_bench.plants.parameter import Parameter

_TABLE: Final = "Table 3"
_INF: Final = math.inf

PARAMETERS: Final = (
    Parameter("torque_constant", "N*m/A", 0.13, 1e-6, _INF, "K_T", _TABLE),
    Parameter("rotor_inertia", "kg*m^2", 0.003, 1e-9, _INF, "J_pm", _TABLE),
    Parameter(
        "viscous_torque", "N*m*s/rad", 0.00498, 0.0, _INF, "B_pm", "Table 3; per rad/s, see Eq. (2)"
    ),
    Parameter("coulomb_torque", "N*m", 0.16, 0.0, _INF, "T_cf", _TABLE),
    Parameter("static_torque", "N*m", 0.2537, 0.0, _INF, "T_sf", _TABLE),
    Parameter(
        "stribeck_speed",
        "rad/s",
        18.0,
        1e-6,
        _INF,
        "omega_s",
        "not in the paper; the response times of Section 5.1 are met with it",
        assumed=True,
    ),
    Parameter("leakage", "m^3/(s*Pa)", 2.0084e-15, 0.0, _INF, "L_in", _TABLE),
    Parameter(
        "pump_displacement",
        "m^3/rad",
        0.69e-6 / (2 * math.pi),
        1e-12,
        _INF,
        "D_p",
        "Table 3, 0.69 cm^3 a revolution; per radian in Eq. (2)-(5)",
    ),
    Parameter("bulk_modulus", "Pa", 900e6, 1e3, _INF, "beta", _TABLE),
    Parameter("volume_a", "m^3", 1.2535e-5, 1e-9, _INF, "V_10", _TABLE),
    Parameter("volume_b", "m^3", 1.2535e-5, 1e-9, _INF, "V_20", _TABLE),
    Parameter(
        "piston_area_a",
        "m^2",
        3.1337e-4,
        1e-9,
        _INF,
        "A",
        "Table 3 prints e-5; 9400 N / 30 MPa and V_10 = A * 40 mm need e-4",
    ),
    Parameter("piston_area_b", "m^2", 3.1337e-4, 1e-9, _INF, "A", "as piston_area_a: symmetrical"),
    Parameter(
        "load_mass",
        "kg",
        60.0,
        1e-3,
        _INF,
        "M",
        "not in the paper; one leg's share of a robot above 200 kg",
        assumed=True,
    ),
    Parameter(
        "rod_viscous",
        "N*s/m",
        800.0,
        0.0,
        _INF,
        "B_a",
        "not in the paper; 8 % of the rated force at full speed",
        assumed=True,
    ),
    Parameter(
        "rod_coulomb",
        "N",
        60.0,
        0.0,
        _INF,
        "f_a",
        "not in the paper; two lip seals at low pressure",
        assumed=True,
    ),
    Parameter(
        "external_force",
        "N",
        0.0,
        -_INF,
        _INF,
        "F_e",
        "not in the paper; the leg hangs free",
        assumed=True,
    ),
    Parameter(
        "current_limit",
        "A",
        46.0,
        1e-3,
        _INF,
        "",
        "not in the paper; the response times of Section 5.1 are met with it",
        assumed=True,
    ),
    Parameter(
        "bypass_conductance",
        "m^3/(s*Pa)",
        6e-10,
        0.0,
        _INF,
        "",
        "not in the paper; 0.2 MPa at full pump flow through the solenoid valve",
        assumed=True,
    ),
    Parameter("link_a", "m", 0.3208, 1e-6, _INF, "a", _TABLE),
    Parameter("link_b", "m", 0.0462, 1e-6, _INF, "b", _TABLE),
    Parameter("link_c0", "m", 0.280, 1e-6, _INF, "c_0", _TABLE),
    Parameter(
        "initial_pressure",
        "Pa",
        0.0,
        0.0,
        _INF,
        "",
        "pressure of both chambers at rest; the paper starts from none",
        assumed=True,
    ),
    Parameter(
        "rod_creep_speed",
        "m/s",
        0.0,
        0.0,
        1.0,
        "v_0",
        "not in the paper; 0: the rod's friction sticks; else it is f_a tanh(v / v_0) and creeps",
        assumed=True,
    ),
    Parameter(
        "pump_creep_speed",
        "rad/s",
        0.0,
        0.0,
        10.0,
        "omega_0",
        "not in the paper; 0: the pump's friction sticks; else it goes with tanh(w / w_0)",
        assumed=True,
    ),
)

SIGNALS: Final = ("measured_force", "oil_temperature", "demanded_current")
"""What effects may look at by name beside the state: external force that is logged (N), oil
temperature (K, NaN where it is not logged), command after the current limit (A)."""

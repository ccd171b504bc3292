"""Every parameter of the linear drive with unit and source: the published model of EMPS."""

from __future__ import annotations

import math
from typing import Final

from eha_bench.plants.parameter import Parameter

_EMPS: Final = "Janot, Gautier, Brunot, Workshop on Nonlinear System Identification Benchmarks 2019"
_INF: Final = math.inf

PARAMETERS: Final = (
    Parameter("force_constant", "N/V", 35.15065188248547, 1e-6, _INF, "g_tau", _EMPS),
    Parameter("mass", "kg", 95.11, 1e-6, _INF, "M", _EMPS),
    Parameter("viscous_friction", "N*s/m", 203.5, 0.0, _INF, "F_v", _EMPS),
    Parameter(
        "coulomb_friction", "N", 0.0, 0.0, _INF, "F_c", "declared where it is; EMPS: 20.39 N"
    ),
    Parameter(
        "force_offset", "N", 0.0, -_INF, _INF, "off", "declared where it is; EMPS: -3.16 N"
    ),
    Parameter("position_gain", "1/s", 160.18, 0.0, _INF, "k_p", _EMPS),
    Parameter("velocity_gain", "V*s/m", 243.45, 0.0, _INF, "k_v", _EMPS),
    Parameter("control_period", "s", 1e-3, 1e-6, 1.0, "", _EMPS),
    Parameter(
        "voltage_limit", "V", 1e3, 1e-3, _INF, "",
        "not published; none that the measurements reach", assumed=True,
    ),
    Parameter(
        "creep_speed", "m/s", 0.0, 0.0, 1.0, "v_0",
        "not published; 0: dry friction sticks; else it is F_c tanh(v / v_0) and creeps",
        assumed=True,
    ),
)  # fmt: skip

SIGNALS: Final = ("demanded_voltage",)
"""What effects may look at by name beside the state: command after the voltage limit (V)."""

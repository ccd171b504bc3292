"""The pump holding a pressure at standstill: Eq. (21) of the paper, one operating point a sample.

    K_T I = D_p (P1 - P2) + T_h

T_h is the friction, as printed the static one and always against the motor; which way it acts at
rest is what `friction_direction` is about.

Source: Yang et al., Design and Experiments of Electro-Hydrostatic Actuator for Wheel-Legged Robot
with Fast Force Control Response (2023), Eq. (21) and Table 3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.effect import Equation, Hook, Spot, bind_effects, registered_effects
from eha_bench.plants.layout import Layout
from eha_bench.plants.parameter import Parameter
from eha_bench.plants.static_plant import StaticPlant

_TABLE: Final = "Table 3"
PARAMETERS: Final = (
    Parameter("torque_constant", "N*m/A", 0.13, 1e-6, math.inf, "K_T", _TABLE),
    Parameter("coulomb_torque", "N*m", 0.16, 0.0, math.inf, "T_cf", _TABLE),
    Parameter("static_torque", "N*m", 0.2537, 0.0, math.inf, "T_sf", _TABLE),
    Parameter(
        "pump_displacement", "m^3/rad", 0.69e-6 / (2 * math.pi), 1e-12, math.inf, "D_p",
        "Table 3, 0.69 cm^3 a revolution; per radian in Eq. (2)-(5)",
    ),
)  # fmt: skip
_HOOKS: Final = ("true_difference", "pump_dry", "holding_friction", "measured_current")


class PumpHold(StaticPlant):
    """The current that holds a pressure difference at standstill."""

    id = "pump_hold"
    inputs = ("pressure_difference",)
    outputs = ("current",)
    balance = Equation.TORQUE

    def __init__(self) -> None:
        spot = Spot("pump", Equation.TORQUE, {name: (Hook(name),) for name in _HOOKS})
        effects = bind_effects(registered_effects(), {"holding": (spot,)})
        self.layout = Layout(self.id, PARAMETERS, effects)

    def respond(self, vector: FloatArray, inputs: Mapping[str, FloatArray]) -> FloatArray:
        """Return the holding current, (n, 1) A, at pressure differences in Pa."""
        at = {item.name: float(vector[self.layout.index[item.name]]) for item in PARAMETERS}
        scope: dict[str, Any] = {**at, "difference": np.asarray(inputs["pressure_difference"])}
        self.apply_effects("true_difference", vector, "difference", scope)
        difference = scope["difference"]
        scope["pump_load"] = at["pump_displacement"] * np.abs(difference)
        scope["level"] = np.full_like(difference, at["static_torque"])
        self.apply_effects("pump_dry", vector, "level", scope)
        scope["friction"] = scope["level"]
        self.apply_effects("holding_friction", vector, "friction", scope)
        torque = at["pump_displacement"] * difference + scope["friction"]
        scope["value"] = torque / at["torque_constant"]
        self.apply_effects("measured_current", vector, "value", scope)
        current: FloatArray = scope["value"]
        return current.reshape(-1, 1)

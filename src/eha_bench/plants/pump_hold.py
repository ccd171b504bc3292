"""The pump holding a pressure at standstill: Eq. (21) of the paper, one operating point a sample.

    K_T I = D_p (P1 - P2) + T_h

T_h is the friction, as printed the static one and always against the motor; which way it acts at
rest is what `friction_direction` is about.

Source: Yang et al., Design and Experiments of Electro-Hydrostatic Actuator for Wheel-Legged Robot
with Fast Force Control Response (2023), Eq. (21) and Table 3.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from eha_bench.plants.effect import Equation
from eha_bench.plants.eha_knee.parameters import PARAMETERS as KNEE
from eha_bench.plants.layout import Layout
from eha_bench.plants.plant import effects_of
from eha_bench.plants.static_plant import StaticPlant

FloatArray = NDArray[np.float64]

_OWN: Final = (
    "torque_constant",
    "static_torque",
    "coulomb_torque",
    "pump_displacement",
)
PARAMETERS: Final = tuple(parameter for parameter in KNEE if parameter.name in _OWN)
HOOKS: Final = ("true_difference", "pump_dry", "holding_friction", "measured_current")


class PumpHold(StaticPlant):
    """The current that holds a pressure difference at standstill."""

    id = "pump_hold"
    inputs = ("pressure_difference",)
    outputs = ("current",)
    balance = Equation.TORQUE

    def __init__(self) -> None:
        self.layout = Layout(self.id, PARAMETERS, effects_of(self.id), HOOKS)

    def respond(self, vector: FloatArray, inputs: Mapping[str, FloatArray]) -> FloatArray:
        """Return the holding current, (n, 1) A, at pressure differences in Pa."""
        at = {item.name: float(vector[self.layout.index[item.name]]) for item in PARAMETERS}
        scope: dict[str, Any] = {**at, "difference": np.asarray(inputs["pressure_difference"])}
        self.chained("true_difference", vector, "difference", scope)
        difference = scope["difference"]
        scope |= {"p_a": difference, "p_b": np.zeros_like(difference)}
        scope["level"] = np.full_like(difference, at["static_torque"])
        self.chained("pump_dry", vector, "level", scope)
        scope["friction"] = scope["level"]
        self.chained("holding_friction", vector, "friction", scope)
        torque = at["pump_displacement"] * difference + scope["friction"]
        scope["value"] = torque / at["torque_constant"]
        self.chained("measured_current", vector, "value", scope)
        current: FloatArray = scope["value"]
        return current.reshape(-1, 1)

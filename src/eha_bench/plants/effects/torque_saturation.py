"""The motor's iron saturates: at high current the torque levels off.

    T = K_T i / (1 + |s i|^n)^(1/n)

For small currents T = K_T i; for large ones T goes to K_T / s. n says how sharp the knee is: 1 is
Froelich's curve, 2 a root, many a clipping.

Source: Froelich's equation as in Fitzgerald, Kingsley, Umans, Electric Machinery, 6th ed.,
McGraw-Hill 2003.
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter


def saturated_torque(torque: float, current: float, saturation: float, sharpness: float) -> float:
    """Return the motor's torque with saturated iron, N*m."""
    ratio = abs(saturation * current)
    return torque * math.pow(1.0 + math.pow(ratio, sharpness), -1.0 / sharpness)


EFFECT = Effect(
    id="torque_saturation",
    summary="At high current the motor's torque levels off.",
    parameters=(
        Parameter(
            "saturation", "{per_current}", 0.69, 0.0, 1e3, "s",
            "inverse of the current at which the unsaturated torque would be the final one",
        ),
        Parameter("sharpness", "", 2.0, 1.0, 20.0, "n"),
    ),
    actions={"motor": Action({"torque": saturated_torque})},
    source="Fitzgerald, Kingsley, Umans, Electric Machinery, 6th ed., 2003",
    separate="hold high loads: torque per ampere falls with the current",
    starts=({"saturation": 0.46, "sharpness": 1.0}, {"saturation": 0.92, "sharpness": 4.0}),
)  # fmt: skip

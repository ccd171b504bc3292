"""Where a curve or a free input may act, and the vector of parameters with one on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eha_bench.diagnosis.data.gate import Measured
from eha_bench.diagnosis.fit.candidates import LEARNED
from eha_bench.plants.plant import Plant

FloatArray = NDArray[np.float64]

MEASUREMENT = "measurement"
_SENSORS = (
    "current",
    "motor_speed",
    "pressure_a",
    "pressure_b",
    "piston_position",
    "piston_velocity",
)


@dataclass(frozen=True)
class Place:
    """One place where something may act, and the variables that it may follow there.

    Attributes:
        equation, form, at: as the effect `learned` has them.
        variables: names of what a curve there may depend on.
    """

    equation: str
    form: str
    at: str
    variables: tuple[str, ...]

    @property
    def sensors(self) -> tuple[str, ...]:
        """Channels that it changes without changing what goes on; none for a balance."""
        if self.equation != MEASUREMENT:
            return ()
        return ("pressure_a", "pressure_b") if self.at == "pressures" else (self.at,)


@dataclass(frozen=True)
class Template:
    """One place where a curve may act, and the variable it may depend on."""

    equation: str
    form: str
    place: str
    variable: str


PLACES = (
    # nobody but the drive knows the time and the command; a torque that follows speed or pressure
    # is the machine's
    Place("actuation", "gain", "motor", ("time", "current")),
    Place("actuation", "additive", "motor", ("time", "current")),
    Place("actuation", "additive", "drive", ("time", "current_command")),
    Place("torque", "additive", "motor", ("motor_speed", "pressure_difference", "pressure_sum")),
    Place("torque", "friction", "motor", ("motor_speed", "pressure_difference", "pressure_sum")),
    Place("flow", "additive", "a_to_b", ("time", "pressure_difference", "motor_speed")),
    Place("flow", "additive", "chamber_a", ("time", "pressure_a")),
    Place("flow", "additive", "chamber_b", ("time", "pressure_b")),
    Place("flow", "gain", "a_to_b", ("time", "motor_speed", "pressure_difference")),
    Place("force", "additive", "motor", ("time", "piston_position", "piston_velocity")),
    Place("force", "friction", "motor", ("time", "piston_position", "pressure_sum")),
    *(
        Place(MEASUREMENT, form, at, ("time", at))
        for at in _SENSORS
        for form in ("additive", "gain")
    ),
    # sensors of one kind share supply, amplifier and oil
    Place(MEASUREMENT, "gain", "pressures", ("time", "pressure_sum")),
    Place(MEASUREMENT, "additive", "pressures", ("time", "pressure_sum")),
)  # fmt: skip


def variables_of(measured: Measured) -> dict[str, FloatArray]:
    """Return what a curve may depend on, by name, (n,), as measured (NaN where not)."""
    found: dict[str, FloatArray] = {"time": measured.time}
    for name in (*measured.inputs, *measured.outputs):
        column = measured.inputs.get(name)
        if column is None:
            column = measured.column(name)
        if column is not None:
            found[name] = column
    if "pressure_a" in found and "pressure_b" in found:
        found["pressure_difference"] = found["pressure_a"] - found["pressure_b"]
        found["pressure_sum"] = found["pressure_a"] + found["pressure_b"]
    if measured.shaft_angle is not None:
        found["shaft_angle"] = measured.shaft_angle
    return found


def curve_on(
    plant: Plant,
    vector: FloatArray,
    template: Template,
    low: float,
    high: float,
    values: FloatArray,
    period: float = 0.0,
) -> FloatArray:
    """Return a vector with the effect `learned` on, as a template says."""
    layout = plant.layout
    effect = layout.effect(LEARNED)
    out = vector.copy()

    def put(name: str, number: float) -> None:
        out[layout.index[f"{LEARNED}.{name}"]] = number

    put("scale", 1.0)
    for name in ("equation", "form", "variable", "place"):
        put(name, effect.parameter(name).encode(getattr(template, name)))
    put("period", period)
    put("low", low)
    put("high", high)
    at = layout.index[f"{LEARNED}.values"]
    out[at : at + values.size] = values
    return out


def usual_size(
    place: Place,
    plant: Plant,
    vector: FloatArray,
    noise: Mapping[str, float],
    span: Mapping[str, tuple[float, float]],
) -> float:
    """Return a small curve at a place, SI: a few percent of what is usual in that balance.

    Args:
        place: where. plant, vector: the model. noise: of the sensors, SI.
        span: variable -> lowest and highest value, SI.
    """
    if place.form == "gain":
        return 0.02
    index = plant.layout.index

    def value(name: str, default: float) -> float:
        return float(vector[index[name]]) if name in index else default

    def largest(*names: str) -> float:
        low, high = next((span[name] for name in names if name in span), (0.0, 1.0))
        return max(abs(low), abs(high))

    if place.equation == MEASUREMENT:
        return 2.0 * noise[place.sensors[0]]
    if place.equation == "actuation":
        return 0.01 * largest("current_command", "voltage")
    if place.equation == "torque":
        return 0.01 * value("torque_constant", 1.0) * largest("current", "current_command")
    if place.equation == "flow":
        return 0.01 * value("pump_displacement", 1e-7) * largest("motor_speed")
    return 0.1 * max(value("rod_coulomb", 10.0), 1.0)

"""Where a curve or a free input may act in a plant, and the vector of parameters with one on.

The places are those of the plant's own effect `learned`: whatever moves, every motor, drive, pump,
volume, pair of chambers and sensor. What something may follow at a place is what that part of a
machine can know: mechanics and oil do not know the time, nor what was asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.fit.candidates import LEARNED
from eha_bench.plants.effect import AT, Equation
from eha_bench.plants.plant import Plant


@dataclass(frozen=True)
class SuspectPlace:
    """One place where something may act, and the variables that it may follow there.

    Attributes:
        equation: the balance. form, at: as the effect `learned` has them.
        variables: names of what a curve there may depend on.
        sensors: channels that it changes without changing what goes on; none for a balance.
    """

    equation: str
    form: str
    at: str
    variables: tuple[str, ...]
    sensors: tuple[str, ...] = ()


@dataclass(frozen=True)
class Template:
    """One place where a curve may act, and the variable it may depend on."""

    equation: str
    form: str
    place: str
    variable: str


def places_of(plant: Plant) -> tuple[SuspectPlace, ...]:
    """Return every place where something may act in a plant, form by form."""
    if LEARNED not in {effect.id for effect in plant.layout.effects}:
        return ()
    return tuple(
        SuspectPlace(spot.equation.value, form, spot.name, variables, spot.sensors)
        for spot in plant.layout.effect(LEARNED).spots
        for form, variables in spot.follows.items()
    )


def variables_of(measured: Measured) -> dict[str, FloatArray]:
    """Return what a curve may depend on, by name, (n,), as measured (NaN where not).

    A rate that nothing reads is the slope of its position here; in a simulation the curve follows
    the state.
    """
    found: dict[str, FloatArray] = {"time": measured.time}
    for name in (*measured.inputs, *measured.outputs):
        column = measured.inputs.get(name)
        if column is None:
            column = measured.column(name)
        if column is not None:
            found[name] = column
    for name, slope in measured.slopes.items():
        found.setdefault(name, slope.values)
    pair = measured.roles.facing
    if pair and all(name in found for name in pair):
        found["pressure_difference"] = found[pair[0]] - found[pair[1]]
        found["pressure_sum"] = found[pair[0]] + found[pair[1]]
    if measured.turning is not None and measured.shaft_angle is not None:
        found[measured.turning.angle] = measured.shaft_angle
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
    put("form", effect.parameter("form").encode(template.form))
    put("variable", effect.parameter("variable").encode(template.variable))
    if len(effect.places) > 1:
        put(AT, effect.parameter(AT).encode(template.place))
    put("period", period)
    put("low", low)
    put("high", high)
    at = layout.index[f"{LEARNED}.values"]
    out[at : at + values.size] = values
    return out


def usual_size(
    place: SuspectPlace,
    plant: Plant,
    noise: Mapping[str, float],
    span: Mapping[str, tuple[float, float]],
) -> float:
    """Return a small curve at a place, SI: a few percent of what is usual in that balance.

    Args:
        place: where. plant: the model's. noise: of the sensors, SI.
        span: variable -> lowest and highest value, SI.
    """
    if place.form == "gain":
        return 0.02
    if place.sensors:
        return 2.0 * noise[place.sensors[0]]
    spot = next(s for s in plant.layout.effect(LEARNED).spots if s.name == place.at)
    roles = plant.roles
    if place.equation == Equation.ACTUATION.value:
        asked = [*roles.acting.values(), *roles.commands]
        largest = [max(abs(end) for end in span[name]) for name in asked if name in span]
        return 0.01 * max(largest, default=0.0) or 0.01
    return spot.usual.get("size", 1.0)

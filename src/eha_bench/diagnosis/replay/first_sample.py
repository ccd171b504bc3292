"""The state at which a whole run begins, from what its sensors read first.

A diagnosis begins where readings begin that may be believed (`first_state`). A prediction begins
at the first sample as it was logged (`first_sample`): that a channel stands still for a while, or
has no other reading, says nothing against its first one. One that never changes while others do is
dead, and tells nothing. What no reading tells is assumed, and said.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eha_bench.core.channels import unit_of
from eha_bench.diagnosis.data.gate import Measured
from eha_bench.diagnosis.data.noise import noise_of
from eha_bench.plants.model import Model

_SPEEDS = ("motor_speed", "piston_velocity")
_PRESSURES = ("pressure_a", "pressure_b")
_LOCKED = ("piston_position", "piston_velocity")


@dataclass(frozen=True)
class FirstSample:
    """Where a prediction begins.

    Attributes:
        state: channel -> what its sensor reads first, SI; the plant takes the rest as at rest.
        notes: what was taken for the start and is not simply the first sample, and what no reading
            tells and was assumed, one sentence each.
    """

    state: Mapping[str, float]
    notes: tuple[str, ...]


def first_state(measured: Measured, model: Model) -> dict[str, float]:
    """Return the state at the first reading of each channel that may be believed.

    One sample carries its sensor's noise. Where it cannot be told from rest (speeds of nothing,
    both pressures at the charge pressure that the model declares), rest is taken.
    """
    readings = {}
    for name in measured.outputs:
        column = measured.column(name)
        if column is not None:
            readings[name] = float(column[np.flatnonzero(np.isfinite(column))[0]])
    return _state(measured, model, readings)


def first_sample(measured: Measured, model: Model) -> FirstSample:
    """Return where a prediction begins: as `first_state`, from the first sample as it was logged.

    A position without a sensor is that of the joint's angle, a pressure that of the other and of
    their difference, where these were read.
    """
    plant = model.plant
    determined = plant.determined(tuple(measured.inputs))
    needed = [n for n in plant.states if n in determined and n not in measured.inputs]
    locked = measured.run.locked
    first = _trusted(measured)
    readings, notes = {}, []
    for name in needed:
        if name not in first or (locked and name in _LOCKED):
            continue
        readings[name] = first[name]
        notes += _about(measured, name)
    told = {*readings, *(measured.held if locked else ())}
    if locked:
        told.add("piston_velocity")
    behind = plant.behind(model.vector(), first)
    for name in needed:
        if name in behind and name not in told:
            readings[name] = behind[name]
            told.add(name)
            notes.append(f"no '{name}' in the log: it begins at {_amount(name, behind[name])}, "
                         "where other channels have it")  # fmt: skip
    if all(name in needed and name not in told for name in _PRESSURES):
        difference = first.get("pressure_difference")
        if difference is not None:
            rest = _rest_pressure(model)
            readings["pressure_a"] = rest + max(difference, 0.0)
            readings["pressure_b"] = rest + max(-difference, 0.0)
            told |= {*_PRESSURES}
            notes.append(
                "neither chamber's pressure is in the log: they begin with the difference that was "
                f"measured, the lower one at {_amount('pressure_a', rest)}, which is assumed"
            )
    state = _state(measured, model, readings)
    assumed = [_assumed(name, state, model) for name in needed if name not in told]
    if assumed:
        notes.append(f"the log does not say where all states begin; assumed: {', '.join(assumed)}")
    return FirstSample(state, tuple(f"{measured.run.name}: {note}" for note in notes))


def _trusted(measured: Measured) -> dict[str, float]:
    """Return the first readings, without those of channels that are dead."""
    dead = {n for n, item in measured.first.items() if item.frozen and measured.outputs}
    if dead.intersection(_PRESSURES):
        # it may have been derived from both
        dead.add("pressure_difference")
    return {n: item.value for n, item in measured.first.items() if n not in dead}


def _assumed(name: str, state: Mapping[str, float], model: Model) -> str:
    """Say at what a state begins that no reading tells."""
    rest = _rest_pressure(model) if name in _PRESSURES else 0.0
    value = {name: rest, **model.plant.at_rest(state), **state}[name]
    return f"{name} at {_amount(name, value)}"


def _about(measured: Measured, name: str) -> list[str]:
    """Say of a reading that it is late, or from a channel that is not believed there."""
    first = measured.first[name]
    amount = _amount(name, first.value)
    if first.tick > 0:
        return [
            f"the first sample has no '{name}': it begins at its first reading, {amount} at "
            f"{measured.time[first.tick]:.6g} s"
        ]
    column = measured.column(name)
    if column is None or not np.isfinite(column[0]):
        return [f"'{name}' begins at what it reads first, {amount}, all the same"]
    return []


def _amount(name: str, value: float) -> str:
    return f"{value:.6g} {unit_of(name)}".rstrip()


def _state(measured: Measured, model: Model, readings: Mapping[str, float]) -> dict[str, float]:
    """Return the state behind first readings, at rest where noise cannot be told from it."""
    state: dict[str, float] = {}
    if not model.plant.states:
        return state
    noise = {name: noise_of(column) for name in measured.outputs
             if (column := measured.column(name)) is not None}  # fmt: skip
    for name, value in readings.items():
        at_rest = name in _SPEEDS and abs(value) < 4.0 * noise.get(name, 0.0)
        state[name] = 0.0 if at_rest else value
    charge = _charge_pressure(model)
    if all(name in state for name in _PRESSURES):
        sigma = max(noise.get(name, 0.0) for name in _PRESSURES)
        charged = charge is not None and all(
            abs(state[name] - charge) < 4.0 * sigma for name in _PRESSURES
        )
        if charge is not None and charged:
            state["pressure_a"] = state["pressure_b"] = charge
        elif abs(state["pressure_a"] - state["pressure_b"]) < 4.0 * sigma:
            middle = 0.5 * (state["pressure_a"] + state["pressure_b"])
            state["pressure_a"] = state["pressure_b"] = middle
    elif charge is not None:
        for name in _PRESSURES:
            state.setdefault(name, charge)
    if "current" in state and abs(state["current"]) < 4.0 * noise.get("current", 0.0):
        state["current"] = 0.0
    if "piston_position" not in state and measured.run.locked:
        state["piston_position"] = measured.held.get("piston_position", 0.0)
    if measured.run.locked:
        state["piston_velocity"] = 0.0
    if measured.start.is_estimated:
        state["shaft_angle"] = measured.start.value
    return state


def _charge_pressure(model: Model) -> float | None:
    for effect in model.effects:
        if effect.id == "anti_cavitation":
            parameter = model.plant.layout.effect(effect.id).parameter("charge_pressure")
            # a quantity's value and default are numbers; only a choice's are text
            return float(effect.values.get("charge_pressure", parameter.default))  # type: ignore[arg-type]
    return None


def _rest_pressure(model: Model) -> float:
    """Return the pressure of both chambers at rest: what they are charged to, or declared to be."""
    charge = _charge_pressure(model)
    if charge is not None:
        return charge
    known = "initial_pressure" in model.plant.layout.index
    return model.value("initial_pressure") if known else 0.0

"""The state at which a whole run begins, from what its sensors read first.

A diagnosis begins where readings begin that may be believed (`first_state`). A prediction begins
at the first sample as it was logged (`first_sample`): that a channel stands still for a while, or
has no other reading, says nothing against its first one. One that never changes while others do is
dead, and tells nothing. What no reading tells is assumed, and noted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eha_bench.core.note import of_run
from eha_bench.diagnosis.data.first_rates import first_rates
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.noise import noise_of
from eha_bench.plants.model import Model
from eha_bench.plants.plant import Plant


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

    One sample carries its sensor's noise. Where it cannot be distinguished from rest (speeds of
    zero, both pressures at the charge pressure that the model declares), rest is taken.
    """
    readings = {}
    for name in measured.outputs:
        column = measured.column(name)
        if column is not None:
            readings[name] = float(column[np.flatnonzero(np.isfinite(column))[0]])
    return _state(measured, model, readings)


def first_sample(measured: Measured, model: Model) -> FirstSample:
    """Return where a prediction begins: as `first_state`, from the first sample as it was logged.

    Where these were read, a position without a sensor is that of the joint's angle, a pressure that
    of the other and of their difference, a speed that behind a gear.
    """
    plant = model.plant
    roles = plant.roles
    determined = plant.determined(tuple(measured.inputs))
    needed = [n for n in plant.states if n in determined and n not in measured.inputs]
    locked = measured.run.locked
    first = _rested(_trusted_readings(measured), measured)
    readings, notes = {}, []
    for name in needed:
        if name not in first or (locked and name in roles.locked):
            continue
        readings[name] = first[name]
        notes += _about(measured, name, plant)
    known = {*readings, *(measured.held if locked else ())}
    if locked:
        known |= {name for name in roles.locked if name in roles.rates}
    behind = plant.behind(model.vector(), first)
    for name in needed:
        if name in behind and name not in known:
            readings[name] = behind[name]
            known.add(name)
            value = _amount(name, behind[name], plant)
            notes.append(f"no '{name}' in the log: it starts at {value}, from other channels")
    if roles.pair and all(name in needed and name not in known for name in roles.pair):
        difference = first.get("pressure_difference")
        if difference is not None:
            rest = _rest_pressure(model)
            readings[roles.pair[0]] = rest + max(difference, 0.0)
            readings[roles.pair[1]] = rest + max(-difference, 0.0)
            known |= {*roles.pair}
            notes.append(
                "neither chamber's pressure is in the log: they start with the measured "
                f"difference, the lower one at {_amount(roles.pair[0], rest, plant)}, "
                "which is assumed"
            )
    geared = {name: first[name] for name in roles.geared if name in first and name in determined}
    state = _state(measured, model, {**readings, **geared})
    for name in plant.through_parts(model.vector(), {**readings, **geared}):
        if name not in {*needed, *measured.inputs} and (begins := state[name]) != 0.0:
            amount = _amount(name, begins, plant)
            notes.append(f"no '{name}' in the log: it starts at {amount}, from other channels")
    for name in first_rates(measured):
        if name not in known:
            known.add(name)
            amount = _amount(name, state[name], plant)
            notes.append(f"no '{name}' in the log: it starts at {amount}, as its position moves")
    assumed = [_assumption(name, state, model) for name in needed if name not in known]
    if assumed:
        notes.append(
            f"the log does not hold the start values of all states; assumed: {', '.join(assumed)}"
        )
    return FirstSample(state, tuple(of_run(measured.run.name, note) for note in notes))


def _trusted_readings(measured: Measured) -> dict[str, float]:
    """Return the first readings, without those of channels that are dead."""
    dead = {n for n, item in measured.first.items() if item.frozen and measured.outputs}
    if dead.intersection(measured.roles.pair):
        # it may have been derived from both
        dead.add("pressure_difference")
    return {n: item.value for n, item in measured.first.items() if n not in dead}


def _rested(readings: Mapping[str, float], measured: Measured) -> dict[str, float]:
    """Return readings with zero for rates that differ from it by noise only."""
    found = dict(readings)
    for name in measured.roles.rates:
        column = measured.column(name)
        if name in found and column is not None and abs(found[name]) < 4.0 * noise_of(column):
            found[name] = 0.0
    return found


def _assumption(name: str, state: Mapping[str, float], model: Model) -> str:
    """Say at what a state begins that no reading tells."""
    plant = model.plant
    rest = {**dict.fromkeys(plant.states, 0.0), **plant.rest(model.vector())}
    if (charge := _charge_pressure(model)) is not None:
        rest |= dict.fromkeys(plant.roles.pair, charge)
    value = {**rest, **plant.at_rest(state), **state}[name]
    return f"{name} at {_amount(name, value, plant)}"


def _about(measured: Measured, name: str, plant: Plant) -> list[str]:
    """Say of a reading that it is late, or from a channel that is not believed there."""
    first = measured.first[name]
    amount = _amount(name, first.value, plant)
    if first.tick > 0:
        return [
            f"the first sample has no '{name}': it starts at its first reading, {amount} at "
            f"{measured.time[first.tick]:.6g} s"
        ]
    column = measured.column(name)
    if column is None or not np.isfinite(column[0]):
        return [f"'{name}' starts at its first reading, {amount}, anyway"]
    return []


def _amount(name: str, value: float, plant: Plant) -> str:
    return f"{value:.6g} {plant.units.get(name, '')}".rstrip()


def _state(measured: Measured, model: Model, readings: Mapping[str, float]) -> dict[str, float]:
    """Return the state behind first readings; rest where they differ from it by noise only."""
    if not model.plant.states:
        return {}
    noise = {name: noise_of(column) for name in measured.outputs
             if (column := measured.column(name)) is not None}  # fmt: skip
    roles = model.plant.roles
    readings = _rested(readings, measured)
    state = {**model.plant.through_parts(model.vector(), readings), **readings}
    for name, rate in first_rates(measured).items():
        state.setdefault(name, rate.value)
    _at_charge(state, roles.pair, noise, _charge_pressure(model))
    for name in roles.acting:
        if name in state and abs(state[name]) < 4.0 * noise.get(name, 0.0):
            state[name] = 0.0
    if measured.run.locked:
        held = measured.held
        held = {**model.plant.through_parts(model.vector(), held), **held}
        for name in roles.locked:
            if name in roles.rate_of:
                state.setdefault(name, held.get(name, 0.0))
            elif name in roles.rates:
                state[name] = 0.0
    if measured.start.is_estimated and measured.turning is not None:
        state[measured.turning.angle] = measured.start.value
    return state


def _at_charge(
    state: dict[str, float],
    pair: tuple[str, ...],
    noise: Mapping[str, float],
    charge: float | None,
) -> None:
    """Set both chambers to the charge pressure, or their mean, where noise hides a difference."""
    if pair and all(name in state for name in pair):
        sigma = max(noise.get(name, 0.0) for name in pair)
        charged = charge is not None and all(
            abs(state[name] - charge) < 4.0 * sigma for name in pair
        )
        if charge is not None and charged:
            state |= dict.fromkeys(pair, charge)
        elif abs(state[pair[0]] - state[pair[1]]) < 4.0 * sigma:
            state |= dict.fromkeys(pair, 0.5 * (state[pair[0]] + state[pair[1]]))
    elif charge is not None:
        for name in pair:
            state.setdefault(name, charge)


def _charge_pressure(model: Model) -> float | None:
    """Return the pressure that a declared effect charges the chambers to, None where none does."""
    for declared in model.effects:
        effect = model.plant.layout.effect(declared.id)
        if effect.action.charges:
            parameter = effect.parameter(effect.action.charges)
            # a quantity's value and default are numbers; only a choice's are text
            return float(declared.values.get(parameter.name, parameter.default))  # type: ignore[arg-type]
    return None


def _rest_pressure(model: Model) -> float:
    """Return the pressure of both chambers at rest: what they are charged to, or declared to be."""
    charge = _charge_pressure(model)
    if charge is not None:
        return charge
    rest = model.plant.rest(model.vector())
    return next((rest[name] for name in model.plant.roles.pair if name in rest), 0.0)

"""What a valve was asked for before a log begins.

A spool that is moving, or a drive that lags, stands at the first sample where it was asked to be
before, and that is in no log: a script starts its motion and its log together, and what it starts
from is nobody's first row. Begun at the first command, the pressures of a healthy machine are off
by as much as that command moves them, and a whole replay says so for half a second.

A command held before is therefore estimated from how the run begins, as its start angle is. It is
taken where the first readings ask for it clearly; `predict` notes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar

from eha_bench.core.channels import unit_of
from eha_bench.core.note import Note
from eha_bench.diagnosis.data.measured import Measured, pooled_noise
from eha_bench.diagnosis.data.windows import is_given_at_first
from eha_bench.diagnosis.fit.start_state import start_of
from eha_bench.diagnosis.fit.thresholds import DEFAULT
from eha_bench.plants.model import Model

_STEP: Final = 2e-4
"""Integration step, s: only differences between two beginnings count."""
_SECONDS: Final = 0.2
"""How long a run shows where its spool began."""
_MUCH: Final = 0.5
"""Least share of the cost by which it falls, besides an effect's least gain: what is missing
elsewhere asks for a little of anything."""
_LOOKS: Final = 9
_RESOLVED: Final = 1e-3
"""Share of a command's range to which it is found."""


def with_asked_before(measured: Measured, model: Model, state: Mapping[str, float]) -> Measured:
    """Return a run with what its valves were asked for before it, where it shows that clearly.

    Args:
        measured: the run. model: what is simulated. state: channel -> first reading, SI.
    """
    names = [name for name in measured.roles.remembered if is_given_at_first(measured, name)]
    noise = pooled_noise([measured], measured.outputs) if names else {}
    read = {name: size for name, size in noise.items() if name in model.plant.outputs and size}
    for name in names if read else ():
        value = _asked_before(measured, model, state, read, name)
        if value is not None:
            measured = replace(measured, asked_before={**measured.asked_before, name: value})
    return measured


def asked_before_notes(measured: Measured, model: Model) -> tuple[Note, ...]:
    """Say what a run's valves are taken to have been asked for before it."""
    units = model.plant.units
    return tuple(
        Note(
            "{run}: what '{channel}' was before the first sample is not in the log: by how the run "
            "begins {value}",
            run=measured.run.name,
            channel=name,
            value=f"{value:.3g} {units.get(name) or unit_of(name)}".strip(),
        )
        for name, value in measured.asked_before.items()
    )


def _asked_before(
    measured: Measured,
    model: Model,
    state: Mapping[str, float],
    noise: Mapping[str, float],
    name: str,
) -> float | None:
    """Return what a command was before a run, SI; None where that shows nowhere."""
    begin = measured.beginning(_SECONDS)
    plant = model.plant
    at = plant.at(begin.run.vector(plant.layout, model.vector()))
    initial = start_of(at, begin.drive(0, begin.time.size), state)
    asked = begin.inputs[name]
    places = {channel: plant.outputs.index(channel) for channel in noise}

    def cost(value: float) -> float:
        run = replace(begin, asked_before={**begin.asked_before, name: value})
        drive = run.drive(0, run.time.size)
        values = at.simulate(drive, initial, _STEP)[drive.first :]
        total = 0.0
        for channel, place in places.items():
            column = run.column(channel)
            if column is not None:
                shown = run.at_sample_instants(channel, values[:, place], run.lateness)
                error = ((column - shown) / noise[channel])[np.isfinite(column)]
                total += float(error @ error)
        return total if np.isfinite(total) else np.inf

    most = float(np.max(np.abs(measured.inputs[name])))
    looks = np.linspace(-most, most, _LOOKS)
    costs = [cost(float(value)) for value in looks]
    best = int(np.argmin(costs))
    if not np.isfinite(costs[best]):
        return None
    found = minimize_scalar(
        cost,
        bounds=(looks[max(0, best - 1)], looks[min(_LOOKS - 1, best + 1)]),
        method="bounded",
        options={"xatol": _RESOLVED * most},
    )
    least = max(DEFAULT.gain, _MUCH * (before := cost(float(asked[0]))))
    return float(found.x) if before - float(found.fun) > least else None

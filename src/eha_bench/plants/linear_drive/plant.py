"""The linear drive as a plant: from its voltage, or from its reference in closed loop."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import InputError
from eha_bench.plants.assembly import assemble, hook_names
from eha_bench.plants.layout import Layout
from eha_bench.plants.linear_drive import equations, hooks, kernel
from eha_bench.plants.linear_drive.parameters import PARAMETERS, SIGNALS
from eha_bench.plants.plant import Drive, Plant, effects_of

FloatArray = NDArray[np.float64]

_STATE = {
    "piston_position": equations.POSITION,
    "piston_velocity": equations.VELOCITY,
    "voltage": equations.VOLTAGE,
}


@dataclass(frozen=True)
class Inputs:
    """A drive's inputs on the clock that the kernel runs on, for one control period.

    Attributes:
        period: of the controller, s. closed: whether the loop is.
        time: (m,) the clock, s. ticks: (n,) where on it the drive's samples are.
        voltage, reference, pulses: (m,) zeros where there is none.
    """

    period: float
    closed: bool
    time: FloatArray
    ticks: NDArray[np.intp]
    voltage: FloatArray
    reference: FloatArray
    pulses: FloatArray


class LinearDrive(Plant):
    """A carriage with friction, driven by a voltage, with every registered effect built in.

    Inputs: `voltage` (V, held between samples) drives it in open loop; `reference` (m) closes
    the loop with the drive's own controller, and `pulses` (V) are added to what that asks for.
    """

    id = "linear_drive"
    outputs = ("voltage", "piston_position", "piston_velocity")

    states = tuple(_STATE)

    def __init__(self) -> None:
        self.layout = Layout(self.id, PARAMETERS, effects_of(self.id), hook_names(hooks), SIGNALS)

    @cached_property
    def compiled(self) -> ModuleType:
        """The kernel with all effects, compiled on first use."""
        return assemble(self.layout, (equations, kernel), hooks)

    def start_state(self, vector: FloatArray, drive: Drive) -> FloatArray:
        """Return the state (3,) behind what the sensors read first; the rest is 0.

        Raises:
            InputError: a channel that is no state of this plant.
        """
        state = np.zeros(3)
        for name, value in drive.initial.items():
            if name not in _STATE:
                raise InputError(
                    f"'{name}' is not a state of {self.id}", hint=f"it has: {', '.join(_STATE)}"
                )
            state[_STATE[name]] = value
        read = np.array([name in drive.initial for name in _STATE])
        self.compiled.settle(read, vector, np.zeros(self.layout.memory), state)
        return state

    def simulate(self, vector: FloatArray, drive: Drive, step: float) -> FloatArray:
        """Return what the sensors would read: (n, 3) in the order of `outputs`, SI.

        Raises:
            InputError: an input or a first value that this plant does not have, or neither a
                voltage nor a reference, or both.
        """
        inputs = self._inputs(vector, drive)
        out = np.full((inputs.time.size, len(self.outputs)), np.nan)
        self.compiled.simulate(
            int(inputs.ticks[drive.first]),
            inputs.time.size - 1,
            inputs.time,
            inputs.voltage.copy(),  # written over with what is asked for
            inputs.reference,
            inputs.pulses,
            inputs.closed,
            step,
            vector,
            np.zeros(self.layout.memory),
            self.start_state(vector, drive),
            out,
        )
        return out[inputs.ticks]

    def _inputs(self, vector: FloatArray, drive: Drive) -> Inputs:
        """Return a drive's inputs as the kernel takes them, laid out once for a control period.

        Raises:
            InputError: as `simulate`.
        """
        period = float(vector[self.layout.index["control_period"]])
        kept = drive.laid_out.get(self.id)
        if not isinstance(kept, Inputs) or kept.period != period:
            kept = drive.laid_out[self.id] = self._laid_out(drive, period)
        return kept

    def _laid_out(self, drive: Drive, period: float) -> Inputs:
        unknown = set(drive.inputs) - {"voltage", "reference", "pulses"}
        if unknown:
            raise InputError(
                f"'{min(unknown)}' cannot be an input of {self.id}",
                hint="inputs may be: voltage, or reference and pulses",
            )
        closed = "reference" in drive.inputs
        if closed == ("voltage" in drive.inputs):
            raise InputError(
                f"{self.id} needs either 'voltage' (open loop) or 'reference' (closed loop)",
                hint="name one of them under inputs",
            )
        if "pulses" in drive.inputs and not closed:
            raise InputError(
                "'pulses' are part of the voltage already",
                hint="name 'reference' and 'pulses' under inputs for the closed loop",
            )
        time, ticks = _controller_clock(drive.time, period) if closed else _same(drive.time)
        voltage, reference, pulses = (
            _input(drive, name, time, ticks) for name in ("voltage", "reference", "pulses")
        )
        return Inputs(period, closed, time, ticks, voltage, reference, pulses)


def _controller_clock(time: FloatArray, period: float) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return a clock on which the controller ticks, and where on it the samples are."""
    parts = np.maximum(1, np.rint(np.diff(time) / period)).astype(np.intp)
    ticks = np.concatenate(([0], np.cumsum(parts)))
    return np.interp(np.arange(ticks[-1] + 1), ticks, time), ticks


def _input(drive: Drive, name: str, time: FloatArray, ticks: NDArray[np.intp]) -> FloatArray:
    """Return an input on the clock: a reference linear between samples, the rest held."""
    if name not in drive.inputs:
        return np.zeros(time.size)
    values = np.asarray(drive.inputs[name], dtype=np.float64)
    if name == "reference":
        return np.interp(np.arange(time.size), ticks, values)
    held = np.searchsorted(ticks, np.arange(time.size), side="right") - 1
    return np.ascontiguousarray(values[held])


def _same(time: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    return np.ascontiguousarray(time, dtype=np.float64), np.arange(time.size)

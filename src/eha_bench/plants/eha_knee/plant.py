"""The knee EHA as a plant: channels in, channels out, and a session for a running controller."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import InputError
from eha_bench.core.linkage import Linkage
from eha_bench.plants.assembly import assemble, hook_names
from eha_bench.plants.eha_knee import equations, hooks, kernel
from eha_bench.plants.eha_knee.parameters import PARAMETERS, SIGNALS
from eha_bench.plants.layout import Layout
from eha_bench.plants.plant import Drive, Parametrised, Plant, effects_of

FloatArray = NDArray[np.float64]

IMPOSED = (
    "motor_speed",
    "pressure_a",
    "pressure_b",
    "piston_position",
    "piston_velocity",
    "current",
    "shaft_angle",
)
_CURRENTS = frozenset({"current_command", "current"})
_MEASURED = ("force", "oil_temperature")
_STATE = {
    "motor_speed": equations.OMEGA,
    "pressure_a": equations.PRESSURE_A,
    "pressure_b": equations.PRESSURE_B,
    "piston_position": equations.POSITION,
    "piston_velocity": equations.VELOCITY,
    "current": equations.CURRENT,
    "shaft_angle": equations.THETA,
}


@dataclass(frozen=True)
class Inputs:
    """A drive's inputs as arrays: commands (n,), signals (n, 2), imposed (n, 7) and which are."""

    time: FloatArray
    commands: FloatArray
    signals: FloatArray
    imposed: FloatArray
    is_imposed: NDArray[np.bool_]


class EhaKnee(Plant):
    """The knee EHA of the paper, Eq. (1)-(10), with every registered effect built in."""

    id = "eha_knee"
    outputs = (
        "current",
        "motor_speed",
        "pressure_a",
        "pressure_b",
        "piston_position",
        "piston_velocity",
    )

    states = tuple(_STATE)

    def __init__(self) -> None:
        self.layout = Layout(self.id, PARAMETERS, effects_of(self.id), hook_names(hooks), SIGNALS)

    @cached_property
    def compiled(self) -> ModuleType:
        """The kernel with all effects, compiled on first use."""
        return assemble(self.layout, (equations, kernel), hooks)

    @cached_property
    def _bare(self) -> Layout:
        """The layout without any effect; its parameters are the first of every vector."""
        full = self.layout
        return Layout(full.plant, full.parameters, (), full.hooks, full.signals)

    @cached_property
    def _bare_compiled(self) -> ModuleType:
        """The kernel without effects: bit for bit what the full one computes while all are off."""
        return assemble(self._bare, (equations, kernel), hooks)

    @cached_property
    def _lockstep(self) -> ModuleType:
        """The kernel of sweeps, compiled on first use."""
        from eha_bench.plants.eha_knee import lockstep

        return assemble(self._bare, (equations, kernel, lockstep), hooks, "sweep")

    @cached_property
    def _strengths(self) -> tuple[NDArray[np.intp], FloatArray]:
        """Places of all effects' strengths, and the values at which they are off."""
        effects = self.layout.effects
        places = [self.layout.index[f"{effect.id}.{effect.strength.name}"] for effect in effects]
        return np.array(places, dtype=np.intp), np.array([effect.neutral for effect in effects])

    def kernel_for(self, vector: FloatArray) -> tuple[ModuleType, FloatArray, FloatArray]:
        """Return the fastest kernel for some parameters, and its own vectors `P` and `S`."""
        places, neutral = self._strengths
        if (vector[places] != neutral).any():
            return self.compiled, vector, np.zeros(self.layout.memory)
        return self._bare_compiled, vector[: self._bare.size], np.zeros(self._bare.memory)

    def start_state(self, vector: FloatArray, initial: Mapping[str, float]) -> FloatArray:
        """Return the state vector behind what the sensors read first; the rest is at rest.

        Raises:
            InputError: a channel that is no state of this plant.
        """
        compiled, parameters, memory = self.kernel_for(vector)
        return self.settled(initial, compiled, parameters, memory)

    def settled(
        self,
        initial: Mapping[str, float],
        compiled: ModuleType,
        parameters: FloatArray,
        memory: FloatArray,
    ) -> FloatArray:
        """Return a start state as `start_state` does, by a kernel that is known already."""
        state = np.zeros(7)
        rest = parameters[self._bare.index["initial_pressure"]]
        state[equations.PRESSURE_A] = state[equations.PRESSURE_B] = rest
        for name, value in initial.items():
            if name not in _STATE:
                raise InputError(
                    f"'{name}' is not a state of {self.id}", hint=f"it has: {', '.join(_STATE)}"
                )
            state[_STATE[name]] = value
        read = np.array([name in initial for name in IMPOSED])
        compiled.settle(read, parameters, memory, state)
        return state

    def determined(self, inputs: Collection[str]) -> tuple[str, ...]:
        """Return the outputs that these inputs determine.

        A current turns the shaft, the shaft moves the oil, and the oil the rod.
        """
        given = set(inputs)
        found = set() if _CURRENTS.isdisjoint(given) else {"current", "motor_speed"}
        if found or "motor_speed" in given:
            found |= {"motor_speed", "pressure_a", "pressure_b"}
        if found or {"pressure_a", "pressure_b"} <= given:
            found |= {"piston_position", "piston_velocity"}
        if "piston_velocity" in given:
            found.add("piston_position")
        return tuple(name for name in self.outputs if name in found)

    def at_rest(self, measured: Mapping[str, float]) -> dict[str, float]:
        """Return the pressure of a chamber without a reading: the pump's leakage evens them out."""
        pair = ("pressure_a", "pressure_b")
        read = [name for name in pair if name in measured]
        return {name: measured[read[0]] for name in pair if len(read) == 1 and name != read[0]}

    def linkage(self, vector: FloatArray) -> Linkage:
        """Return the triangle of the links and the actuator."""
        a, b, c0, volume, area = (
            float(vector[self.layout.index[name]])
            for name in ("link_a", "link_b", "link_c0", "volume_a", "piston_area_a")
        )
        return Linkage(a, b, c0, volume / area)

    def behind(self, vector: FloatArray, readings: Mapping[str, float]) -> dict[str, float]:
        """Return the position behind a joint angle, and a pressure behind the other and P1 - P2."""
        found = {}
        if "joint_angle" in readings:
            found["piston_position"] = self.linkage(vector).position_at(readings["joint_angle"])
        if "pressure_difference" in readings:
            difference = readings["pressure_difference"]
            if "pressure_a" in readings:
                found["pressure_b"] = readings["pressure_a"] - difference
            if "pressure_b" in readings:
                found["pressure_a"] = readings["pressure_b"] + difference
        return found

    def derived(
        self, vector: FloatArray, outputs: Mapping[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Return the joint's angle, NaN where the triangle does not close, (n,) rad."""
        if "piston_position" not in outputs:
            return {}
        return {"joint_angle": self.linkage(vector).angle(outputs["piston_position"])}

    def simulate(self, vector: FloatArray, drive: Drive, step: float) -> FloatArray:
        """Return what the sensors would read: (n, 6) in the order of `outputs`, SI.

        Raises:
            InputError: an input or a first value that this plant does not have.
        """
        return _Fastest(self, vector).simulate(drive, drive.initial, step)

    def at(self, vector: FloatArray) -> Parametrised:
        """Return the plant with its parameters set, for many simulations with them."""
        return _Fastest(self, vector)

    def sweep(self, vectors: FloatArray, drive: Drive, step: float) -> FloatArray:
        """Return what `simulate` does for each row of parameters: (m, n, 6), SI.

        Sets without effects and without friction that creeps go through SIMD registers several at a
        time, which differs from `simulate` by rounding only; the rest one by one.

        Raises:
            InputError: as `simulate`.
        """
        inputs = self.inputs_of(drive)
        out = np.empty((len(vectors), drive.time.size, len(self.outputs)))
        together = np.zeros(len(vectors), dtype=np.bool_)
        if not inputs.is_imposed.any():
            places, neutral = self._strengths
            creeps = [self.layout.index[name] for name in ("rod_creep_speed", "pump_creep_speed")]
            together = (vectors[:, places] == neutral).all(axis=1)
            together &= (vectors[:, creeps] <= 0.0).all(axis=1)
        for row in np.flatnonzero(~together):
            out[row] = self.simulate(vectors[row], drive, step)
        rows = np.flatnonzero(together)
        lanes = self._lockstep.LANES if rows.size else 1
        for first in range(0, rows.size, lanes):
            block = rows[first : first + lanes]
            out[block] = self._block(vectors[block], drive, inputs, step)
        return out

    def _block(self, vectors: FloatArray, drive: Drive, inputs: Inputs, step: float) -> FloatArray:
        """Return (m, n, 6) for at most as many sets as there are lanes."""
        lanes, bare = self._lockstep.LANES, self._bare
        # lanes that are left over repeat the last set
        spread = np.minimum(np.arange(lanes), len(vectors) - 1)
        parameters = np.ascontiguousarray(vectors[spread, : bare.size])
        states = np.stack([self.start_state(vectors[row], drive.initial) for row in spread])
        out = np.full((drive.time.size, len(self.outputs), lanes), np.nan)
        self._lockstep.sweep(
            drive.first, inputs.time, inputs.commands,
            np.ascontiguousarray(inputs.signals[:, equations.FORCE]),
            drive.locked, drive.bypass_open, step, parameters, states, np.zeros(bare.memory), out,
        )  # fmt: skip
        return out.transpose(2, 0, 1)[: len(vectors)]

    def inputs_of(self, drive: Drive) -> Inputs:
        """Return a drive's inputs as the kernels take them, laid out once.

        Raises:
            InputError: an input that this plant does not have.
        """
        kept = drive.laid_out.get(self.id)
        if not isinstance(kept, Inputs):
            kept = drive.laid_out[self.id] = self._laid_out(drive)
        return kept

    def _laid_out(self, drive: Drive) -> Inputs:
        n = drive.time.size
        imposed = np.zeros((n, len(IMPOSED)))
        is_imposed = np.zeros(len(IMPOSED), dtype=np.bool_)
        commands = np.zeros(n)
        signals = _signals(n)
        for name, values in drive.inputs.items():
            if name in IMPOSED:
                imposed[:, IMPOSED.index(name)] = values
                is_imposed[IMPOSED.index(name)] = True
            elif name in _MEASURED:
                signals[:, _MEASURED.index(name)] = values
            elif name == "current_command":
                commands[:] = values
            else:
                known = ", ".join(("current_command", *_MEASURED, *IMPOSED))
                raise InputError(
                    f"'{name}' cannot be an input of {self.id}", hint=f"inputs may be: {known}"
                )
        time = np.ascontiguousarray(drive.time, dtype=np.float64)
        return Inputs(time, commands, signals, imposed, is_imposed)

    def session(
        self,
        vector: FloatArray,
        time: FloatArray,
        initial: Mapping[str, float],
        *,
        locked: bool,
        bypass_open: bool,
        step: float,
    ) -> Session:
        """Return a simulation that is advanced tick by tick under a controller."""
        return Session(self, vector, time, initial, locked, bypass_open, step)


def _signals(n: int) -> FloatArray:
    """Return measured signals (n, 2) where none is logged: no force, an unknown temperature."""
    signals = np.zeros((n, len(_MEASURED)))
    signals[:, _MEASURED.index("oil_temperature")] = np.nan
    return signals


class _Fastest(Parametrised):
    """The knee with its parameters set, and the kernel that is the fastest for them."""

    plant: EhaKnee

    def __init__(self, plant: EhaKnee, vector: FloatArray) -> None:
        super().__init__(plant, vector)
        self._compiled, self._parameters, memory = plant.kernel_for(vector)
        self._memory = memory.size

    def simulate(self, drive: Drive, initial: Mapping[str, float], step: float) -> FloatArray:
        """Return (n, 6) in the order of the plant's outputs, SI, as `EhaKnee.simulate` does."""
        inputs = self.plant.inputs_of(drive)
        n = inputs.time.size
        out = np.empty((n, len(self.plant.outputs)))
        out[: drive.first] = np.nan
        memory = np.zeros(self._memory)
        state = self.plant.settled(initial, self._compiled, self._parameters, memory)
        self._compiled.simulate(
            drive.first,
            n - 1,
            inputs.time,
            inputs.commands,
            inputs.signals,
            inputs.imposed,
            inputs.is_imposed,
            drive.locked,
            drive.bypass_open,
            step,
            True,
            self._parameters,
            memory,
            state,
            out,
        )
        return out


class Session:
    """A simulation in progress: read the sensors, give a command, advance by one tick."""

    def __init__(
        self,
        plant: EhaKnee,
        vector: FloatArray,
        time: FloatArray,
        initial: Mapping[str, float],
        locked: bool,
        bypass_open: bool,
        step: float,
    ) -> None:
        n = time.size
        compiled, self._vector, self._effects = plant.kernel_for(vector)
        self._run = compiled.simulate
        self._time = np.ascontiguousarray(time, dtype=np.float64)
        self._commands = np.zeros(n)
        self._signals = _signals(n)
        self._imposed = np.zeros((n, len(IMPOSED)))
        self._is_imposed = np.zeros(len(IMPOSED), dtype=np.bool_)
        self._locked = locked
        self._bypass = bypass_open
        self._step = step
        self._state = plant.start_state(vector, initial)
        self._tick = 0
        self.outputs = np.full((n, len(plant.outputs)), np.nan)
        self._advance(0, 0, fresh=True)

    def _advance(self, first: int, last: int, *, fresh: bool) -> None:
        self._run(
            first, last, self._time, self._commands, self._signals, self._imposed, self._is_imposed,
            self._locked, self._bypass, self._step, fresh, self._vector, self._effects,
            self._state, self.outputs,
        )  # fmt: skip

    @property
    def reading(self) -> FloatArray:
        """What the sensors read now, (6,) in the order of the plant's outputs, without noise."""
        row: FloatArray = self.outputs[self._tick]
        return row

    def advance(self, command: float) -> None:
        """Hold `command` (A) until the next tick."""
        self._commands[self._tick] = command
        self._advance(self._tick, self._tick + 1, fresh=False)
        self._tick += 1

"""A simulation in progress: read the sensors, give a command, go on; for as long as one likes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import InputError
from eha_bench.core.near_miss import suggest
from eha_bench.plants.plant import Plant

_ROWS = 1024
"""Moments that are kept at first; more where a delay looks back on more."""


class Session:
    """A plant that is advanced from moment to moment by whoever gives its commands.

    Moments may lie any time apart. Inputs are held from one moment to the next. Of the past only
    what a delay looks back on is kept, so a session may run for ever.

    Attributes:
        now: time of the present moment, s.
        channels: what `truth` holds: the plant's outputs, and what follows from them.
    """

    def __init__(
        self,
        plant: Plant,
        vector: FloatArray,
        initial: Mapping[str, float],
        *,
        locked: bool = False,
        bypass_open: bool = False,
        step: float,
        start: float = 0.0,
        command: str = "",
    ) -> None:
        """Start at rest, or where the sensors read `initial`.

        Args:
            plant: what is simulated. vector: its parameters.
            initial: state -> what its sensor reads at first, SI.
            locked, bypass_open: setup.
            step: largest integration step, s.
            start: time of the first moment, s.
            command: the input that `advance` gives: the plant's command, unless one of its
                `references` takes its place, or a motion that is imposed where it has none.

        Raises:
            InputError: nothing drives this plant, its setup cannot be so, or a channel is not a
                state of it.
        """
        plant.check_session(command=command, locked=locked, bypass_open=bypass_open)
        at = plant.at(vector)
        self._imposes = not plant.command
        if self._imposes:
            at = at.imposing(command)
        elif command and command != plant.command:
            at = at.following(command)
        self._at, self._step = at, step
        self._locked, self._bypass = locked, bypass_open
        columns = (*plant.inputs, command) if self._imposes else plant.inputs
        self._places = {name: place for place, name in enumerate(columns)}
        self._command = self._places[command or plant.command]
        self._given = np.array([plant.resting_inputs.get(name, 0.0) for name in columns])
        if self._imposes:
            self._given[self._command] = initial.get(command, 0.0)
        self._look_back = at.look_back
        self._time = np.full(_ROWS, start)
        self._inputs = np.tile(self._given, (_ROWS, 1))
        self._out = np.full((_ROWS, len(plant.outputs)), np.nan)
        self._state, self._memory = at.start(initial)
        self._row = 0
        self.now = start
        self.channels = (*plant.outputs, *plant.derived_channels)
        self._go_on = at.advance
        self._go_on(
            0, 0, self._time, self._inputs, self._locked, self._bypass, self._step, True,
            self._memory, self._state, self._out,
        )  # fmt: skip

    @property
    def reading(self) -> FloatArray:
        """What the sensors read now, without noise, (outputs,), SI; a view that moves on."""
        row: FloatArray = self._out[self._row]
        return row

    @property
    def truth(self) -> FloatArray:
        """What the sensors read now and what follows from it, (channels,), SI."""
        reading = self._out[self._row]
        return np.array([*reading.tolist(), *self._at.derived_at(reading)])

    def give(self, inputs: Mapping[str, float]) -> None:
        """Hold inputs at values (SI) from now on, until others are given.

        Raises:
            InputError: the plant has no such input.
        """
        for name, value in inputs.items():
            if name not in self._places:
                raise InputError(
                    f"'{name}' cannot be an input of {self._at.plant.id}",
                    hint=suggest(name, self._places),
                )
            self._given[self._places[name]] = value

    def advance(self, to: float, command: float) -> None:
        """Hold a command (SI unit of what commands the session) and go on to a later moment, s.

        What the sensors read is then that of just before the next command takes effect. A motion
        that is imposed does not jump: it goes evenly to what is given, and is there at the end.
        """
        row = self._row
        if row + 2 > self._time.size:
            row = self._forget()
        self._given[self._command] = command
        here = self._inputs[row, self._command]
        self._inputs[row : row + 2] = self._given
        if self._imposes:
            self._inputs[row, self._command] = here
        self._time[row + 1] = to
        self._go_on(
            row, row + 1, self._time, self._inputs, self._locked, self._bypass, self._step, False,
            self._memory, self._state, self._out,
        )  # fmt: skip
        self._row = row + 1
        self.now = to

    def shift(self, state: str, by: float) -> None:
        """Add to a state (SI) at once, as nothing in the plant's equations would.

        Raises:
            InputError: the plant has no such state.
        """
        places = self._at.state_places
        if state not in places:
            raise InputError(
                f"'{state}' is not a state of {self._at.plant.id}", hint=suggest(state, places)
            )
        self._state[places[state]] += by

    def _forget(self) -> int:
        """Make room for moments to come; return where the present one is then."""
        row, time = self._row, self._time
        oldest = time[row] - self._look_back
        first = max(int(np.searchsorted(time[: row + 1], oldest, side="right")) - 1, 0)
        kept = row - first
        if 2 * kept > time.size:
            for name in ("_time", "_inputs", "_out"):
                old = getattr(self, name)
                setattr(self, name, np.concatenate((old, np.zeros_like(old))))
        for array in (self._time, self._inputs, self._out):
            array[: kept + 1] = array[first : row + 1].copy()
        self._row = kept
        return kept

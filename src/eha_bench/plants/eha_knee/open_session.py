"""A simulation of the knee EHA that nobody knows the end of: for other tools' co-simulations."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from eha_bench.plants.eha_knee.equations import FORCE, TEMPERATURE
from eha_bench.plants.eha_knee.plant import IMPOSED, EhaKnee

FloatArray = NDArray[np.float64]

_FIRST = 1024


class OpenSession:
    """Advances by steps of any length; keeps all commands, as a delay looks back at them."""

    def __init__(
        self,
        plant: EhaKnee,
        vector: FloatArray,
        initial: Mapping[str, float],
        *,
        locked: bool,
        bypass_open: bool,
        step: float,
    ) -> None:
        """Start at time 0.

        Args:
            plant, vector: the plant and its parameters.
            initial: channel -> what its sensor reads at first, SI.
            locked, bypass_open: setup.
            step: largest integration step, s.

        Raises:
            InputError: a channel that is no state of the plant.
        """
        compiled, self._vector, self._effects = plant.kernel_for(vector)
        self._run, self._step = compiled.simulate, step
        self._locked, self._bypass = locked, bypass_open
        self._time = np.zeros(_FIRST)
        self._commands = np.zeros(_FIRST)
        self._signals = np.zeros((_FIRST, 2))
        self._signals[:, TEMPERATURE] = np.nan
        self._imposed = np.zeros((_FIRST, len(IMPOSED)))
        self._is_imposed = np.zeros(len(IMPOSED), dtype=np.bool_)
        self._out = np.full((_FIRST, len(plant.outputs)), np.nan)
        self._state = plant.start_state(vector, initial)
        self._tick = 0
        self._advance(0, fresh=True)

    @property
    def reading(self) -> FloatArray:
        """What the sensors read now, (6,) in the order of the plant's outputs, without noise."""
        row: FloatArray = self._out[self._tick]
        return row

    def advance(self, length: float, command: float, force: float) -> None:
        """Hold a command (A) and a force on the rod (N) for `length` s."""
        k = self._tick
        if k + 2 > self._time.size:
            self._grow()
        self._time[k + 1] = self._time[k] + length
        self._commands[k] = command
        self._signals[k : k + 2, FORCE] = force
        self._tick = k + 1
        self._advance(k, fresh=False)

    def _advance(self, first: int, *, fresh: bool) -> None:
        # a command that is delayed is looked up among the ticks there are, not those to come
        n = self._tick + 1
        self._run(
            first, self._tick, self._time[:n], self._commands[:n], self._signals[:n],
            self._imposed[:n], self._is_imposed, self._locked, self._bypass, self._step, fresh,
            self._vector, self._effects, self._state, self._out[:n],
        )  # fmt: skip

    def _grow(self) -> None:
        for name in ("_time", "_commands", "_signals", "_imposed", "_out"):
            old = getattr(self, name)
            setattr(self, name, np.concatenate((old, np.zeros_like(old))))
        self._signals[self._tick + 1 :, TEMPERATURE] = np.nan

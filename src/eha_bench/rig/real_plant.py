"""The actuator in real time: a model advanced to any moment, and what its sensors show."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import InputError
from eha_bench.core.linkage import Linkage
from eha_bench.plants.eha_knee import equations
from eha_bench.plants.eha_knee.plant import IMPOSED, EhaKnee
from eha_bench.plants.model import Model
from eha_bench.targets.sensors import RIG_SENSORS, Sensor

FloatArray = NDArray[np.float64]

_WINDOW = 8192
_HISTORY = 4096
"""Moments that are kept, for effects that look back on earlier commands."""
_NOISE_BLOCK = 4096
_STEP = 12.5e-6


class RealPlant:
    """A model of the knee EHA whose clock is moved on by whoever owns it.

    Attributes:
        now: s.
    """

    def __init__(self, model: Model, seed: int, sensors: dict[str, Sensor] | None = None) -> None:
        """Begin at rest at mid-stroke, time 0.

        Raises:
            InputError: the model is of another plant.
        """
        plant = model.plant
        if not isinstance(plant, EhaKnee):
            raise InputError(f"the rig plays eha_knee, not {model.plant_id}")
        self._plant = plant
        self._vector = model.vector()
        self._advance = plant.compiled.simulate
        area, volume = model.value("piston_area_a"), model.value("volume_a")
        self.linkage = Linkage(
            model.value("link_a"), model.value("link_b"), model.value("link_c0"), volume / area
        )
        self.current_limit = model.value("current_limit")
        self._names = plant.outputs
        self._random = np.random.default_rng(seed)
        own = RIG_SENSORS if sensors is None else sensors
        self._coded = {
            name: own[name].in_si(name) if name in own else (0.0, 0.0)
            for name in (*plant.outputs, "joint_angle")
        }
        self._noise: list[list[float]] = []
        self.now = 0.0
        self.set_up({}, locked=True, bypass_open=False)

    def set_up(self, initial: Mapping[str, float], *, locked: bool, bypass_open: bool) -> None:
        """Bring the actuator to rest in a setup, at the present time."""
        n = _WINDOW
        self._time = np.zeros(n)
        self._commands = np.zeros(n)
        self._signals = np.zeros((n, 2))
        self._signals[:, 1] = np.nan
        self._imposed = np.zeros((n, len(IMPOSED)))
        self._is_imposed = np.zeros(len(IMPOSED), dtype=np.bool_)
        self._out = np.zeros((n, len(self._names)))
        self._locked, self._bypass = locked, bypass_open
        self._effects = np.zeros(self._plant.layout.memory)
        self._state = self._plant.start_state(self._vector, initial)
        self._index = 0
        self._time[0] = self.now
        self._run(0, 0, fresh=True)

    def _run(self, first: int, last: int, *, fresh: bool) -> None:
        self._advance(
            first, last, self._time, self._commands, self._signals, self._imposed,
            self._is_imposed, self._locked, self._bypass, _STEP, fresh, self._vector,
            self._effects, self._state, self._out,
        )  # fmt: skip

    def advance(self, to: float, command: float) -> None:
        """Hold a command (A) from now to a later moment (s); an earlier one changes nothing."""
        if to - self.now < 1e-7:
            return
        if self._index + 2 > _WINDOW - 1:
            self._shift()
        at = self._index
        self._commands[at] = command
        self._time[at + 1] = to
        self._run(at, at + 1, fresh=False)
        self._index = at + 1
        self.now = to

    def _shift(self) -> None:
        """Forget the oldest moments."""
        kept = slice(self._index - _HISTORY, self._index + 1)
        for array in (self._time, self._commands, self._out):
            array[: _HISTORY + 1] = array[kept].copy()
        self._index = _HISTORY

    def raise_pressure(self, by: float) -> None:
        """Add to the pressure in chamber A, Pa, as a load or a stuck valve would."""
        self._state[equations.PRESSURE_A] += by

    @property
    def truth(self) -> dict[str, float]:
        """What really is, by channel, SI."""
        found = dict(zip(self._names, self._out[self._index].tolist(), strict=True))
        found["joint_angle"] = self.linkage.angle_at(found["piston_position"])
        return found

    def sample(self) -> dict[str, float]:
        """Return what the sensors show now, by channel, SI."""
        if not self._noise:
            drawn = self._random.standard_normal((_NOISE_BLOCK, len(self._coded)))
            self._noise = drawn.tolist()
        noise, shown = self._noise.pop(), self.truth
        for (name, (deviation, count)), step in zip(self._coded.items(), noise, strict=True):
            value = shown[name] + deviation * step
            shown[name] = round(value / count) * count if count > 0 else value
        return shown

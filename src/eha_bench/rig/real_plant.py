"""The actuator in real time: a model advanced to any moment, and what its sensors show."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from eha_bench.plants.model import Model
from eha_bench.plants.session import Session
from eha_bench.targets.sensors import RIG_SENSORS, SimulatedSensor

_NOISE_BLOCK = 4096
_STEP = 12.5e-6
_MOST_CURRENT = 1.2
"""What a drive stands, of the largest current that it delivers."""
_SHORTEST = 1e-7
"""Time that is not worth a step, s."""


class RealPlant:
    """A model whose clock is moved on by whoever owns it.

    Attributes:
        linkage: the joint's triangle, None where there is no joint.
        command, command_unit: what commands it, and its SI unit.
        command_limit: the largest command that the drive follows, SI.
        most_current: what the drive stands, A; inf where it is not commanded by a current.
        position_range: ends of the channels that are positions, SI.
    """

    def __init__(
        self, model: Model, seed: int, sensors: dict[str, SimulatedSensor] | None = None
    ) -> None:
        """Start at rest, time 0, locked where the plant can be.

        Raises:
            InputError: no controller commands that plant.
        """
        plant = model.plant
        plant.check_session()
        self._plant, self._vector = plant, model.vector()
        self.linkage = plant.linkage(self._vector)
        self.command, self.command_unit = plant.command, plant.units[plant.command]
        self.command_limit = plant.command_limit(self._vector)
        commands_current = plant.command == "current_command"
        self.most_current = _MOST_CURRENT * self.command_limit if commands_current else math.inf
        self.position_range = plant.position_range(self._vector)
        self._random = np.random.default_rng(seed)
        own = RIG_SENSORS if sensors is None else sensors
        self._noise: list[list[float]] = []
        self._session = self._new_session({}, 0.0, locked=plant.can_lock, bypass_open=False)
        self._coded = {
            name: own[name].in_si(name, plant.units.get(name))[:2] if name in own else (0.0, 0.0)
            for name in self._session.channels
        }

    def can(self, *, locked: bool, bypass_open: bool) -> bool:
        """Whether the plant can be set up so."""
        plant = self._plant
        return (plant.can_lock or not locked) and (plant.has_bypass or not bypass_open)

    def set_up(self, initial: Mapping[str, float], *, locked: bool, bypass_open: bool) -> None:
        """Bring the actuator to rest in a setup, at the present time.

        Raises:
            InputError: the plant cannot be set up so.
        """
        self._session = self._new_session(initial, self.now, locked=locked, bypass_open=bypass_open)

    def _new_session(
        self, initial: Mapping[str, float], now: float, *, locked: bool, bypass_open: bool
    ) -> Session:
        return Session(
            self._plant,
            self._vector,
            initial,
            locked=locked,
            bypass_open=bypass_open,
            step=_STEP,
            start=now,
        )

    @property
    def now(self) -> float:
        """The present time, s."""
        return self._session.now

    def advance(self, to: float, command: float) -> None:
        """Hold a command (SI) from now to a later moment (s); an earlier one changes nothing."""
        if to - self.now >= _SHORTEST:
            self._session.advance(to, command)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states that `shift` takes."""
        return self._plant.states

    def shift(self, state: str, by: float) -> None:
        """Add to a state, SI, as a load or a stuck valve would to a pressure.

        Raises:
            InputError: the plant has no such state.
        """
        self._session.shift(state, by)

    @property
    def truth(self) -> dict[str, float]:
        """What really is, by channel, SI."""
        session = self._session
        return dict(zip(session.channels, session.truth.tolist(), strict=True))

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

"""Suites on the independent rigs: the same trials and controllers, the rigs' own equations.

What a rig of `fixtures` does is not known to the product; here it stands where the product's plant
stands in a simulation, so that a suite can be run, and gains can be searched, on the rig itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from fixtures.rig import kernel
from fixtures.rig.parameters import record
from fixtures.rig.plant import SUBSTEPS_FREE, SUBSTEPS_LOCKED, translate
from fixtures.rig.sensors import COLUMNS
from fixtures.rigs import equations as eq
from fixtures.rigs.machine import STEP, Machine, Settings, at_rest
from fixtures.rigs.plant import Plant

from eha_bench.control.controller_file import ControllerSet
from eha_bench.core.arrays import FloatArray
from eha_bench.core.trial import Bypass, Piston, Trial
from eha_bench.plants.model import Model
from eha_bench.targets.closed_loop import ClosedLoop
from eha_bench.targets.sensors import RIG_SENSORS, SimulatedSensor
from eha_bench.targets.simulator import Simulator
from eha_bench.targets.target import Outcome, Stopping, never

SUPPLY = 12.0
"""V, of a bridge: stabilised, as a model has it where it is not measured."""
_LATEST = 200
"""Commands that may still act, ticks: far more than any delay of the rig."""


class KneeLoop:
    """The knee's rig, one tick after the other."""

    channels = COLUMNS

    def __init__(self, settings: Mapping[str, float], trial: Trial) -> None:
        self._parameters = record(translate(settings))
        self._locked = trial.setup.piston is Piston.LOCKED
        self._bypass = trial.setup.bypass is Bypass.OPEN
        position = dict(trial.setup.initial).get("piston_position", 0.0)
        self._state = kernel.start_state(position, self._parameters)
        self._before: list[float] = []
        self.truth = self._on(0.0)[0][0]

    def _on(self, command: float) -> tuple[FloatArray, FloatArray]:
        """Return readings and states now and a tick later."""
        readings, states, _ = kernel.simulate(
            self._parameters, kernel.OPEN_LOOP, np.full(2, command), np.zeros(2), np.zeros(2),
            np.zeros(4), self._locked, self._bypass, self._state,
            SUBSTEPS_LOCKED if self._locked else SUBSTEPS_FREE, np.array(self._before),
        )  # fmt: skip
        return readings, states

    def advance(self, to: float, command: float) -> None:
        """Hold a command, A, for a tick."""
        del to
        readings, states = self._on(command)
        self._before = [*self._before[-_LATEST:], command]
        self._state, self.truth = states[-1], readings[-1]


class ForeignLoop:
    """A foreign plant's rig, one sample after the other."""

    def __init__(self, plant: Plant, settings: Settings, trial: Trial) -> None:
        self.channels = tuple(channel.name for channel in plant.measured)
        self._machine = Machine(plant.kind, settings)
        self._record = self._machine.record({})
        self._plant = plant
        clock = trial.clock()
        self._time = clock - clock[0]
        self._inputs = np.zeros((clock.size, 2))
        if plant.kind == eq.SERVO:
            self._inputs[:, 1] = SUPPLY
        start = dict(trial.setup.initial).get(trial.channel, float(trial.reference(np.zeros(1))[0]))
        self._state = at_rest(plant.kind, self._record, start)
        self._tick = 0
        self.truth = self._on(0, 1)[0]

    def _on(self, first: int, last: int) -> tuple[FloatArray, FloatArray]:
        readings, states, _ = eq.simulate(
            self._plant.kind, self._record, self._machine.tables, self._machine.scales, self._time,
            self._inputs, np.zeros(self._time.size), np.zeros(4), False, self._state, first, last,
            STEP[self._plant.kind],
        )  # fmt: skip
        return readings[-1][list(self._plant.readings)], states[-1]

    def advance(self, to: float, command: float) -> None:
        """Hold a command until the next sample."""
        del to
        tick = self._tick
        self._inputs[tick, 0] = command
        self.truth, self._state = self._on(tick, tick + 2)
        self._tick = tick + 1


Loop = KneeLoop | ForeignLoop


@dataclass(frozen=True)
class Rig:
    """What is needed to run trials on a rig: its loop for a trial, and its sensors."""

    loop: Callable[[Trial], Loop]
    sensors: dict[str, SimulatedSensor]

    @staticmethod
    def knee(settings: Mapping[str, float]) -> Rig:
        """Return the knee's rig."""
        return Rig(lambda trial: KneeLoop(settings, trial), RIG_SENSORS)

    @staticmethod
    def foreign(plant: Plant, settings: Settings) -> Rig:
        """Return a foreign plant's rig."""
        sensors = {
            c.name: SimulatedSensor(noise=c.noise, resolution=c.step) for c in plant.measured
        }
        return Rig(lambda trial: ForeignLoop(plant, settings, trial), sensors)


class RigSimulator(Simulator):
    """The simulator with a rig in the place of its plant; the model only says what is declared."""

    def __init__(self, rig: Rig, model: Model, controllers: ControllerSet) -> None:
        super().__init__(model, controllers, sensors=rig.sensors, name="rig")
        self._rig = rig

    def varied(
        self,
        model: Model | None = None,
        controllers: ControllerSet | None = None,
        sensors: dict[str, SimulatedSensor] | None = None,
    ) -> RigSimulator:
        """Return the same rig under other controllers; its sensors are its own."""
        del sensors
        return RigSimulator(self._rig, model or self._model, controllers or self._controllers)

    def run(self, trial: Trial, repeat: int, stopping: Stopping = never) -> Outcome:
        """Run one repeat on the rig."""
        plant = self._rig.loop(trial)
        loop = ClosedLoop(
            trial, repeat, plant.channels, self._controllers.make(trial.mode, self._context(trial)),
            self._sensors, self._constants(), {}, self._command(trial),
        )  # fmt: skip
        return loop.run(plant, stopping)

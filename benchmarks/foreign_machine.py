"""One machine of a foreign plant with a hidden effect: drawn, recorded, and declared to a user."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from fixtures.rigs.case import nearly_as_declared, sized
from fixtures.rigs.effect import Effect
from fixtures.rigs.logs import WRITERS, channels_files
from fixtures.rigs.machine import Drive, Machine, Settings
from fixtures.rigs.plant import Plant
from fixtures.rigs.sensors import Sensors
from fixtures.rigs.sheet import write_plant
from fixtures.rigs.strength import TARGET, excess

from eha_bench.core.arrays import FloatArray

LEVELS = ("middle", "strong")
"""How strong an effect is, in turn."""


class ForeignMachine:
    """A machine whose equations are its own.

    Args:
        plant: which. effect: hidden in it. number: of the machine, the seed of all that is drawn.

    Attributes:
        drives: its runs. machine: the equations. rng: of what is drawn further.
    """

    def __init__(self, plant: Plant, effect: Effect, number: int) -> None:
        self.plant, self.effect = plant, effect
        self.rng = np.random.default_rng([number, sum(effect.key.encode())])
        base = plant.drawn(self.rng, 0.5) | nearly_as_declared(plant, self.rng)
        base |= Settings(effect.without)
        self.drives = plant.drives(self.rng)
        self._excess = excess(plant, base, self.drives)
        self.machine = Machine(plant.kind, base)
        self.add(effect, LEVELS[number % len(LEVELS)])
        self._sensors = Sensors.drawn(plant, self.rng)

    def add(self, effect: Effect, level: str) -> None:
        """Put an effect of a strength into it."""
        form, size, _ = sized(self._excess, effect, TARGET[level], self.rng)
        self.machine = Machine(self.plant.kind, self.machine.settings | form.settings(size))

    def record(self, drive: Drive, path: Path) -> FloatArray:
        """Run, write a log as its sensors have it, and return what they read, (n, channels)."""
        run = self.machine.run(drive)
        inputs = run.inputs[:, : self.plant.inputs]
        values = np.column_stack([inputs, self._sensors.read(run.readings, self.rng)])
        WRITERS["csv"](path, self.plant, drive.time, values)
        return values

    def declare(self, folder: Path, runs: Sequence[str]) -> Path:
        """Write what a user knows of it, and a dataset of runs; return that."""
        (folder / "channels.yaml").write_text(channels_files(self.plant)["channels_csv.yaml"])
        missing = self.effect.undeclared_in_plant or self.effect.undeclared
        write_plant(self.plant.name, folder / "plant.yaml", list(missing))
        inputs = ", ".join(channel.name for channel in self.plant.channels[: self.plant.inputs])
        path = folder / "dataset.yaml"
        path.write_text(
            f"model: plant.yaml\nchannels: channels.yaml\ninputs: [{inputs}]\nruns:\n"
            + "".join(runs)
        )
        return path

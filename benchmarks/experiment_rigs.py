"""Machines with a hidden effect that make one short recording, and then the experiment asked for.

The knee of `fixtures.rig` and the three plants of `fixtures.rigs`, whose equations are not those of
the models that are fitted. The first recording is a sine of a few seconds, in which many causes
look the same.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
from benchmarks.foreign_machine import LEVELS, ForeignMachine
from fixtures.rig import kernel
from fixtures.rig.case import Conditions, Plan, draw_hidden, draw_true
from fixtures.rig.commands import Run, rod_from_knee, slope
from fixtures.rig.foreign import FOREIGN as KNEE_FOREIGN
from fixtures.rig.hidden import Hidden
from fixtures.rig.layout import write_layout
from fixtures.rig.listed import LISTED as KNEE_LISTED
from fixtures.rig.mcap_log import TOPICS, write_log
from fixtures.rig.parameters import CALIBRATED, DECLARED
from fixtures.rig.plant import Plant as KneePlant
from fixtures.rig.sensors import COLUMNS, measured, stamps
from fixtures.rigs.catalogue import PLANTS
from fixtures.rigs.effect import Effect
from fixtures.rigs.machine import Drive
from fixtures.rigs.plant import Plant

from eha_bench.core.arrays import FloatArray
from eha_bench.core.trial import Bypass, Piston, Trial

KNEE = "eha_knee"
SIZES = {
    "geared_servo": (0.08, 0.25),
    "valve_cylinder": (0.4, 1.5),
    "single_rod_eha": (10.0, 40.0),
}
"""Amplitudes of the first recording's command, SI."""
LOOSE = {
    "geared_servo": (0.0, 0.0, 1.0, 0.001),
    "valve_cylinder": (0.0, 0.0, 10.0, 10.0 / 2048.0),
    "single_rod_eha": (0.0, 0.0, 200.0, 0.0),
}
"""The rig's own loop switched off: what is asked for is the command."""
SAFETY = {
    "geared_servo": "{angle: -2.5 rad .. 2.5 rad, velocity: -9 rad/s .. 9 rad/s}",
    "valve_cylinder": "{piston_position: -110 mm .. 110 mm, piston_velocity: -1 m/s .. 1 m/s}",
    "single_rod_eha": "{piston_position: -120 mm .. 120 mm, pressure_a: <= 12 MPa, "
    "pressure_b: <= 12 MPa}",
    KNEE: "{pressure_a: <= 32 MPa, pressure_b: <= 32 MPa, piston_position: -35 mm .. 35 mm, "
    "motor_speed: -400 rad/s .. 400 rad/s}",
}


class BlindRig(ABC):
    """One machine.

    Attributes:
        truth: id of what is hidden in it. variables: what that follows.
        first_seconds: length of its first recording.
    """

    setups: ClassVar[tuple[tuple[str, str], ...]] = (("free", "closed"),)

    def __init__(self, truth: str, variables: Sequence[str]) -> None:
        self.truth, self.variables = truth, tuple(variables)
        self.first_seconds = 0.0

    @abstractmethod
    def record_first(self, folder: Path) -> Path:
        """Write the first recording and what is declared; return the dataset."""

    @abstractmethod
    def perform(self, trial: Trial, path: Path) -> tuple[str, dict[str, FloatArray]]:
        """Run a trial, write its log; return its row of a dataset, and what it read by channel."""

    @abstractmethod
    def also(self, number: int) -> None:
        """Put a second effect into the machine, of middle strength, that no diagnosis knows."""

    def dataset(self, folder: Path, name: str, rows: Sequence[str]) -> Path:
        """Write a dataset of the first recording and others."""
        first = (folder / "dataset.yaml").read_text()
        path = folder / name
        path.write_text(first + "".join(rows))
        return path

    @property
    @abstractmethod
    def mode(self) -> str:
        """The suite's word for the command."""

    def safety(self, plant: str, room: float = 1.0) -> str:
        """Return a suite that says what is safe; `room` scales every limit."""
        limits = SAFETY[plant] if room == 1.0 else scaled(SAFETY[plant], room)
        trials = "".join(
            f"  - {{id: rest_{k}, mode: {self.mode}, duration: 1 s, "
            f"setup: {{piston: {piston}, bypass: {bypass}}}, "
            "signal: {kind: constant, value: 0}}\n"
            for k, (piston, bypass) in enumerate(self.setups)
        )
        return f"name: safe\ndefaults: {{safety: {limits}}}\ntrials:\n{trials}"


def scaled(limits: str, factor: float) -> str:
    """Return limits with every number scaled."""
    out = []
    for word in limits.split(" "):
        digits = word.rstrip(",}")
        try:
            number = float(digits)
        except ValueError:
            out.append(word)
            continue
        out.append(f"{number * factor:.6g}{word[len(digits) :]}")
    return " ".join(out)


class ForeignRig(BlindRig):
    """A machine of one of the foreign plants."""

    def __init__(self, plant: Plant, effect: Effect, number: int) -> None:
        super().__init__(effect.id, effect.variables)
        self._own = ForeignMachine(plant, effect, number)
        self.plant, self.rng = plant, self._own.rng
        self.first_seconds = float(self.rng.uniform(3.0, 6.0))
        time = self._own.drives[0].time
        time = time[time < self.first_seconds]
        wave = sine(time, SIZES[plant.name], self.rng)
        values = self._own.drives[0].values
        self.first = Drive(
            "first", "train", time, np.zeros(time.size), wave, LOOSE[plant.name], values
        )

    @property
    def mode(self) -> str:
        """The first input."""
        return self.plant.channels[0].name

    def record_first(self, folder: Path) -> Path:
        """Write the first recording and what is declared; return the dataset."""
        self._own.record(self.first, folder / "first.csv")
        return self._own.declare(folder, ["  - {log: first.csv, use: train}\n"])

    def perform(self, trial: Trial, path: Path) -> tuple[str, dict[str, FloatArray]]:
        """Run a trial that commands the plant itself."""
        clock = trial.clock()
        reference, forward = np.zeros(clock.size), trial.reference(clock)
        drive = Drive(
            trial.id, "train", clock - clock[0], reference, forward, LOOSE[self.plant.name],
            self.first.values,
        )  # fmt: skip
        log = path.with_suffix(".csv")
        values = self._own.record(drive, log)
        names = [channel.name for channel in self.plant.channels]
        return f"  - {{log: {log.name}, use: train}}\n", dict(zip(names, values.T, strict=True))

    def also(self, number: int) -> None:
        """Put a second effect into the machine, of middle strength, that no diagnosis knows."""
        self._own.add(self.plant.foreign[number % len(self.plant.foreign)], "middle")


def sine(time: FloatArray, sizes: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    """Return a sine that starts after a rest.

    Args:
        time: (n,) s. sizes: least and largest amplitude. rng: draws amplitude and frequency.
    """
    frequency = float(np.exp(rng.uniform(np.log(0.3), np.log(2.5))))
    shifted = np.maximum(time - 0.4, 0.0)
    return np.asarray(float(rng.uniform(*sizes)) * np.sin(2.0 * np.pi * frequency * shifted))


class KneeRig(BlindRig):
    """A machine of the knee."""

    setups = (("locked", "closed"), ("locked", "open"), ("free", "closed"))
    mode = "current"

    def __init__(self, effect: Hidden, number: int) -> None:
        super().__init__(effect.id, effect.variables)
        self.effect = effect
        self.rng = np.random.default_rng([number, sum(effect.key.encode()), 3])
        self.calibrate = tuple(name for name in CALIBRATED if name not in effect.undeclared)
        level = LEVELS[number % len(LEVELS)]
        values, _, self.bench = draw_true(self.rng, Conditions(), self.calibrate)
        self._settings = {**values, **self._drawn(effect, level)}
        self.plant = KneePlant(self._settings)
        self.first_seconds = float(self.rng.uniform(2.0, 3.5))
        self.first = self._sine()

    def _drawn(self, effect: Hidden, level: str) -> dict[str, float]:
        plan = Plan("case", "single", (effect,), (level,), ())
        return draw_hidden(plan, self.rng, Conditions())[0]

    def also(self, number: int) -> None:
        """Put a second effect into the machine, of middle strength, that no diagnosis knows."""
        second = KNEE_FOREIGN[number % len(KNEE_FOREIGN)]
        self._settings |= self._drawn(second, "middle")
        self.plant = KneePlant(self._settings)

    def _sine(self) -> Run:
        """Return a sine in one of the setups."""
        time = np.arange(round(self.first_seconds * 1e3)) * 1e-3
        which = int(self.rng.integers(3))
        if which == 2:
            angle = sine(time, (10.0, 25.0), self.rng)
            wave = rod_from_knee(90.0 + angle)
            return Run("first", False, False, False, kernel.POSITION_LOOP, 2, wave, slope(wave))
        wave = sine(time, (2.0, 8.0), self.rng) + 8.0 if which == 0 else (
            sine(time, (1.5, 4.0), self.rng)
        )  # fmt: skip
        return Run("first", True, which == 1, False, kernel.OPEN_LOOP, 0, wave, slope(wave))

    def record_first(self, folder: Path) -> Path:
        """Write the first recording and what is declared; return the dataset."""
        readings, _, command = self.plant.run(self.first)
        self._write(folder / f"{self.first.name}.mcap", self.first.reference, command, readings)
        declared = {**DECLARED, **self.effect.undeclared}
        valves = self.effect.id != "anti_cavitation"
        write_layout(folder, [self.first], declared, self.calibrate, valves)
        return folder / "dataset.yaml"

    def perform(self, trial: Trial, path: Path) -> tuple[str, dict[str, FloatArray]]:
        """Run a trial that commands the motor's current."""
        clock = trial.clock()
        wave = trial.reference(clock)
        locked, opened = trial.setup.piston is Piston.LOCKED, trial.setup.bypass is Bypass.OPEN
        run = Run(
            trial.id, locked, opened, False, kernel.OPEN_LOOP, 0, wave, np.zeros_like(wave)
        )  # fmt: skip
        readings, command = self.plant.at_mid_stroke(run)
        log = path.with_suffix(".mcap")
        read = self._write(log, wave, command, readings)
        row = (
            f"  - {{log: {log.name}, channels: channels_0.yaml, "
            f"piston: {trial.setup.piston.value}, bypass: {trial.setup.bypass.value}, "
            "use: train}\n"
        )
        return row, dict(zip(COLUMNS, read.T, strict=True))

    def _write(
        self, path: Path, reference: FloatArray, command: FloatArray, readings: FloatArray
    ) -> FloatArray:
        read = measured(readings, self.bench, self.rng)
        every = (stamps(len(read), self.bench, self.rng), np.ones(len(read), dtype=np.bool_))
        write_log(path, reference, command, read, dict.fromkeys(TOPICS, every))
        return read


def rigs_of(plant: str, *, foreign: bool) -> dict[str, Callable[[int], BlindRig]]:
    """Return what makes a plant's machines with each effect, by the effect's key.

    Args:
        plant: its name. foreign: effects that no diagnosis knows by name, in place of those that
            it knows.
    """
    if plant == KNEE:
        effects = KNEE_FOREIGN if foreign else KNEE_LISTED
        return {effect.key: partial(KneeRig, effect) for effect in effects}
    own = PLANTS[plant]
    known = own.foreign if foreign else own.listed
    return {effect.key: partial(ForeignRig, own, effect) for effect in known}

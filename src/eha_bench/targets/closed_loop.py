"""A trial's loop around anything simulated: read the sensors, ask the controller, go on a tick."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from eha_bench.control.controller import Controller, as_command
from eha_bench.core.arrays import FloatArray
from eha_bench.core.error_text import error_text
from eha_bench.core.errors import EhaBenchError, TargetFault
from eha_bench.core.recording import Recording
from eha_bench.core.trial import Trial
from eha_bench.targets.sensors import SensorNoise, SimulatedSensor
from eha_bench.targets.target import Ending, Outcome, Stopping


class Simulated(Protocol):
    """A simulation in progress: what its sensors would read now, and one command a tick."""

    @property
    def truth(self) -> FloatArray:
        """What the sensors read now without noise, (channels,), SI."""

    def advance(self, to: float, command: float) -> None:
        """Hold a command (SI) until a later moment, s on the trial's clock.

        Raises:
            TargetFault: the simulation failed.
        """


@dataclass(frozen=True)
class ClosedLoop:
    """What is the same at every tick of a run.

    Attributes:
        trial, repeat: what is run; together they seed the noise.
        channels: names of what `Simulated.truth` holds.
        controller: fresh, at rest.
        sensors: noise and resolution by channel.
        constants: what is known of the plant, as metadata of the recording.
        units: SI units of channels that are not on the list of known ones.
        command: what the controller commands, by which name the command is recorded; "" where it
            is not: a motion that is imposed is measured.
    """

    trial: Trial
    repeat: int
    channels: tuple[str, ...]
    controller: Controller
    sensors: dict[str, SimulatedSensor]
    constants: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    command: str = "current_command"

    def run(self, plant: Simulated, stopping: Stopping) -> Outcome:
        """Run to the end, or until a fault, a safety limit, or a request to stop."""
        trial, channels = self.trial, self.channels
        clock = trial.clock()
        reference = trial.reference(clock)
        seed = [trial.seed + self.repeat, zlib.crc32(trial.id.encode())]
        period = 1.0 / trial.sample_rate
        noise = SensorNoise(self.sensors, channels, clock.size, seed, self.units, period)
        measured = np.full((clock.size, len(channels)), np.nan)
        commands = np.full(clock.size, np.nan)
        both = "pressure_a" in channels and "pressure_b" in channels
        ending, reason, done = Ending.COMPLETE, "", clock.size
        try:
            for tick in range(clock.size):
                if tick > 0 and stopping():
                    ending, reason, done = Ending.INTERRUPTED, "interrupted", tick
                    break
                measured[tick] = noise.read(tick, plant.truth)
                reading = dict(zip(channels, measured[tick].tolist(), strict=True))
                if both:
                    reading["pressure_difference"] = reading["pressure_a"] - reading["pressure_b"]
                reason = trial.violation(reading)
                if reason:
                    ending, done = Ending.SAFETY_STOP, tick + 1
                    commands[tick] = 0.0
                    break
                command = as_command(self.controller.step(float(reference[tick]), reading))
                if not math.isfinite(command):
                    ending, done = Ending.FAULT, tick + 1
                    reason = f"the controller asked for {command} at {clock[tick]:.4f} s"
                    commands[tick] = 0.0
                    break
                commands[tick] = command
                if tick + 1 < clock.size:
                    plant.advance(clock[tick + 1], command)
        except KeyboardInterrupt:
            ending, reason = Ending.INTERRUPTED, "interrupted"
            done = int(np.count_nonzero(np.isfinite(commands)))
        except TargetFault as fault:
            ending, reason = Ending.FAULT, str(fault)
            done = int(np.count_nonzero(np.isfinite(commands)))
        except EhaBenchError:
            raise
        except (Exception, SystemExit) as crash:  # a plug-in controller may raise anything
            ending, reason = Ending.FAULT, error_text(crash)
            done = int(np.count_nonzero(np.isfinite(commands)))
        values = {"reference": reference[:done]}
        if self.command:
            values[self.command] = commands[:done]
        for column, name in enumerate(channels):
            # what is commanded may be measured as well: what was asked for is what is recorded
            values.setdefault(name, measured[:done, column])
        recording = Recording(
            time=clock[:done] - clock[0],
            values=values,
            units={**self.units, "reference": self.units.get(trial.channel, trial.mode.unit)},
            metadata={"signal_start": repr(float(abs(clock[0]))), **self.constants},
        )
        return Outcome(recording, ending, reason)

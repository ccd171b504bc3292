"""What an experiment commands: the plant's command, what its controller follows, or a motion.

A loop inside a servo is commanded by its reference. A shaft whose speed was measured, or a rod that
a test rig moves, is an input of the recordings as a command is, and a drive under the machine can
be asked for it. A force or a pressure from outside is not commanded: it stays at its mean.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import EhaBenchError, InputError, Place
from eha_bench.core.trial import Piston, Trial, mode_named, passes_on
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.experiment.hypothesis import Question
from eha_bench.plants.plant import Plant
from eha_bench.posterior.covered import Covered

_SWITCHED_OFF = 0.01
"""Part of a trial's largest command up to which a machine counts as switched off."""


@dataclass(frozen=True)
class BeforeTrial:
    """How a machine stands before a trial.

    Attributes:
        command: given until then, SI.
        pressures: channel -> where its simulation begins, SI; what is not in it is as the plant
            rests.
    """

    command: float
    pressures: Mapping[str, float]


@dataclass(frozen=True)
class Commanded:
    """The input that experiments give; all others stay at their means.

    Attributes:
        channel: its name. mode: the suite's word for a trial that commands it.
        unit: behind every level in a suite, "" for plain SI. si_unit: SI unit, for people.
        limit: the largest value either way that the plant follows, SI; inf for none.
        follows: position that a controller inside the plant makes follow it, "" for none.
        is_imposed: whether it is a motion of a part, which a sensor reads as well.
        is_imposed_position: whether it is a position of a part, which cannot jump.
    """

    channel: str
    mode: str
    unit: str
    si_unit: str
    limit: float
    follows: str = ""
    is_imposed: bool = False
    is_imposed_position: bool = False

    @staticmethod
    def of(question: Question) -> Commanded:
        """Return what the experiments for a diagnosis command.

        Raises:
            InputError: nothing that its recordings have as an input can be commanded.
        """
        plant, inputs = question.rivals[0].model.plant, question.covered.inputs
        known = [name for name in (plant.command, *plant.references, *_motions(plant, inputs))
                 if name in inputs]  # fmt: skip
        channel = known[0] if known else plant.command
        if not channel:
            raise InputError(
                f"{plant.id} has no command that an experiment could give, and none of its inputs "
                f"is a motion that a rig could impose: {', '.join(inputs) or 'it has none'}",
                where=Place(file=str(question.source)),
                hint="rank recordings that exist already with --from",
            )
        unit = CHANNELS[channel].unit if channel in CHANNELS else ""
        is_command = channel == plant.command
        vectors = [rival.vector for rival in question.rivals] if is_command else []
        return Commanded(
            channel,
            _mode_of(channel, question.covered),
            unit,
            unit or plant.units.get(channel, ""),
            min((float(plant.command_limit(vector)) for vector in vectors), default=math.inf),
            plant.followed_by(channel) if channel in plant.references else "",
            channel in _motions(plant, inputs),
            channel in plant.roles.rate_of,
        )

    def before(
        self, trial: Trial, reference: FloatArray, starts: Mapping[str, float]
    ) -> tuple[BeforeTrial, ...]:
        """Return how a machine may stand before a trial, the most likely first.

        What follows a position stands where it is asked to be first. Anything else stands as where
        recordings began. Where the piston is locked and so holds any weight, it may as well be
        switched off until the trial begins; and where recordings began under a command or in
        motion, its pressures may then be those of a machine that nobody has used yet.

        Args:
            trial: to run. reference: of it, (n,). starts: channel -> what the machine read where
                recordings began, SI; without the command where it was not at rest there.
        """
        read = {name: value for name, value in starts.items() if name != self.channel}
        if self.follows or self.is_imposed_position:
            return (BeforeTrial(float(reference[0]), read),)
        recorded = starts.get(self.channel)
        cases = [BeforeTrial(recorded or 0.0, read)]
        locked = trial.setup.piston is Piston.LOCKED
        if locked:
            cases.append(BeforeTrial(0.0, read))
        little = _SWITCHED_OFF * float(np.abs(reference).max(initial=0.0))
        if recorded is None or (locked and abs(recorded) > little):
            cases.append(BeforeTrial(0.0, {}))
        return tuple(case for k, case in enumerate(cases) if case not in cases[:k])

    def start(self, trial: Trial, reference: FloatArray) -> dict[str, float]:
        """Return where a trial starts, channel -> SI: what is led is where it is asked to be."""
        led = self.follows or (self.channel if self.is_imposed_position else "")
        own = {led: float(reference[0])} if led else {}
        return {**own, **trial.setup.initial}


def _mode_of(channel: str, covered: Covered) -> str:
    """Return the suite's word for a trial that commands a channel itself.

    That is the channel's own name. `current` is what is measured, and a machine may have no sensor
    of it: only where it was recorded is it the word.
    """
    spoken = mode_named("current")
    if passes_on(spoken, channel) and _was_recorded(spoken.channel, covered):
        return spoken.name
    return channel


def _was_recorded(channel: str, covered: Covered) -> bool:
    """Whether recordings have a channel, also one that the plant does not give."""
    if any(channel in item.extremes for item in covered.setups):
        return True
    if not Path(covered.dataset).is_file():
        return False
    try:
        return any(channel in run.read() for run in load_dataset(covered.dataset).training[:1])
    except EhaBenchError:
        return False


def _motions(plant: Plant, inputs: Mapping[str, tuple[float, float, float]]) -> list[str]:
    """Return the inputs that are motions of parts of the plant, speeds before positions."""
    roles = plant.roles
    rates = [name for name in inputs if name in roles.rates]
    return [*rates, *(name for name in inputs if name in roles.rate_of)]

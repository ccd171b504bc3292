"""Where a suite takes a machine beyond the recordings that its model was fitted to.

A posterior holds what recordings leave open of what they show. Of a speed, a pressure or a command
that none of them reached they show nothing: an effect that begins there (a current that saturates,
a valve that opens) is in no draw.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from eha_bench.core.note import Note
from eha_bench.core.trial import Trial
from eha_bench.posterior.covered import Beyond
from eha_bench.posterior.posterior import Posterior
from eha_bench.sweeps.evaluation import ChannelRange, Evaluated


@dataclass(frozen=True)
class Extrapolation:
    """A channel that a trial takes further than it was recorded.

    Attributes:
        trial: its id. unit: SI. beyond: how far, in the median of the draws.
    """

    trial: str
    unit: str
    beyond: Beyond

    @property
    def note(self) -> Note:
        """What it is, as a sentence."""
        return Note(
            "{trial} takes {channel} to {reached:.4g} {unit}; the recordings that the model was "
            "fitted to have {low:.4g} to {high:.4g}: P(pass) supposes that it holds beyond them",
            trial=self.trial,
            channel=self.beyond.channel,
            reached=self.beyond.reached,
            unit=self.unit,
            low=self.beyond.low,
            high=self.beyond.high,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {"trial": self.trial, "unit": self.unit, **asdict(self.beyond)}


@dataclass(frozen=True)
class UnrecordedSetup:
    """A trial in a setup of the rig that no recording was made in."""

    trial: str
    piston: str
    bypass: str

    @property
    def note(self) -> Note:
        """What it is, as a sentence."""
        return Note(
            "{trial} runs with the piston {piston} and the bypass {bypass}, in which the model was "
            "fitted to no recording: P(pass) supposes that it holds there",
            trial=self.trial,
            piston=self.piston,
            bypass=self.bypass,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return asdict(self)


def beyond_recordings(
    trials: Sequence[Trial], draws: Sequence[Evaluated], posterior: Posterior
) -> tuple[Extrapolation | UnrecordedSetup, ...]:
    """Return what lies beyond the recordings: of every channel the trial that goes furthest.

    Nothing where the posterior's file does not say where they have been.

    Args:
        trials: of the suite. draws: that were run. posterior: that they come from.
    """
    covered = posterior.covered
    if covered is None:
        return ()
    setups: list[UnrecordedSetup] = []
    furthest: dict[str, Extrapolation] = {}
    for trial in trials:
        piston, bypass = trial.setup.piston.value, trial.setup.bypass.value
        setup = covered.setup(piston, bypass)
        if setup is None:
            setups.append(UnrecordedSetup(trial.id, piston, bypass))
            continue
        typical = dict(
            _typical([draw.ranges[trial.id] for draw in draws if trial.id in draw.ranges])
        )
        ends = {name: (item.low, item.high) for name, item in typical.items()}
        for beyond in covered.beyond(setup, ends):
            known = furthest.get(beyond.channel)
            if known is None or beyond.distance > known.beyond.distance:
                unit = typical[beyond.channel].unit
                furthest[beyond.channel] = Extrapolation(trial.id, unit, beyond)
    return (*setups, *furthest.values())


def _typical(
    draws: Sequence[Mapping[str, ChannelRange]],
) -> Iterator[tuple[str, ChannelRange]]:
    """Yield each channel with the median of its ends over the draws."""
    for name in dict.fromkeys(name for own in draws for name in own):
        own = [draw[name] for draw in draws if name in draw]
        low, high = np.median([(item.low, item.high) for item in own], axis=0)
        yield name, ChannelRange(float(low), float(high), own[0].unit)

"""A proposal: the experiment that separates what is open, with what is predicted of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from eha_bench.core.arrays import FloatArray
from eha_bench.core.finite import finite_or_none
from eha_bench.experiment.decision import Odds
from eha_bench.experiment.hypothesis import OF_VALUE
from eha_bench.experiment.response import LimitMargin

SCHEMA_VERSION = 1
NEAR = 0.8
"""Share of the way to a limit from which a proposal says that it comes near."""


class ProposalEnding(StrEnum):
    """How the search for an experiment ended.

    `proposed`: a suite was written. `nothing_open`: there is nothing to separate. `none_permitted`:
    something is open, and nothing that is permitted would tell it.
    """

    PROPOSED = "proposed"
    NOTHING_OPEN = "nothing_open"
    NONE_PERMITTED = "none_permitted"


@dataclass(frozen=True)
class Band:
    """What one rival predicts of one channel: nine of ten draws lie between low and high, SI."""

    middle: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True)
class PlannedTrial:
    """One trial of a proposal.

    Attributes:
        id: in the suite. words: what it does. seconds: of bench time.
        time: (n,) s. reference: (n,) SI. bands: rival -> channel -> what it predicts.
        parts: (n,) squared distance of the nearest two rivals, collected up to each time.
        rooms: what is left of each limit, the fullest first.
        setup: piston and bypass. units: SI unit of each channel. command_unit: of the reference.
    """

    id: str
    words: str
    seconds: float
    time: FloatArray
    reference: FloatArray
    bands: Mapping[str, Mapping[str, Band]]
    parts: FloatArray
    rooms: tuple[LimitMargin, ...]
    setup: tuple[str, str]
    units: Mapping[str, str]
    command_unit: str


@dataclass(frozen=True)
class Width:
    """A parameter's 95 % interval, half of it as a share of `of`, before and after."""

    parameter: str
    before: float
    after: float
    of: str = OF_VALUE


@dataclass(frozen=True)
class SensorAdvice:
    """A channel that is not measured, and the probability of naming the right rival with it."""

    channel: str
    noise: float
    unit: str
    right: float


@dataclass(frozen=True)
class Proposal:
    """The end of a search for the next experiment.

    Attributes:
        ending: how it ended. sentence: that in words.
        rivals: ids. odds: of the experiment; None where parameters are what is open.
        asked: probability that was asked for, or half of the interval.
        widths: parameters before and after, the worst first.
        trials: of the suite. suite: what goes into it.
        budget: seconds allowed. permitted: what was, in words.
        sensor: what to log, where nothing permitted separates the rivals.
        notes: one sentence each. seconds: that the search took. tried: experiments simulated.
    """

    ending: ProposalEnding
    sentence: str
    rivals: tuple[str, ...]
    asked: float
    budget: float
    permitted: str
    odds: Odds | None = None
    widths: tuple[Width, ...] = ()
    trials: tuple[PlannedTrial, ...] = ()
    suite: Mapping[str, Any] = field(default_factory=dict)
    sensor: SensorAdvice | None = None
    notes: tuple[str, ...] = ()
    seconds: float = float("nan")
    tried: int = 0
    source: Path = Path()

    @property
    def bench_seconds(self) -> float:
        """Bench time that all trials take, s."""
        return sum(trial.seconds for trial in self.trials)

    def to_dict(self) -> dict[str, Any]:
        """Return what `--json` prints; what is not computable is null."""
        return {
            "schema_version": SCHEMA_VERSION,
            "ending": self.ending.value,
            "sentence": self.sentence,
            "rivals": list(self.rivals),
            "probability_right": None if self.odds is None else self.odds.right,
            "probability_wrong": None if self.odds is None else self.odds.wrong,
            "by_rival": {} if self.odds is None else self.odds.by_rival,
            "draws": 0 if self.odds is None else self.odds.draws,
            "asked": finite_or_none(self.asked),
            "intervals": [
                {"parameter": item.parameter, "before": finite_or_none(item.before),
                 "after": finite_or_none(item.after), "of": item.of} for item in self.widths
            ],
            "bench_seconds": self.bench_seconds,
            "budget": self.budget,
            "trials": [
                {
                    "id": trial.id,
                    "what": trial.words,
                    "seconds": trial.seconds,
                    "limits": [
                        {"channel": room.channel, "low": finite_or_none(room.low),
                         "high": finite_or_none(room.high),
                         "limit_low": finite_or_none(room.limit.low),
                         "limit_high": finite_or_none(room.limit.high), "used": room.used}
                        for room in trial.rooms
                    ],
                }
                for trial in self.trials
            ],
            "permitted": self.permitted,
            "sensor": None if self.sensor is None else {
                "channel": self.sensor.channel, "noise": self.sensor.noise,
                "unit": self.sensor.unit, "probability_right": self.sensor.right,
            },
            "notes": list(self.notes),
            "tried": self.tried,
            "seconds": finite_or_none(self.seconds),
        }  # fmt: skip

"""A suite's own metric: a formula over metrics and statistics of channels, with an interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from eha_bench.core.budget import Budget, Contribution, Evaluation
from eha_bench.core.formula import Input, Statistic
from eha_bench.core.own_metric import OwnMetric
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import NORMAL
from eha_bench.metrics.metric import Metric, NotScored
from eha_bench.metrics.statistic import statistic_over

Score = Callable[[str, Recording, Trial, str], tuple[Measure, str]]
"""Scores a metric on a channel ("" for its own): the measure, and the channel that it was."""

_FAR = (1e-3, 1.0, 1e3)
"""Shares of its value by which an input is moved to its open side, to see where that leads."""

_TOGETHER = {"pressure_difference": ("pressure_a", "pressure_b")}


class FormulaMetric(Metric):
    """The formula's value by those of its inputs; its interval by theirs.

    Each end of the interval is what the inputs' own ends move the value by, one at a time, in the
    root of the sum of squares (G. Zou, A. Donner, Statistics in Medicine 27, 2008,
    doi:10.1002/sim.3095). Inputs that share a channel may err together: their moves are added up,
    which holds whatever their correlation is (JCGM 100, 5.2.2).
    """

    by_default = False

    def __init__(self, own: OwnMetric, score: Score) -> None:
        self.spec = own.spec
        self._own = own
        self._score = score

    def applies(self, trial: Trial) -> bool:  # noqa: ARG002 - the base class asks for it
        """Whether the metric applies: inputs that do not report that themselves."""
        return True

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:  # noqa: ARG002 - the base class asks for it
        """Return the formula's value, SI."""
        formula = self._own.formula
        parts = [
            _FormulaInput(name, part, *self._measure_input(recording, trial, part))
            for name, part in formula.inputs.items()
        ]
        values = {part.name: part.measure.value for part in parts}
        value = formula.value(values)
        if not math.isfinite(value):
            found = ", ".join(f"{part.text} = {part.measure.value:.4g}" for part in parts)
            raise NotScored(f"{formula.text} is not a finite number for {found}")
        open_low, open_high = _open_ends(formula.value, values, value, parts)
        notes = [formula.text]
        notes += [f"{part.text}: {part.measure.reason}" for part in parts if part.measure.reason]
        unknown = [part.text for part in parts if not part.known]
        if unknown:
            notes.insert(1, f"no interval: {', '.join(unknown)} has none")
            return Measure(value, open_low, open_high, "; ".join(notes))
        moves = [_moves(formula.value, values, value, part) for part in parts]
        groups = _groups(parts)
        down, up = (
            math.hypot(*(math.fsum(moves[i][side] for i in group) for group in groups))
            for side in (0, 1)
        )
        if not (math.isfinite(down) and math.isfinite(up)):
            notes.insert(1, "no interval: within those of its inputs it is not a finite number")
            return Measure(value, open_low, open_high, "; ".join(notes))
        budget = Budget(tuple(_contribution(group, parts, moves) for group in groups)).merged()
        low = value - down if math.isnan(open_low) else open_low
        high = value + up if math.isnan(open_high) else open_high
        return Measure(value, low, high, "; ".join(notes), budget)

    def _measure_input(
        self, recording: Recording, trial: Trial, part: Input
    ) -> tuple[Measure, frozenset[str]]:
        """Return an input, and the channels that it rests on."""
        if isinstance(part, Statistic):
            found = statistic_over(recording, trial, part, self._own.start, self._own.stop)
            return found, _channels(part.of.names)
        found, channel = self._score(part.metric, recording, trial, part.channel)
        if not math.isfinite(found.value):
            raise NotScored(f"{part}: {found.reason}")
        return found, _channels([channel] if channel else recording.values)


@dataclass(frozen=True)
class _FormulaInput:
    """An input of the formula as it was measured, and the channels that it rests on."""

    name: str
    part: Input
    measure: Measure
    channels: frozenset[str]

    @property
    def text(self) -> str:
        """The input as the formula writes it."""
        return str(self.part)

    @property
    def known(self) -> bool:
        """Whether it has an interval."""
        return not (math.isnan(self.measure.low) or math.isnan(self.measure.high))


def _channels(names: Iterable[str]) -> frozenset[str]:
    """Return channels with those that they are derived from."""
    return frozenset(part for name in names for part in (name, *_TOGETHER.get(name, ())))


def _moves(
    of: Callable[[Mapping[str, float]], float],
    values: Mapping[str, float],
    value: float,
    part: _FormulaInput,
) -> tuple[float, float]:
    """Return how far the value goes down and up over an input's interval; infinite if anywhere.

    An end that is open is left out: `_open_ends` tells of it.
    """
    own = [end for end in (part.measure.low, part.measure.high) if math.isfinite(end)]
    ends = [of({**values, part.name: end}) - value for end in (*own, part.measure.value)]
    if not all(map(math.isfinite, ends)):
        return math.inf, math.inf
    return max(-min(ends), 0.0), max(*ends, 0.0)


def _open_ends(
    of: Callable[[Mapping[str, float]], float],
    values: Mapping[str, float],
    value: float,
    parts: list[_FormulaInput],
) -> tuple[float, float]:
    """Return the ends of the interval that inputs open (a clipped peak does), NaN for the others.

    Raises:
        NotScored: both: the value may be anything.
    """
    moved: list[float] = []
    for part in parts:
        size = max(abs(part.measure.value), 1.0)
        for end in (part.measure.low, part.measure.high):
            if math.isinf(end):
                far = (part.measure.value + math.copysign(size * k, end) for k in _FAR)
                moved += [of({**values, part.name: place}) - value for place in far]
    unknown = any(map(math.isnan, moved))
    down, up = (unknown or any(side * move > 0.0 for move in moved) for side in (-1.0, 1.0))
    if down and up:
        names = ", ".join(part.text for part in parts if part.measure.open)
        raise NotScored(f"may be anything: a sensor's end cut off {names}")
    return -math.inf if down else math.nan, math.inf if up else math.nan


def _groups(parts: list[_FormulaInput]) -> list[list[int]]:
    """Return the inputs, those that share a channel together."""
    groups: list[tuple[set[str], list[int]]] = []
    for index, part in enumerate(parts):
        channels, members = set(part.channels), [index]
        apart = []
        for others, inside in groups:
            if channels & others:
                channels |= others
                members = inside + members
            else:
                apart.append((others, inside))
        groups = [*apart, (channels, members)]
    return [members for _, members in groups]


def _contribution(
    group: list[int], parts: list[_FormulaInput], moves: list[tuple[float, float]]
) -> Contribution:
    """Return what inputs that may err together add to the value's uncertainty."""
    standard = math.fsum(sum(moves[i]) for i in group) / (2.0 * NORMAL)
    from_data = any(
        part.evaluation is Evaluation.A for i in group for part in parts[i].measure.budget.parts
    )
    source = " with ".join(parts[i].text for i in group)
    return Contribution(source, Evaluation.A if from_data else Evaluation.B, standard)

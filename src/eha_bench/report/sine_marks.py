"""What a plot marks on a sine: the fitted periods, the amplitudes, the lag."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from eha_bench.core.errors import EhaBenchError
from eha_bench.core.limit import AcceptanceLimit
from eha_bench.core.recording import Recording
from eha_bench.core.score import Score
from eha_bench.core.trial import Trial
from eha_bench.metrics.tone_response import tone_response
from eha_bench.metrics.window import Timeline
from eha_bench.report.engineering import limit_text, metric_label, quantity
from eha_bench.report.marks import LevelLine, Mark, Point, Role, TimeBand, TimeLine


@dataclass(frozen=True)
class SineSwing:
    """A sine of the reference and the settled answer to it; times in s, values SI.

    Attributes:
        channel: what should follow the reference.
        tone_start: where the sine begins.
        start, stop: the settled whole periods that its fit uses.
        frequency: Hz.
        reference, response: amplitudes of the fundamental.
        centre: mean of the channel over the settled periods.
        crest: the reference's first peak among them.
    """

    channel: str
    tone_start: float
    start: float
    stop: float
    frequency: float
    reference: float
    response: float
    centre: float
    crest: float


def swing_of(recording: Recording, trial: Trial, line: Timeline) -> SineSwing | None:
    """Return the trial's one sine as its metrics fitted it; None where they could not.

    Args:
        recording: bound to the trial, with the trial's channel.
        trial: whose signal may hold one tone; of several, none is marked.
        line: the recording's clock and reference.
    """
    if len(trial.signal.tones) != 1 or trial.channel not in recording:
        return None
    tone = trial.signal.tones[0]
    try:
        found = tone_response(recording, trial, trial.channel, tone)
    except EhaBenchError:
        return None
    stop = min(tone.stop, float(line.time[-1]) + line.period, trial.duration)
    start = stop - found.periods / found.frequency
    window = line.between(start, stop)
    first = line.between(start, start + 1.0 / found.frequency)
    crest = first.start + int(np.argmax(line.reference[first]))
    return SineSwing(
        channel=trial.channel,
        tone_start=max(tone.start, float(line.time[0])),
        start=start,
        stop=stop,
        frequency=found.frequency,
        reference=abs(found.reference.value),
        response=abs(found.response.value),
        centre=float(np.mean(recording[trial.channel][window])),
        crest=float(line.time[crest]),
    )


def sine_marks(
    swing: SineSwing, limits: Sequence[AcceptanceLimit], scores: Sequence[Score]
) -> list[Mark]:
    """Return the marks of a sine, backgrounds first."""
    own = [score for score in scores if score.channel == swing.channel]
    found: list[Mark] = [TimeBand(swing.tone_start, swing.start, Role.UNSCORED, "settling in")]
    for limit in limits:
        if limit.channel == swing.channel:
            found += _limit(swing, limit)
    for score in own:
        if math.isfinite(score.value):
            found += _score_marks(swing, score)
    if any(score.metric in ("phase_lag", "time_lag") for score in own):
        found.append(TimeLine(swing.channel, swing.crest, Role.LEVEL, "crest of the reference"))
    return found


def _limit(swing: SineSwing, limit: AcceptanceLimit) -> Iterator[Mark]:
    label = f"{metric_label(limit.metric)} {limit_text(limit.text)}"
    sides = [side for side in (limit.bounds.high, limit.bounds.low) if math.isfinite(side)]
    for number, side in enumerate(sides):
        text = "" if number else label
        if limit.metric == "amplitude_ratio":
            yield from _levels(swing, side * swing.reference, Role.LIMIT, text)
        elif limit.metric in ("phase_lag", "time_lag"):
            late = side if limit.metric == "time_lag" else side / (2.0 * math.pi * swing.frequency)
            yield TimeLine(limit.channel, swing.crest + late, Role.LIMIT, text)


def _score_marks(swing: SineSwing, score: Score) -> Iterator[Mark]:
    spread = (score.measure.high - score.measure.low) / 2.0
    value = quantity(
        score.value, score.unit, metric=score.metric, written=score.limit, spread=spread
    )
    label = f"{metric_label(score.metric)} {value}"
    if score.metric == "amplitude_ratio":
        yield from _levels(swing, swing.response, Role.MEASURED, label)
    elif score.metric == "time_lag":
        yield Point(swing.channel, swing.crest + score.value, swing.centre + swing.response, label)


def _levels(swing: SineSwing, amplitude: float, role: Role, label: str) -> Iterator[LevelLine]:
    above, below = swing.centre + amplitude, swing.centre - amplitude
    yield LevelLine(swing.channel, above, swing.start, swing.stop, role, label)
    yield LevelLine(swing.channel, below, swing.start, swing.stop, role)

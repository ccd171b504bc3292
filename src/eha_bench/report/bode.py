"""What a Bode plot of a run shows: gain, phase and coherence with what was judged on them.

The frequency response is asked of the metrics that scored, so that what is drawn is what was
judged; points that they left out are shown as such.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import stdtrit

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.recording import Recording
from eha_bench.core.result import TrialResult
from eha_bench.core.score import Score
from eha_bench.core.trial import Trial
from eha_bench.metrics.frequency_response import (
    MIN_COHERENCE,
    FrequencyResponse,
    excites_a_band,
    frequency_response,
)
from eha_bench.metrics.low_frequency import low_frequency_gain
from eha_bench.metrics.recorded import bind
from eha_bench.report.engineering import limit_text, metric_label, number, quantity
from eha_bench.report.marks import Role

HALF_POWER: Final = 10.0 * math.log10(0.5)


@dataclass(frozen=True)
class BodeCurve:
    """Values (n,) over the frequencies of the plot; where one is not finite there is a gap.

    Attributes:
        label: short, e.g. `measured`.
        colour: name of a shade of the page.
        values: (n,) in the panel's unit.
        low, high: (n,) 95 % interval; NaN where it is not known.
        dashed: for what is not the response itself.
        rings: open marks without a line, for points that were left out.
    """

    label: str
    colour: str
    values: FloatArray
    low: FloatArray
    high: FloatArray
    dashed: bool = False
    rings: bool = False


@dataclass(frozen=True)
class BodeMark:
    """A line across a panel: at a level (panel's unit), or at a frequency in Hz."""

    role: Role
    label: str
    level: float | None = None
    frequency: float | None = None


@dataclass(frozen=True)
class BodePanel:
    """Curves over frequency that share an axis; `low` and `high` bound it where they are given."""

    heading: str
    unit: str
    curves: tuple[BodeCurve, ...]
    marks: tuple[BodeMark, ...]
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class Bode:
    """Gain, phase and coherence over (n,) frequencies in Hz.

    Attributes:
        frequency: (n,) Hz, ascending; reliable points and doubtful ones.
        panels: gain, phase, coherence.
        left_out: frequency in Hz and reason of every point that no score rests on.
        method: how the response was found.
    """

    frequency: FloatArray
    panels: tuple[BodePanel, BodePanel, BodePanel]
    left_out: tuple[tuple[float, str], ...]
    method: str


def bode_of(recording: Recording, run: TrialResult, trial: Trial | None) -> Bode | None:
    """Return the Bode plot of a run; None where its signal excites no band, or nothing came of it.

    Args:
        recording: of the run.
        run: its scores are marked.
        trial: what was asked.
    """
    if trial is None or trial.channel not in recording:
        return None
    bound, trial = bind(recording, trial)
    if not excites_a_band(trial):
        return None
    try:
        response = frequency_response(bound, trial, trial.channel)
    except EhaBenchError:
        return None  # the scores say why
    if len(response.points) < 2:
        return None
    scores = {
        score.metric: score
        for score in run.scores
        if score.channel == trial.channel and math.isfinite(score.value)
    }
    frequency = np.array(
        sorted({point.frequency for point in (*response.points, *response.doubtful)})
    )
    return Bode(
        frequency,
        (
            _gain(frequency, response, scores),
            _phase(frequency, response, scores),
            _coherence(frequency, response),
        ),
        response.left_out,
        response.method,
    )


def _gain(
    frequency: FloatArray, response: FrequencyResponse, scores: dict[str, Score]
) -> BodePanel:
    gain, reach = response.gain, _reach(response)
    with np.errstate(divide="ignore", invalid="ignore"):
        low = _decibels(gain * np.maximum(1.0 - reach, 0.0))
        curves = [
            _curve(
                "measured",
                "blue",
                frequency,
                response.frequency,
                _decibels(gain),
                low,
                _decibels(gain * (1.0 + reach)),
            )
        ]
        for label, colour, levels in (
            ("noise", "reference", [point.noise for point in response.points]),
            ("distortion", "vermilion", [point.distortion for point in response.points]),
        ):
            values = _decibels(np.array(levels))
            if np.any(np.isfinite(values)):
                curves.append(
                    _curve(label, colour, frequency, response.frequency, values, dashed=True)
                )
    marks = list(_frequencies(scores, ("bandwidth_3db", "resonance_frequency")))
    if "bandwidth_3db" in scores:
        try:
            level, _ = low_frequency_gain(response)
        except EhaBenchError:
            pass
        else:
            shown = 20.0 * level / math.log(10.0) + HALF_POWER
            marks.insert(0, BodeMark(Role.LEVEL, "−3 dB", level=shown))
    return BodePanel("Gain", "dB", tuple(curves), tuple(marks))


def _phase(
    frequency: FloatArray, response: FrequencyResponse, scores: dict[str, Score]
) -> BodePanel:
    phase, reach = np.degrees(response.phase), np.degrees(_reach(response))
    curve = _curve(
        "measured", "blue", frequency, response.frequency, phase, phase - reach, phase + reach
    )
    marks = list(_frequencies(scores, ("bandwidth_90deg",)))
    if phase.min() < -60.0:
        marks.insert(0, BodeMark(Role.LEVEL, "−90°", level=-90.0))
    return BodePanel("Phase", "deg", (curve,), tuple(marks))


def _coherence(frequency: FloatArray, response: FrequencyResponse) -> BodePanel:
    curves = [_curve("used", "blue", frequency, response.frequency, response.coherence)]
    if response.doubtful:
        places = np.array([point.frequency for point in response.doubtful])
        values = np.array([point.coherence for point in response.doubtful])
        curves.append(_curve("left out", "vermilion", frequency, places, values, rings=True))
    label = f"left out below {number(MIN_COHERENCE, 1)}"
    mark = BodeMark(Role.LEVEL, label, level=MIN_COHERENCE)
    return BodePanel("Coherence", "", tuple(curves), (mark,), low=0.0, high=1.0)


def _frequencies(scores: dict[str, Score], metrics: tuple[str, ...]) -> Iterator[BodeMark]:
    """Lines at the frequencies that were scored, and at the limits on them."""
    for name in metrics:
        score = scores.get(name)
        if score is None:
            continue
        value = quantity(score.value, score.unit, metric=name, written=score.limit)
        words = metric_label(name)
        text = f"{words} {value}" + (f" (limit {limit_text(score.limit)})" if score.limit else "")
        yield BodeMark(Role.MEASURED, text, frequency=score.value)


def _reach(response: FrequencyResponse) -> FloatArray:
    """Return the relative reach of the gain's 95 % interval, that of the phase in rad, (n,)."""
    freedom = np.array([point.freedom for point in response.points])
    known = freedom > 0.0
    quantile = np.where(known, stdtrit(np.where(known, freedom, 1.0), 0.975), np.nan)
    found: FloatArray = quantile * response.relative_sd
    return found


def _decibels(values: FloatArray) -> FloatArray:
    found: FloatArray = 20.0 * np.log10(values)
    found[~np.isfinite(found)] = np.nan
    return found


def _curve(
    label: str,
    colour: str,
    frequency: FloatArray,
    places: FloatArray,
    values: FloatArray,
    low: FloatArray | None = None,
    high: FloatArray | None = None,
    *,
    dashed: bool = False,
    rings: bool = False,
) -> BodeCurve:
    """Return values at some of the plot's frequencies as a curve over all of them."""
    index = np.searchsorted(frequency, places)

    def spread(some: FloatArray | None) -> FloatArray:
        whole = np.full(frequency.size, np.nan)
        if some is not None:
            whole[index] = some
        return whole

    return BodeCurve(label, colour, spread(values), spread(low), spread(high), dashed, rings)

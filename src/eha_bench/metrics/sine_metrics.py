"""Amplitude ratio, phase lag, time lag, distortion and residual of a settled sine."""

from __future__ import annotations

import cmath
import math
from abc import abstractmethod
from dataclasses import replace

from eha_bench.core.metric import Better, MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import NORMAL, between, reach, type_a
from eha_bench.metrics.metric import Metric, NotScored, spec_of
from eha_bench.metrics.tone_response import ToneResponse, tone_responses

_LEAD = math.radians(5.0)  # a smaller one is no reason to think of a lag of nearly a turn
_SURELY_NONE = 0.3  # turns that the onset is late by, below which there is none


class SineMetric(Metric):
    """Scores trials whose signal holds sines; of several tones, the worst is reported."""

    def applies(self, trial: Trial) -> bool:
        """Whether the signal has exactly one sine: many are a frequency response."""
        return len(trial.signal.tones) == 1

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:
        """Return the value for the tone where it is worst."""
        found = []
        for tone in tone_responses(recording, trial, channel):
            measure = self.of(tone)
            found.append((self.badness(measure.value), tone, measure))
        _, tone, chosen = max(found, key=lambda item: item[0])
        where = f"worst of {len(found)} tones, " if len(found) > 1 else ""
        notes = "; ".join((chosen.reason, *tone.notes))
        return replace(chosen, reason=f"{where}{tone.frequency:.4g} Hz: {notes}")

    @abstractmethod
    def of(self, tone: ToneResponse) -> Measure:
        """Return the value for one tone; `reason` holds the convention."""

    def badness(self, value: float) -> float:
        """Return what is largest for the worst tone."""
        return value


class AmplitudeRatio(SineMetric):
    """Fundamental of the measurement over that of the reference."""

    spec = spec_of("amplitude_ratio")

    def of(self, tone: ToneResponse) -> Measure:
        """Return the magnitude of the ratio of the phasors."""
        value, budget = abs(tone.ratio), tone.budget.merged()
        own = reach(budget)
        return Measure(value, max(value - own, 0.0), value + own, "sine fit (IEEE 1057)", budget)

    def badness(self, value: float) -> float:
        """Return the distance from 1."""
        return abs(value - 1.0)


class PhaseLag(SineMetric):
    """Phase of the reference minus that of the measurement, rad, from -pi/2 on.

    A sine tells a lag but for whole turns; which one it is, the onset of the response tells.
    """

    spec = spec_of("phase_lag")

    def of(self, tone: ToneResponse) -> Measure:
        """Return the lag; a lead of up to 90 degrees is negative."""
        return phase_lag(tone, 1.0, "sine fit (IEEE 1057), positive lags")


class TimeLag(SineMetric):
    """Phase lag as time at the frequency of the fundamental, s."""

    spec = spec_of("time_lag")

    def of(self, tone: ToneResponse) -> Measure:
        """Return phase lag / (2 pi f)."""
        turn = 2.0 * math.pi * tone.frequency
        return phase_lag(tone, 1.0 / turn, "phase lag over angular frequency")


def phase_lag(tone: ToneResponse, factor: float, convention: str) -> Measure:
    """Return the lag in rad times a factor.

    In [-90, 270) degrees, where the response does not set in later than that: each whole turn that
    its onset is later counts. Where a lag of more turns is as likely, the reason says so.
    """
    if abs(tone.response.value) < 3.0 * math.sqrt(tone.response.variance) or tone.ratio == 0.0:
        raise NotScored("the response's fundamental is lost in its noise: it has no phase")
    lag = -cmath.phase(tone.ratio)
    lag = lag + 2.0 * math.pi if lag < -0.5 * math.pi else lag
    parts = [convention]
    late = tone.onset * tone.frequency - lag / (2.0 * math.pi)
    turns = max(round(late), 0) if math.isfinite(late) else 0
    if turns:
        lag += 2.0 * math.pi * turns
        parts.append(f"{turns} whole turn(s) by the response's onset after {tone.onset:.4g} s")
    elif lag < -_LEAD and not late < _SURELY_NONE:
        parts.append("read as a lead: a lag of 270 deg and more looks the same")
    budget = type_a("noise", (tone.ratio_sd / abs(tone.ratio)) ** 2, tone.freedom)
    budget += between("resolution", tone.rounding / abs(tone.response.value))
    value, budget = lag * factor, budget.scaled(factor).merged()
    own = reach(budget)
    return Measure(value, value - own, value + own, "; ".join(parts), budget)


class Distortion(SineMetric):
    """Total harmonic distortion: harmonics 2 to 10 over the fundamental, noise taken off."""

    spec = spec_of("distortion")

    def of(self, tone: ToneResponse) -> Measure:
        """Return the root of the harmonics' power over that of the fundamental."""
        if not tone.harmonics:
            raise NotScored("no harmonic lies below half the sample rate")
        fundamental = abs(tone.response.value) ** 2
        if not abs(tone.response.value) > 3.0 * math.sqrt(tone.response.variance):
            raise NotScored("the response's fundamental is lost in its noise")
        variance = tone.harmonics[0].variance
        power = sum(abs(harmonic.value) ** 2 for harmonic in tone.harmonics)
        clean = power - 2.0 * variance * len(tone.harmonics)
        spread = math.sqrt(
            4.0 * max(clean, 0.0) * variance + 4.0 * len(tone.harmonics) * variance**2
        )
        own = tone.quantile() * spread
        value, low, high = (
            math.sqrt(max(part, 0.0) / fundamental) if math.isfinite(part) else math.nan
            for part in (clean, clean - own, max(clean, 0.0) + own)
        )
        noise = type_a("noise", ((high - low) / (2.0 * NORMAL)) ** 2, tone.freedom)
        reason = f"harmonics 2-{len(tone.harmonics) + 1}, without noise"
        return Measure(value, low, high, reason, noise)


class SineResidual(SineMetric):
    """RMS of what is neither offset, fundamental nor harmonic, in the channel's unit."""

    spec = MetricSpec(
        "sine_residual", "RMS left by offset, fundamental and harmonics", None, better=Better.LOWER
    )
    by_default = False

    def of(self, tone: ToneResponse) -> Measure:
        """Return the RMS; it is a property of this recording, so no interval is given."""
        return Measure(tone.residual_rms, reason="after offset, fundamental and harmonics")

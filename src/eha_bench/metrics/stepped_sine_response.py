"""Frequency response by one settled sine after the other."""

from __future__ import annotations

import math

from eha_bench.core.recording import Recording
from eha_bench.core.trial import Trial
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.response_point import ResponsePoint
from eha_bench.metrics.tone_response import ToneResponse, tone_response


def stepped_sine_points(
    recording: Recording, trial: Trial, channel: str
) -> tuple[list[ResponsePoint], list[tuple[float, str]]]:
    """Return a point for every tone that has settled periods, and frequency and reason of others.

    Raises:
        MissingChannelError: no such channel.
    """
    points, left_out = [], []
    for tone in trial.signal.tones:
        try:
            points.append(_point(tone_response(recording, trial, channel, tone)))
        except NotScored as error:
            left_out.append((tone.frequency, error.reason))
    return points, left_out


def _point(tone: ToneResponse) -> ResponsePoint:
    fundamental = abs(tone.response.value) ** 2 / 2.0
    harmonics = sum(abs(harmonic.value) ** 2 for harmonic in tone.harmonics) / 2.0
    total = fundamental + harmonics + tone.residual_rms**2
    return ResponsePoint(
        frequency=tone.frequency,
        response=tone.ratio,
        variance=2.0 * tone.ratio_sd**2,
        freedom=tone.freedom,
        coherence=fundamental / total if total > 0.0 else 0.0,
        noise=math.sqrt(2.0) * tone.ratio_sd,
        distortion=math.sqrt(2.0 * harmonics) / abs(tone.reference.value),
    )

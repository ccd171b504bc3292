"""Frequency response from the reference to a channel, whatever signal excited it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import ComplexArray, FloatArray
from eha_bench.core.recording import Recording
from eha_bench.core.trial import Trial
from eha_bench.metrics.chirp_response import chirp_points
from eha_bench.metrics.memo import remembered
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.multisine_response import multisine_points
from eha_bench.metrics.response_point import ResponsePoint
from eha_bench.metrics.samples import samples
from eha_bench.metrics.stepped_sine_response import stepped_sine_points
from eha_bench.metrics.window import timeline

MIN_COHERENCE = 0.7
"""Points that the reference explains less of are left out."""

MAX_RELATIVE_SD = 0.25
"""Points whose gain has a larger standard deviation, as a share of it, are left out."""


@dataclass(frozen=True)
class FrequencyResponse:
    """Points of a frequency response in order of frequency.

    Attributes:
        points: those that can be relied upon.
        left_out: frequency in Hz and reason of the others.
        method: how it was found.
        how: how the signal was found in the recording; "" for the bench's own.
        notes: what is special about the samples.
        doubtful: those of the points left out that were measured, in order of frequency.
    """

    points: tuple[ResponsePoint, ...]
    left_out: tuple[tuple[float, str], ...]
    method: str
    how: str
    doubtful: tuple[ResponsePoint, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def frequency(self) -> FloatArray:
        """Frequencies of the points in Hz, (n,)."""
        return np.array([point.frequency for point in self.points])

    @property
    def response(self) -> ComplexArray:
        """Response over reference, H1, (n,)."""
        return np.array([point.response for point in self.points], dtype=np.complex128)

    @property
    def gain(self) -> FloatArray:
        """Magnitude of the response, (n,)."""
        return np.abs(self.response)

    @property
    def phase(self) -> FloatArray:
        """Phase in rad, unwrapped from the lowest frequency on, negative when lagging, (n,)."""
        return np.unwrap(np.angle(self.response))

    @property
    def relative_sd(self) -> FloatArray:
        """Standard deviation of the gain over the gain, which is that of the phase in rad, (n,)."""
        sd = [
            math.sqrt(point.variance / 2.0) / max(abs(point.response), 1e-300)
            for point in self.points
        ]
        return np.array(sd)

    @property
    def coherence(self) -> FloatArray:
        """Share of the channel's power that the reference explains, (n,)."""
        return np.array([point.coherence for point in self.points])


def frequency_response(recording: Recording, trial: Trial, channel: str) -> FrequencyResponse:
    """Return the response of a channel to the reference (channel's unit over the reference's).

    Raises:
        NotScored: the signal excites no band, samples have no value, or no point is left.
        MissingChannelError: no such channel.
    """
    return remembered(
        recording, trial, ("frequency", channel), lambda: _response(recording, trial, channel)
    )


def excites_a_band(trial: Trial) -> bool:
    """Whether the signal can tell a frequency response."""
    signal = trial.signal
    return len(signal.tones) > 1 or bool(signal.sweeps) or bool(signal.lines)


def _response(recording: Recording, trial: Trial, channel: str) -> FrequencyResponse:
    signal = trial.signal
    line = timeline(recording, trial)
    data = samples(recording, trial, channel)
    left_out: list[tuple[float, str]] = []
    if len(signal.tones) > 1:
        method = "stepped sine"
        found, left_out = stepped_sine_points(recording, trial, channel)
    elif signal.lines:
        method = "multisine, robust method" if len(signal.lines) > 1 else "periodic, fast method"
        found = multisine_points(data.values, line, signal.lines)
    elif signal.sweeps:
        method = "chirp, H1 by local polynomials"
        found = chirp_points(data.values, line, signal.sweeps)
    else:
        raise NotScored("the signal excites no band of frequencies")
    reliable, doubtful = [], []
    for point in sorted(found, key=lambda point: point.frequency):
        doubt = _doubt(point)
        if doubt:
            left_out.append((point.frequency, doubt))
            doubtful.append(point)
        else:
            reliable.append(point)
    if not reliable:
        reason = left_out[0][1] if left_out else "no line in the recording"
        raise NotScored(f"no frequency can be relied upon ({reason})")
    return FrequencyResponse(
        tuple(reliable),
        tuple(sorted(left_out)),
        method,
        line.how,
        tuple(doubtful),
        data.notes(line, line.between(0.0, trial.duration)),
    )


def _doubt(point: ResponsePoint) -> str:
    """Return why a point cannot be relied upon, or ""."""
    if not point.coherence >= MIN_COHERENCE:
        return f"coherence {point.coherence:.2f}"
    relative = math.sqrt(point.variance / 2.0) / max(abs(point.response), 1e-300)
    if relative > MAX_RELATIVE_SD:
        return f"gain known to {100 * relative:.0f} % only"
    return ""

"""The response to one sine: fundamental, harmonics and noise over its settled periods."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from eha_bench.core.arrays import ComplexArray, FloatArray
from eha_bench.core.budget import Budget
from eha_bench.core.note import Note
from eha_bench.core.recording import Recording
from eha_bench.core.signal import Tone
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import between, type_a, type_b
from eha_bench.metrics.harmonic_fit import harmonic_fits
from eha_bench.metrics.memo import remembered
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.ringing import Ringing, ringing
from eha_bench.metrics.samples import samples
from eha_bench.metrics.sine_fit import fit4
from eha_bench.metrics.step_response import magnitude, require_finite
from eha_bench.metrics.window import Timeline, timeline

TRANSIENT_PERIODS = 2
"""Periods at the start of a tone that are never scored."""

_FEWEST_PER_PERIOD = 4
_MOVED = 0.1  # of the amplitude
_BLOCKS = 64  # blocks of periods that are compared for stationarity, at most about twice as many
_THERE = 0.9  # share of the samples below which a gap is no matter of a few lost ones
_STATIONARY = 0.01  # of the amplitude: what a settled period may differ from the last ones
_DRIFT = 0.05  # of the amplitude: between the halves of the settled periods


@dataclass(frozen=True)
class Phasor:
    """A complex amplitude (value of exp(j 2 pi f t)) with the variance of each of its parts."""

    value: complex
    variance: float


@dataclass(frozen=True)
class ToneResponse:
    """What a channel does under a settled sine.

    Attributes:
        frequency: as commanded, Hz.
        reference: fundamental of the command.
        response: fundamental of the channel.
        harmonics: of the channel, from the second on, as far as half the sample rate allows.
        residual_rms: of what is neither offset nor fundamental nor harmonic, unit of the channel.
        freedom: degrees of freedom of the variances (0: no interval).
        periods: settled periods used.
        onset: s from the tone's start until the response has moved by a tenth of its amplitude;
            NaN where the start was not recorded.
        rounding: half-width of what the sensor's resolution leaves of the response's amplitude.
        gain: relative standard uncertainty of the sensor.
        notes: what a reader of the score should know.
    """

    frequency: float
    reference: Phasor
    response: Phasor
    harmonics: tuple[Phasor, ...]
    residual_rms: float
    freedom: float
    periods: int
    onset: float
    rounding: float
    gain: float
    notes: tuple[str, ...]

    @property
    def budget(self) -> Budget:
        """What moves `ratio`: each of its parts, and its magnitude by the sensor's gain."""
        return (
            type_a("noise", self.ratio_sd**2, self.freedom)
            + between("resolution", self.rounding / abs(self.reference.value))
            + type_b("sensor", self.gain * abs(self.ratio))
        )

    def quantile(self) -> float:
        """Return Student's two-sided 95 % quantile (NaN where the noise is not known)."""
        return float(stdtrit(self.freedom, 0.975)) if self.freedom > 0 else math.nan

    @property
    def ratio(self) -> complex:
        """Response over reference."""
        return self.response.value / self.reference.value

    @property
    def ratio_sd(self) -> float:
        """Standard deviation of the magnitude of `ratio`, and of its angle times the magnitude."""
        relative = self.response.variance + abs(self.ratio) ** 2 * self.reference.variance
        return math.sqrt(relative) / abs(self.reference.value)


def tone_responses(recording: Recording, trial: Trial, channel: str) -> tuple[ToneResponse, ...]:
    """Return the response of a channel to every tone of the trial's signal.

    Raises:
        NotScored: no tone, samples without a value, or too few settled periods.
        MissingChannelError: no such channel.
    """
    if not trial.signal.tones:
        raise NotScored("the signal has no sine")
    return tuple(tone_response(recording, trial, channel, tone) for tone in trial.signal.tones)


def tone_response(recording: Recording, trial: Trial, channel: str, tone: Tone) -> ToneResponse:
    """Return the response of a channel to one tone; raises as `tone_responses`."""
    return remembered(
        recording, trial, ("tone", channel, tone), lambda: _respond(recording, trial, channel, tone)
    )


def _respond(recording: Recording, trial: Trial, channel: str, tone: Tone) -> ToneResponse:
    channel_samples = samples(recording, trial, channel)
    values = channel_samples.values
    line = timeline(recording, trial)
    label = f"{tone.frequency:.4g} Hz"
    if not tone.frequency > 0.0 or not math.isfinite(tone.frequency):
        raise NotScored(f"a tone of {label} has no period")
    if tone.frequency * line.period * _FEWEST_PER_PERIOD > 1.0:
        raise NotScored(f"fewer than {_FEWEST_PER_PERIOD} samples in a period of {label}")
    start, stop = tone.start, min(tone.stop, float(line.time[-1]) + line.period, trial.duration)
    start = max(start, float(line.time[0]))
    periods = math.floor((stop - start) * tone.frequency + 1e-3)
    if periods < TRANSIENT_PERIODS + 2:
        raise NotScored(
            f"{max(periods, 0)} period(s) of {label}: {TRANSIENT_PERIODS} are left out as the "
            "transient and two settled ones are needed"
        )
    whole = line.between(stop - periods / tone.frequency, stop)
    require_finite(line, values, whole)
    require_finite(line, line.reference, whole)
    there = (whole.stop - whole.start) * line.period * tone.frequency / periods
    if there < _THERE:
        raise NotScored(f"a gap: {100 * (1 - there):.0f} % of the {label} periods have no samples")
    frequency = _commanded_frequency(line, tone, whole)
    scale = magnitude(values[whole])
    if scale == 0.0:
        raise NotScored("the channel is zero throughout")
    data = values / scale
    block = 1 + (periods - TRANSIENT_PERIODS) // _BLOCKS
    blocks = (periods - TRANSIENT_PERIODS) // block
    every = periods if block == 1 else blocks
    whole_time = _block_phasors(line.time, data, stop, every, frequency / block, block)
    phasors = whole_time[:blocks]
    settled_blocks = _settled_periods(phasors)
    if settled_blocks * block < 2:
        raise NotScored(f"not settled: the {label} response changes from period to period")
    settled = settled_blocks * block
    window = line.between(stop - settled / frequency, stop)
    time = line.time[window] - stop
    command_scale = magnitude(line.reference[window]) or 1.0
    both = np.column_stack([data[window], line.reference[window] / command_scale])
    before = ringing(whole_time[::-1], settled) if block == 1 else Ringing()
    response, command = harmonic_fits(time, both, frequency, settled, [before])
    _require_stationary(phasors[:settled_blocks], response.variance, label)
    if not abs(command.phasors[0]) > 10.0 * math.sqrt(command.fundamental_variance) + 1e-9:
        raise NotScored(f"the reference holds no sine of {label}")
    notes = [f"{settled} settled periods of {periods}"]
    if response.transient != 0.0:
        share = 100.0 * abs(response.transient / (response.phasors[0] or 1.0))
        notes.append(f"a decaying transient of {share:.2g} % was removed")
    if line.how:
        notes.append(line.how)
    notes += channel_samples.notes(line, whole)
    amplitude = abs(response.phasors[0]) * scale
    return ToneResponse(
        frequency=frequency,
        reference=Phasor(
            command.phasors[0] * command_scale, command.fundamental_variance * command_scale**2
        ),
        response=Phasor(response.phasors[0] * scale, response.fundamental_variance * scale**2),
        harmonics=tuple(
            Phasor(value * scale, response.variance * scale**2) for value in response.phasors[1:]
        ),
        residual_rms=response.residual_rms * scale,
        freedom=response.freedom,
        periods=settled,
        onset=_onset(line, values, tone.start, amplitude),
        rounding=_rounding(channel_samples.resolution, amplitude),
        gain=channel_samples.relative,
        notes=tuple(notes),
    )


def _onset(line: Timeline, values: FloatArray, start: float, amplitude: float) -> float:
    """Return how long after `start` (s) the response has moved by a tenth of its amplitude, s."""
    first = line.between(start, float(line.time[-1]) + line.period).start
    if first < 1 and line.time[0] > start + 0.5 * line.period:
        return math.nan
    moved = np.abs(values[first:] - values[first]) > _MOVED * amplitude
    again = moved & np.append(moved[1:], False)  # two samples: one may be noise
    return float(line.time[first + int(np.argmax(again))]) - start if again.any() else math.nan


def _rounding(resolution: float, amplitude: float) -> float:
    """Return half the width of what rounding leaves of a sine's amplitude, same unit.

    Half a step of the sensor for a sine of a step; a larger one passes many steps, most of them
    steeply, and the rest falls with the root of their number.
    """
    steps = max(4.0 * amplitude / resolution, 1.0) if resolution > 0.0 else 1.0
    return 0.5 * resolution / math.sqrt(steps)


def _commanded_frequency(line: Timeline, tone: Tone, window: slice) -> float:
    """Return the tone's frequency; of a foreign recording, that of its own reference."""
    if not line.how:
        return tone.frequency
    reference = line.reference[window]
    scale = magnitude(reference)
    if scale == 0.0 or np.ptp(reference) == 0.0:
        return tone.frequency
    time = line.time[window]
    found = fit4(time - time[0], reference / scale, tone.frequency)
    # a clock that runs fast or slow, not another signal
    return found.frequency if abs(found.frequency / tone.frequency - 1.0) < 0.01 else tone.frequency


def _settled_periods(phasors: ComplexArray) -> int:
    """Return how many periods, from the last one backwards, are like the last half of them."""
    tail = phasors[: max(phasors.size // 2, 2)]
    centre = tail.mean()
    scatter = float(np.sqrt(np.mean(np.abs(tail - centre) ** 2)))
    # few of the last periods may be alike by luck
    scatter = max(scatter, float(np.median(np.abs(np.diff(phasors)))) / math.sqrt(2.0))
    alike = np.abs(phasors - centre) <= _STATIONARY * abs(centre) + 4.0 * scatter
    return int(phasors.size if np.all(alike) else np.argmin(alike))


def _require_stationary(phasors: ComplexArray, variance: float, label: str) -> None:
    """Raise NotScored if the newer half of the settled periods differs from the older half."""
    half = phasors.size // 2
    change = float(abs(phasors[:half].mean() - phasors[-half:].mean()))
    if phasors.size >= 4:
        # differences of neighbours are blind to a slow change, the residual of the fit is not
        each = float(np.mean(np.abs(np.diff(phasors)) ** 2)) / 2.0
        noise = math.sqrt(2.0 * each / half)
    else:
        noise = math.sqrt(4.0 * variance * phasors.size / half)
    size = float(abs(phasors.mean()))
    share = 100.0 * change / max(size, 1e-300)
    if change > _DRIFT * size + 4.0 * noise:
        raise NotScored(
            Note(
                "not settled: the {label} response changes by {share:.0f} % from the older to the "
                "newer half of its periods",
                label=label,
                share=share,
            )
        )


def _block_phasors(
    time: FloatArray, data: FloatArray, stop: float, count: int, rate: float, block: int
) -> ComplexArray:
    """Return the fundamental of each of the last `count` blocks of periods, the last one first."""
    found = np.zeros(count, dtype=np.complex128)
    slack = 1e-6 / rate
    for number in range(count):
        bounds = [stop - (number + 1) / rate - slack, stop - number / rate - slack]
        first, last = np.searchsorted(time, bounds)
        angle = 2.0 * np.pi * rate * block * (time[first:last] - stop)
        design = np.column_stack([np.ones(angle.size), np.cos(angle), np.sin(angle)])
        _, a, b = np.linalg.lstsq(design, data[first:last], rcond=None)[0]
        found[number] = complex(a, -b)
    return found

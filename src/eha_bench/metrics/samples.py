"""A channel's samples as they can be scored, and what a reader should know of them.

Spikes and single samples without a value are replaced by their neighbours' level, with a note; a
sensor's resolution comes from the recording's metadata, or from the step between its values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray
from eha_bench.core.recording import Recording
from eha_bench.core.sensor import sensors_of
from eha_bench.core.trial import Trial
from eha_bench.metrics.memo import remembered
from eha_bench.metrics.outliers import LONGEST_FILLED, filled, runs, spikes
from eha_bench.metrics.resolution import resolution_of
from eha_bench.metrics.window import Timeline

_CLIPPED = 5  # samples in a row at the extreme value
_STEEP = 1.5  # times what a round peak may come and go by
_SLOWED = (
    0.6  # of the step two earlier: what is left of it where readings come to rest by themselves
)
_SLOWING = 7  # steps
_BESIDE = 4  # samples before and after a stay at an extreme, at least
_ELSEWHERE = 0.02  # share of samples like the one before, above which that is nothing special
_MOST_MISSING = 0.05
_POSSIBLE = {
    "Pa": (-1e7, 1e9),
    "A": (-1e5, 1e5),
    "rad/s": (-1e5, 1e5),
    "m": (-1e3, 1e3),
    "m/s": (-1e4, 1e4),
    "rad": (-1e4, 1e4),
    "N": (-1e9, 1e9),
    "K": (0.0, 5e3),
}
"""What a sensor of a rig can read at all, by unit; differences of pressures may be negative."""


@dataclass(frozen=True, eq=False)
class Clipping:
    """Readings that stay at the end of their sensor's range.

    Attributes:
        level: SI.
        at: (n,) the samples of the window that do.
        above: whether what was cut off lies above; of a part of a difference: in the difference.
        left: whether the readings leave the end again within the window.
        name: channel.
    """

    level: float
    at: BoolArray
    above: bool
    left: bool
    name: str


@dataclass(frozen=True, eq=False)
class Samples:
    """One channel on the clock of its recording.

    Attributes:
        name, unit: of the channel.
        values: (n,) SI; spikes and short gaps filled, NaN where a gap is longer.
        missing: (n,) whether a sample had no value and was filled.
        spikes: (n,) whether a sample was no measurement and was replaced.
        resolution: of the sensor, SI; 0 where there is none to be seen.
        uncertainty: standard uncertainty of the calibration that all samples share, SI.
        relative: the same as a share of the reading.
        parts: channels that a difference is derived from, with their signs; none of a measured one.
    """

    name: str
    unit: str
    values: FloatArray
    missing: BoolArray
    spikes: BoolArray
    resolution: float
    uncertainty: float
    relative: float
    parts: tuple[tuple[Samples, float], ...] = ()

    def calibration(self, level: float) -> float:
        """Return the standard uncertainty of a level's calibration, SI."""
        return math.hypot(self.uncertainty, self.relative * level)

    def notes(self, line: Timeline, window: slice) -> tuple[str, ...]:
        """Return what is special about the samples of a window, one clause each."""
        found = [
            _count_note(self.spikes, line, window, "outlier(s) replaced by their neighbours"),
            _count_note(self.missing, line, window, "sample(s) without a value not used"),
            lost_samples_note(line, window),
            self._clipping_note(line, window),
            self._impossible(window),
        ]
        return tuple(note for note in found if note)

    def clippings(self, window: slice) -> tuple[Clipping, ...]:
        """Return where a sensor's ends cut the samples of a window off.

        A difference is cut off where one of its parts is at its upper end.
        """
        own = [self._clipping(self.values[window], above=above) for above in (True, False)]
        found = [clipping for clipping in own if clipping is not None]
        for part, sign in self.parts:
            whole = part._clipping(part.values[window], above=True)
            if whole is not None:
                found.append(replace(whole, above=sign > 0.0, name=part.name))
        return tuple(found)

    def cut_off(self, window: slice) -> tuple[Clipping, ...]:
        """Return where a sensor's ends cut the samples of a window off that leave them again.

        What stays at its extreme to the end of a window may as well have come to rest there.
        """
        return tuple(found for found in self.clippings(window) if found.left)

    def _clipping(self, values: FloatArray, *, above: bool) -> Clipping | None:
        if values.size < 2 * _CLIPPED:
            return None
        extreme = float(values.max() if above else values.min())
        at = values == extreme
        if np.count_nonzero(at) < _CLIPPED:
            return None
        # at the start a channel rests: no sensor's end shows before it has moved there
        reached = [run for run in runs(at) if run[0] > 0 and not _round(values[: run[0] + 1])]
        longest = max((stop - start for start, stop in reached), default=0)
        ends = (values == values.max(), values == values.min())
        elsewhere = ~np.any([end[1:] & end[:-1] for end in ends], axis=0)
        if longest < _CLIPPED or np.count_nonzero(elsewhere) < _CLIPPED:
            return None
        alone = float(np.mean((np.diff(values) == 0.0)[elsewhere])) <= _ELSEWHERE
        if not alone and not any(self._cut_off(values, *run) for run in reached):
            return None
        at = np.zeros(values.size, dtype=np.bool_)
        for start, stop in reached:
            at[start:stop] = True
        left = any(stop < values.size for _, stop in reached)
        return Clipping(extreme, at, above, left, self.name)

    def _clipping_note(self, line: Timeline, window: slice) -> str:
        times = line.time[window]
        notes = []
        for found in self.clippings(window):
            of = "" if found.name == self.name else f"of {found.name} "
            notes.append(
                f"clipped: {np.count_nonzero(found.at)} samples {of}at exactly "
                f"{found.level:.4g} {self.unit}, the first at "
                f"{float(times[int(np.argmax(found.at))]) + line.offset:.6g} s"
            )
        return "; ".join(notes)

    def _cut_off(self, values: FloatArray, start: int, stop: int) -> bool:
        """Whether (n,) readings stay at an extreme that they came to, and left, too steeply.

        A round peak that is within a step q of the sensor for T samples comes and goes, over b
        samples, by no more than 4 q (T + b) / T^2 a sample, and q / b by rounding.
        """
        length = stop - start
        if not self.resolution > 0.0 or length < _CLIPPED:
            return False
        beside = max(_BESIDE, length // 3)
        if start < beside or stop + beside > values.size:
            return False
        least = self.resolution * (4.0 * (length + beside) / length**2 + 1.0 / beside)
        came = abs(float(values[start] - values[start - beside])) / beside
        left = abs(float(values[stop - 1 + beside] - values[stop - 1])) / beside
        return min(came, left) > _STEEP * least

    def _impossible(self, window: slice) -> str:
        values = self.values[window]
        low, high = _POSSIBLE.get(self.unit, (-math.inf, math.inf))
        if "difference" in self.name:
            low = -high
        worst = float(values[int(np.argmax(np.abs(values)))]) if values.size else 0.0
        if low <= worst <= high:
            return ""
        return (
            f"{worst:.3g} {self.unit} is beyond the range of any such sensor: check unit and "
            "scale of the channel"
        )


def _round(before: FloatArray) -> bool:
    """Whether (n,) readings slow down evenly before they stay, as what stops by itself does.

    The steps of what slows down evenly are as 1 to 2 to 3 to 4, those of what is cut off are alike.
    Noise lets no step be smaller than the one before, seven times in a row.
    """
    steps = np.abs(np.diff(before[-_SLOWING - 1 :]))
    slower = steps.size == _SLOWING and bool(np.all(np.diff(steps) < 0.0))
    return slower and bool(steps[-2] <= _SLOWED * steps[-4])


def samples(recording: Recording, trial: Trial, channel: str) -> Samples:
    """Return a channel as it can be scored.

    Raises:
        MissingChannelError: no such channel.
    """
    return remembered(
        recording, trial, ("samples", channel), lambda: _samples(recording, trial, channel)
    )


def _samples(recording: Recording, trial: Trial, channel: str) -> Samples:
    values = recording[channel]
    none = np.zeros(values.size, dtype=np.bool_)
    sensors = sensors_of(recording, channel)
    steps = [
        sensor.resolution or resolution_of(recording[name]) for name, sensor in sensors.items()
    ]
    absolute = math.sqrt(math.fsum(sensor.uncertainty**2 for sensor in sensors.values()))
    resolution = math.sqrt(math.fsum(step**2 for step in steps))
    missing, odd = none, none
    bad = ~np.isfinite(values)
    if bad.any():
        missing = _short(bad & np.isnan(values))
        if missing.any():
            values = filled(values, missing)
    finite = np.isfinite(values) if bad.any() else ~none
    places = spikes(recording.time[finite], values[finite], resolution)
    if places.size:
        odd = np.array(none)
        odd[np.flatnonzero(finite)[places]] = True
        values = filled(values, odd)
    return Samples(
        name=channel,
        unit=recording.unit(channel),
        values=values,
        missing=missing,
        spikes=odd,
        resolution=resolution,
        uncertainty=absolute,
        relative=_relative(recording, channel),
        parts=tuple(
            (samples(recording, trial, name), sign)
            for name, sign in zip(sensors, (1.0, -1.0), strict=False)
            if name != channel
        ),
    )


def _relative(recording: Recording, channel: str) -> float:
    """Return the relative uncertainty; of a difference, that of its parts taken together."""
    sensors = sensors_of(recording, channel)
    if len(sensors) == 1:
        return next(iter(sensors.values())).relative
    whole = _usual_size(recording[channel])
    parts = [s.relative * _usual_size(recording[name]) for name, s in sensors.items()]
    total = math.sqrt(math.fsum(part**2 for part in parts))
    return total / whole if whole > 0.0 and math.isfinite(total / whole) else 0.0


def _usual_size(values: FloatArray) -> float:
    """Return the mean size of a channel's readings, 0 where it has none."""
    sizes = np.abs(values[np.isfinite(values)])
    with np.errstate(over="ignore"):
        return float(sizes.mean()) if sizes.size else 0.0


def _short(bad: BoolArray) -> BoolArray:
    """Return the samples without a value that their neighbours can stand for."""
    chosen = np.zeros(bad.size, dtype=np.bool_)
    if np.count_nonzero(bad) > _MOST_MISSING * bad.size:
        return chosen
    for start, stop in runs(bad):
        if stop - start <= LONGEST_FILLED and start > 0 and stop < bad.size:
            chosen[start:stop] = True
    return chosen


def _count_note(flags: BoolArray, line: Timeline, window: slice, what: str) -> str:
    inside = flags[window]
    count = int(np.count_nonzero(inside))
    if count == 0:
        return ""
    first = float(line.time[window][int(np.argmax(inside))]) + line.offset
    return f"{count} {what}, the first at {first:.6g} s"


def lost_samples_note(line: Timeline, window: slice) -> str:
    """Return how many samples of a window are not there, or ""."""
    gaps = np.diff(line.time[window])
    wide = gaps > 1.5 * line.period
    if not wide.any():
        return ""
    count = int(np.sum(np.round(gaps[wide] / line.period) - 1))
    share = 100.0 * count / (count + gaps.size + 1)
    longest = int(np.argmax(gaps))
    at = float(line.time[window][longest]) + line.offset
    return (
        f"{count} sample(s) lost ({share:.2g} %), "
        f"the longest gap of {float(gaps[longest]):.4g} s after {at:.6g} s"
    )

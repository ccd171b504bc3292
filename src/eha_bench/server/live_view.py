"""A run that is on: its channels over the last seconds, and how its loop is kept."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from markupsafe import Markup

from eha_bench.core.arrays import FloatArray
from eha_bench.core.recording import Recording
from eha_bench.recordings import read
from eha_bench.report.engineering import channel_name, decimals_for, display_unit, number
from eha_bench.report.envelope import envelope_indices

LATE: Final = 1.5
"""Sample periods between two ticks above which the later one is late."""

_SHOWN: Final = 20.0  # s
_WIDTH: Final = 600.0
_HEIGHT: Final = 48.0
_EDGE: Final = 2.0
_POINTS: Final = 500


@dataclass(frozen=True)
class ChannelView:
    """A channel as the page shows it: its name, newest value and range, and its course."""

    name: str
    newest: str
    unit: str
    low: str
    high: str
    course: Markup


@dataclass(frozen=True)
class LiveView:
    """A run that is on, as its page shows it.

    Attributes:
        trial: which trial's recording it is, with its repeat.
        seconds: length of the recording so far; the channels show its end.
        shown: seconds of it that they show.
        loop: how the loop is kept so far, as a sentence.
        channels: in the order of the recording.
    """

    trial: str
    seconds: float
    shown: float
    loop: str
    channels: tuple[ChannelView, ...]


def live_view(path: Path) -> LiveView:
    """Return what a recording that still grows holds so far.

    Raises:
        EhaBenchError: nothing of it can be read yet.
    """
    recording = read(path)
    time = recording.time
    first = int(np.searchsorted(time, time[-1] - _SHOWN)) if time.size else 0
    shown = float(time[-1] - time[first]) if time.size else 0.0
    return LiveView(
        trial=path.stem,
        seconds=float(time[-1] - time[0]) if time.size else 0.0,
        shown=shown,
        loop=loop_so_far(time),
        channels=tuple(_channel(recording, name, first) for name in recording.values),
    )


def loop_so_far(time: FloatArray) -> str:
    """Return how regular the ticks at (n,) s are, as a sentence."""
    if time.size < 3:
        return f"{time.size} tick{'' if time.size == 1 else 's'} so far"
    periods = np.diff(time)
    usual = float(np.median(periods))
    late = int(np.count_nonzero(periods > LATE * usual))
    often, most = float(np.quantile(periods, 0.999)), float(periods.max())
    return (
        f"Period {usual * 1e3:.3f} ms at the median, {often * 1e3:.3f} ms at 99.9 %, "
        f"{most * 1e3:.3f} ms at most; {late} of {time.size} ticks late by more than half a period"
    )


def _channel(recording: Recording, name: str, first: int) -> ChannelView:
    values = recording[name][first:]
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (np.nan, np.nan)
    newest = float(values[-1]) if values.size else np.nan
    unit = display_unit(recording.unit(name), (low, high))
    # the digits of the larger end, so that the three compare at a glance and do not jump
    places = decimals_for(max(abs(unit.from_si(low)), abs(unit.from_si(high))))
    shown = [number(round(unit.from_si(value), places), places) for value in (newest, low, high)]
    return ChannelView(
        name=channel_name(name),
        newest=shown[0],
        unit=unit.symbol,
        low=shown[1],
        high=shown[2],
        course=_course(recording.time[first:], values, low, high),
    )


def _course(time: FloatArray, values: FloatArray, low: float, high: float) -> Markup:
    """Return the course of a channel as a small plot without axes."""
    kept = envelope_indices(values, _POINTS) if values.size else np.zeros(0, np.intp)
    kept = kept[np.isfinite(values[kept])]
    path = ""
    if kept.size > 1 and time[-1] > time[0]:
        span = high - low or 1.0
        x = _WIDTH * (time[kept] - time[0]) / (time[-1] - time[0])
        y = _EDGE + (_HEIGHT - 2.0 * _EDGE) * (high - values[kept]) / span
        path = "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))
    return Markup(
        f'<svg class="spark live" viewBox="0 0 {_WIDTH:.0f} {_HEIGHT:.0f}" '
        'preserveAspectRatio="none" aria-hidden="true" focusable="false">'
        f'<path d="{path}" fill="none" stroke="var(--blue)" stroke-width="1.4" '
        'vector-effect="non-scaling-stroke"/></svg>'
    )

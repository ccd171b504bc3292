"""Where a trial lies in a recording: the clock of the signal, and what was really commanded.

Recordings made by the bench say it themselves (metadata `signal_start`: the recording's time at
which the signal's time 0 lies). In recordings made elsewhere the trial is found in the `reference`
channel: by its own jumps where the signal has edges, else by correlation. Without either, nothing
that needs the command is scored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.recording import Recording
from eha_bench.core.signal import Edge
from eha_bench.core.trial import Trial
from eha_bench.metrics.memo import remembered
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.outliers import LONGEST_FILLED
from eha_bench.metrics.search import best_lag

SIGNAL_START = "signal_start"
"""Metadata key: time of the recording, in s, at which the trial's signal starts."""

_FASTEST = 1e-12  # s: samples closer than this, or a longer recording, are not clock's ...
_LONGEST = 1e12  # ... and differences and squares of their times leave the floating-point range
_UNEVEN = 0.02  # of the period: intervals that differ by more than a clock's rounding
_SAME_LEVEL = 0.05  # of the jump: closer than this, two sampled levels of the reference are one


@dataclass(frozen=True)
class Timeline:
    """A recording on the clock of its trial's signal.

    Attributes:
        time: (n,) s since the start of the signal, negative while settling.
        reference: (n,) the command in SI; recorded where it was recorded, else as the trial says.
        offset: the recording's time at the start of the signal, s.
        period: median time between samples, s.
        recorded: whether `reference` was recorded.
        how: how the signal was found, for the reason of a score; "" for the bench's own recordings.
    """

    time: FloatArray
    reference: FloatArray
    offset: float
    period: float
    recorded: bool
    how: str

    @cached_property
    def irregular(self) -> bool:
        """Whether samples come at uneven times, and not only with some of them lost."""
        return bool(np.median(np.abs(np.diff(self.time) / self.period - 1.0)) > _UNEVEN)

    def lost(self, window: slice) -> list[tuple[float, float]]:
        """Return where more samples are lost than their neighbours can stand for, s, from to."""
        if self.irregular:
            return []
        time = self.time[window]
        wide = np.flatnonzero(np.diff(time) > (LONGEST_FILLED + 1.5) * self.period)
        return [(float(time[k]), float(time[k + 1])) for k in wide]

    def between(self, start: float, stop: float) -> slice:
        """Return the samples with start <= time < stop (to within a thousandth of a sample)."""
        slack = 1e-3 * self.period
        first, last = np.searchsorted(self.time, [start - slack, stop - slack])
        return slice(int(first), int(last))


def timeline(recording: Recording, trial: Trial) -> Timeline:
    """Return the recording on the clock of the trial's signal.

    Raises:
        NotScored: too few samples, or it cannot be known where the signal lies.
    """
    return remembered(recording, trial, "timeline", lambda: _timeline(recording, trial))


def _timeline(recording: Recording, trial: Trial) -> Timeline:
    if len(recording) < 2:
        raise NotScored(f"the recording has {len(recording)} sample(s)")
    period = recording.sample_period
    span = float(recording.time[-1] - recording.time[0])
    if not (period >= _FASTEST and span <= _LONGEST):
        raise NotScored(f"the clock is none: a sample every {period:.3g} s, for {span:.3g} s")
    recorded = "reference" in recording.values
    own = _own_start(recording)
    if own is not None:
        time = recording.time - own
        reference = recording["reference"] if recorded else trial.signal(time)
        return Timeline(time, reference, own, period, recorded, "")
    if not recorded:
        raise NotScored(
            f"no reference, and no '{SIGNAL_START}' in the metadata: "
            "it is not known when the command came"
        )
    offset, how = _find(recording.time, recording["reference"], trial, period)
    return Timeline(recording.time - offset, recording["reference"], offset, period, True, how)


def _own_start(recording: Recording) -> float | None:
    text = recording.metadata.get(SIGNAL_START)
    if text is None:
        return None
    try:
        start = float(text)
    except ValueError:
        start = math.nan
    if not math.isfinite(start):
        raise NotScored(f"metadata '{SIGNAL_START}' is '{text}', not a time in s")
    return start


# --- finding the signal in a foreign recording -----------------------------------------------


def _find(
    time: FloatArray, reference: FloatArray, trial: Trial, period: float
) -> tuple[float, str]:
    if not np.all(np.isfinite(reference)):
        first = float(time[int(np.argmin(np.isfinite(reference)))])
        raise NotScored(f"the reference has no value at {first:.6g} s")
    if np.ptp(reference) == 0.0:
        raise NotScored("the reference does not change: the command is not in this recording")
    edges = trial.signal.edges
    if edges:
        return _find_edges(time, reference, edges, trial)
    offset, likeness = best_lag(time, reference, trial.signal, trial.duration, period)
    if not likeness > 0.9:
        raise NotScored(
            "the recorded reference is not this trial's signal "
            f"(best correlation {max(likeness, 0.0):.2f})"
        )
    return offset, f"signal found in the recorded reference (correlation {likeness:.3f})"


def jumps(time: FloatArray, reference: FloatArray) -> list[Edge]:
    """Return the jumps of a sampled reference, levels as sampled, each held until the next one.

    A jump is a run of at most three samples that changes by more than a twentieth of the span.
    """
    span = float(np.ptp(reference))
    change = np.diff(reference)
    large = np.flatnonzero(np.abs(change) > _SAME_LEVEL * span)
    if large.size == 0:
        return []
    groups = np.split(large, np.flatnonzero(np.diff(large) > 1) + 1)
    found: list[tuple[int, int]] = [
        (int(group[0]), int(group[-1]) + 1) for group in groups if group.size <= 3
    ]
    starts = [first + 1 for first, _ in found] + [time.size]
    edges = []
    for number, (first, last) in enumerate(found):
        stop = starts[number + 1] - 1 if number + 1 < len(found) else time.size
        after = float(np.median(reference[last : max(stop, last + 1)]))
        begin = found[number - 1][1] if number else 0
        before = float(np.median(reference[min(begin, first) : first + 1]))
        until = float(time[stop]) if stop < time.size else float(2 * time[-1] - time[-2])
        edges.append(Edge(float(time[first + 1]), before, after, until))
    return edges


def _find_edges(
    time: FloatArray, reference: FloatArray, edges: tuple[Edge, ...], trial: Trial
) -> tuple[float, str]:
    found = jumps(time, reference)
    if not found:
        raise NotScored("the recorded reference has no jump: the step is not in this recording")
    lengths = [trial.duration, *(edge.until for edge in edges)]
    stop = min(length for length in lengths if length > edges[0].time)
    best, likeness = math.nan, -math.inf
    for jump in found[:200]:
        offset = jump.time - edges[0].time
        score = _match(time - offset, reference, trial, edges, max(stop, edges[-1].time))
        if score > likeness + 1e-9:
            best, likeness = offset, score
    if not likeness > 0.5:
        raise NotScored("the recorded reference does not jump as this trial's signal does")
    return best, "command's edge at the first sample of the recorded reference after its jump"


def _match(
    time: FloatArray, reference: FloatArray, trial: Trial, edges: tuple[Edge, ...], stop: float
) -> float:
    """Return 1 for the trial's own reference, less for another size, below 0 for another shape."""
    sizes = max(abs(edge.after - edge.before) for edge in edges)
    # slow logs have few samples before the edge; two at least show it
    two = 2.5 * float(np.median(np.diff(time)))
    lead = max(min(0.1 * (stop - edges[0].time), max(edges[0].time, 0.0) + 0.02), two)
    inside = (time >= edges[0].time - lead) & (time < stop)
    if sizes == 0.0 or np.count_nonzero(inside) < 2:
        return -math.inf
    expected = trial.signal(time[inside])
    actual = reference[inside]
    centred, wanted = actual - actual.mean(), expected - expected.mean()
    power = float(wanted @ wanted)
    if power == 0.0:
        return -math.inf
    gain = float(centred @ wanted) / power
    rest = float(np.sum((centred - gain * wanted) ** 2)) / max(float(centred @ centred), 1e-300)
    if gain <= 0.0:
        return -math.inf
    offset_error = float(abs(actual.mean() - expected.mean())) / sizes
    return 1.0 - rest - 0.1 * min(abs(math.log(gain)), 1.0) - 0.1 * min(offset_error, 1.0)


# --- the edges as they were commanded ---------------------------------------------------------


def edges_of(recording: Recording, trial: Trial) -> tuple[Edge, ...]:
    """Return what `commanded_edges` finds in a recording; several metrics ask for it."""
    return remembered(
        recording, trial, "edges", lambda: commanded_edges(timeline(recording, trial), trial)
    )


def commanded_edges(line: Timeline, trial: Trial) -> tuple[Edge, ...]:
    """Return the trial's edges with the times and levels that the reference really had.

    The time of an edge is that of the first sample at the new level (a sampled command holds its
    value from there on); an edge ends where the reference leaves its level, or with the recording.
    """
    if not trial.signal.edges:
        raise NotScored("the signal has no edge")
    return tuple(_commanded_edge(line, edge) for edge in trial.signal.edges)


def _commanded_edge(line: Timeline, edge: Edge) -> Edge:
    time, reference, period = line.time, line.reference, line.period
    end = float(time[-1]) + period
    size = edge.after - edge.before
    if size == 0.0 or not time[0] <= edge.time < end:
        raise NotScored(f"the recording does not hold the edge at {edge.time:.6g} s of the signal")
    until = min(edge.until, end)
    if not line.recorded:
        return Edge(edge.time, edge.before, edge.after, until)
    # the tick that carries the new command is the first one at or after the edge; two samples of
    # slack for clocks that are not the controller's
    near = line.between(edge.time - 2.5 * period, edge.time + 2.5 * period)
    window = reference[near]
    if not np.all(np.isfinite(window)):
        raise NotScored(f"the reference has no value at its edge at {edge.time:.6g} s")
    first = near.start
    if window.size > 1 and np.ptp(window) > 0.0:
        middle = (float(window[0]) + float(window[-1])) / 2.0
        beyond = (window > middle) == (window[-1] > window[0])
        first = near.start + int(np.argmax(beyond & (window[-1] != window[0])))
        before = float(window[0])
        start = float(time[first])
        lost_its_own = first > 0 and start - float(time[first - 1]) > 1.5 * period
        if lost_its_own and not line.how and not line.irregular:
            # the edge's own tick is lost; the bench's clock knows when it was
            late = math.floor((start - edge.time) / period + 1e-3)
            lost = round((start - float(time[first - 1])) / period) - 1
            start -= min(max(late, 0), lost) * period
    else:
        before, start = edge.before, edge.time
        first = int(np.searchsorted(time, edge.time - 1e-3 * period))
    held = line.between(start, until)
    levels = reference[held]
    if levels.size == 0 or not np.all(np.isfinite(levels)):
        raise NotScored(f"the reference has no value after its edge at {edge.time:.6g} s")
    after = float(np.median(levels))
    if after == before:
        raise NotScored(f"the reference does not jump at {edge.time:.6g} s of the signal")
    away = np.flatnonzero(np.abs(levels - after) > _SAME_LEVEL * abs(after - before))
    later = away[away > 2]
    if later.size:
        until = float(time[held.start + int(later[0])])
    return Edge(start, before, after, until)

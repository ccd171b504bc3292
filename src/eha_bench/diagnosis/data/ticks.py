"""Topics of a log on common ticks, each sample at its own instant near one.

A plain log has a topic for each sensor, at its own rate and with its own losses. Nothing is carried
from one topic's clock onto another's: a model is simulated from tick to tick, and a sample is held
against the simulation at its own instant. Ticks are those of what drives the model, so that a
command acts from its own stamp; ticks whose command was lost are there too, their value unknown.
An output's sample belongs to the tick next to it, and `taken` says how long after it was taken.
Where no tick is near, it gets its own.

Stamps a little off a regular clock, while the readings follow that clock, are put back on it
(`clock`). Whatever is off the ticks of the inputs by always the same may only be stamped so:
how late is a number that a fit has to find (`late`). What is stamped later by
many ticks is read earlier from the start (`stamped_late`): its samples belong to other ticks.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.core.note import Note
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.clock import ClockEvidence, RegularClock, clock_beside, clock_evidence
from eha_bench.recordings.series import without_counts_of_rows

_SAME = 0.05
"""What samples of one tick lie apart at most, in periods of the fastest topic."""
_USUALLY = 0.9
"""Quantile of what a topic is off ticks that has to be so little."""
_LITTLE = 50e-6
"""What samples lie off their ticks, as a root mean square, and still are of their instants, s."""
_FURTHEST = 0.5e-3
"""Largest distance of a sample from its tick, s: a simulation is taken to be straight so far."""
_PERIODIC = 0.25
"""What most steps of a topic that ticks regularly differ by from the usual one, as a share."""
_OTHERS = 0.1
"""Share of a table's rows without an input from which these are rows of another clock."""
_ALIKE = 0.1
"""Share of a channel's rows without another one up to which both tick together."""
_MOSTLY = 0.5
"""Least share of steps of one period of a topic that ticks regularly."""
_LOST = 20
"""Most messages in a row that a regular topic may lose and still have lost them."""


@dataclass(frozen=True)
class Sampled:
    """A recording on common ticks.

    Attributes:
        recording: values at the ticks; NaN where a channel has no sample at one.
        taken: channel -> (n,) s that its samples were taken after their ticks; without: at them.
        late: channel -> name of the clock that may be stamped late by always the same.
        topic_of: channel -> name of its topic's clock, of topics that drive nothing.
        lost: channel -> (n,) ticks at which a message of an input was lost.
        is_of_several: whether channels tick on different clocks.
        logged: (n,) ticks with a row in the log; None where all have one, or topics are several.
    """

    recording: Recording
    taken: Mapping[str, FloatArray] = field(default_factory=dict)
    late: Mapping[str, str] = field(default_factory=dict)
    topic_of: Mapping[str, str] = field(default_factory=dict)
    lost: Mapping[str, BoolArray] = field(default_factory=dict)
    is_of_several: bool = False
    logged: BoolArray | None = None


@dataclass(frozen=True, eq=False)
class _Topic:
    """The samples of channels that tick together.

    Attributes:
        part: their recording. names: channels that matter. time: (m,) s, as samples were taken.
        clock: regular one, if they have one.
        behind: by how much all samples are behind the ticks of what drives, s, if they are.
    """

    part: Recording
    names: tuple[str, ...]
    time: FloatArray
    clock: RegularClock | None
    behind: float = 0.0

    @property
    def title(self) -> str:
        """What it is called in notes."""
        return ", ".join(self.names)


def on_ticks(
    topics: Sequence[Recording],
    inputs: Collection[str],
    outputs: Collection[str],
    stamped_late: Mapping[str, float] | None = None,
) -> Sampled:
    """Return topics of one log on common ticks; a single one with ticks for rows that were lost.

    Args:
        topics: recordings whose time has a common zero.
        inputs: channels that drive a model. outputs: channels that are compared with it.
        stamped_late: channel -> s by which its topic is read earlier than it is stamped.
    """
    if len(topics) == 1:
        topics = _interleaved(topics[0], inputs)
    if len(topics) == 1:
        return _with_lost_rows(topics[0])
    wanted = {*inputs, *outputs}
    earlier = stamped_late or {}
    used = [_topic(item, wanted, earlier) for item in topics if wanted & {*item.values}]
    if not used:
        return Sampled(topics[0])
    placed, notes = _at_their_clocks(used)
    driving = [item for item in placed if {*item.names} & {*inputs}]
    if not driving:
        driving = [max(placed, key=lambda item: item.time.size)]
    period = min(_usual(item.time) for item in placed)
    ticks = _driving_ticks(driving, _SAME * period)
    near = 0.5 * _usual(ticks)
    # what is behind by always the same keeps no ticks of its own: noise is told from tick to tick
    placed = [
        item if item in driving else replace(item, behind=_behind(ticks, item.time, _SAME * period))
        for item in placed
    ]
    beside = [item for item in placed if item not in driving]
    for item in sorted(beside, key=lambda item: -item.time.size):
        reach = near if item.behind else min(near, _FURTHEST)
        ticks = _with_own(ticks, item.time - item.behind, reach)
    values: dict[str, FloatArray] = {}
    taken: dict[str, FloatArray] = {}
    late: dict[str, str] = {}
    topic_of: dict[str, str] = {}
    lost: dict[str, BoolArray] = {}
    firsts, lasts = [], []
    for item in placed:
        at = nearest(ticks, item.time - item.behind)
        after = item.time - ticks[at]
        same = float(np.quantile(np.abs(after), _USUALLY)) <= _SAME * period
        # of slow topics that is much: some may share a command's tick half a millisecond off
        same &= float(np.sqrt(np.mean(after**2))) <= _LITTLE
        offsets = np.zeros(ticks.size)
        shifted = not earlier.keys().isdisjoint(item.names)
        if item not in driving:
            topic_of |= dict.fromkeys(item.names, item.names[0])
        if item not in driving and (shifted or not same):
            offsets[at] = after
            taken |= dict.fromkeys(item.names, offsets)
            late |= dict.fromkeys(item.names, item.names[0])
        for name in item.names:
            values[name] = np.full(ticks.size, np.nan)
            values[name][at] = item.part.values[name]
        if item in driving:
            there = np.zeros(ticks.size, dtype=np.bool_)
            there[nearest(ticks, _with_lost_ticks(item.time))] = True
            there[at] = False
            lost |= dict.fromkeys(item.names, there)
        firsts.append(int(at[0]))
        lasts.append(int(at[-1]) if item not in driving else ticks.size - 1)
    kept = slice(max(firsts), min(lasts) + 1)
    first = placed[0].part
    recording = Recording(
        ticks[kept],
        {name: column[kept] for name, column in values.items()},
        {name: item.part.unit(name) for item in placed for name in item.names},
        epoch_ns=first.epoch_ns,
        metadata=first.metadata,
        attachments=first.attachments,
        notes=(*dict.fromkeys(note for item in topics for note in item.notes), *notes),
        source=first.source,
        damaged=first.damaged,
    )
    return Sampled(
        recording,
        {name: column[kept] for name, column in taken.items()},
        late,
        topic_of,
        {name: mask[kept] for name, mask in lost.items()},
        is_of_several=True,
    )


def _interleaved(table: Recording, inputs: Collection[str]) -> list[Recording]:
    """Return the topics of a table into which several clocks were written, with empty cells.

    A cell of an input that is empty in a row of another clock is no lost message.
    """
    there = {name: np.isfinite(values) for name, values in table.values.items()}
    if not any(_is_between(there[name]) for name in inputs if name in there):
        return [table]
    groups: list[list[str]] = []
    for name in sorted(there, key=lambda name: -np.count_nonzero(there[name])):
        own = there[name]
        few = _ALIKE * np.count_nonzero(own)
        for group in groups:
            others = there[group[0]]
            # a slower sensor has some of a faster one's rows; a command acts on until its next
            slower = name not in inputs or np.count_nonzero(others & ~own) <= few
            if slower and np.count_nonzero(own & ~others) <= few:
                group.append(name)
                break
        else:
            groups.append([name])
    notes = without_counts_of_rows(table.notes) if len(groups) > 1 else table.notes
    parts = []
    for group in groups:
        rows = np.any([there[name] for name in group], axis=0)
        if rows.any():
            values = {name: table.values[name][rows] for name in group}
            parts.append(replace(table, time=table.time[rows], values=values, notes=notes))
    return parts


def _behind(ticks: FloatArray, time: FloatArray, much: float) -> float:
    """Return by how much samples are always behind ticks, s; 0 where that is little or changes."""
    before = ticks[np.maximum(np.searchsorted(ticks, time + much, side="right") - 1, 0)]
    usual = float(np.median(time - before))
    left = time - usual - ticks[nearest(ticks, time - usual)]
    always = float(np.quantile(np.abs(left), _USUALLY)) <= much
    return usual if always and usual > much else 0.0


def _is_between(there: BoolArray) -> bool:
    """Whether an input has its rows between those of others; what fails for a while has not."""
    rows = np.flatnonzero(there)
    if not 0 < rows.size < (1.0 - _OTHERS) * there.size:
        return False
    empty = np.diff(rows) - 1
    return bool(empty[empty <= _LOST].sum() > (1.0 - _OTHERS) * empty.sum())


def _with_lost_rows(table: Recording) -> Sampled:
    """Return a table with ticks at which its rows were lost: what was commanded there acted."""
    time = np.array(table.time)
    ticks = _with_lost_ticks(time)
    if ticks.size == time.size:
        return Sampled(table)
    there = np.isin(ticks, time)
    values = {name: np.full(ticks.size, np.nan) for name in table.values}
    for name, column in values.items():
        column[there] = table.values[name]
    return Sampled(replace(table, time=ticks, values=values), logged=there)


def nearest(ticks: FloatArray, time: FloatArray) -> IndexArray:
    """Return the place of the tick that is nearest to each instant, (m,)."""
    after = np.clip(np.searchsorted(ticks, time), 1, ticks.size - 1)
    return np.asarray(after - (time - ticks[after - 1] < ticks[after] - time))


def _topic(part: Recording, wanted: Collection[str], late: Mapping[str, float]) -> _Topic:
    names = tuple(name for name in part.values if name in wanted)
    time = np.array(part.time) - next((late[name] for name in names if name in late), 0.0)
    return _Topic(part, names, time, clock_beside(time))


def _at_their_clocks(topics: Sequence[_Topic]) -> tuple[list[_Topic], list[Note]]:
    """Return topics on regular clocks where the log's readings do not speak for its stamps."""
    evidence = ClockEvidence()
    for item in topics:
        if item.clock is not None:
            evidence += clock_evidence(item.clock, [item.part.values[name] for name in item.names])
    regular = not (evidence.is_decisive and evidence.for_stamps)
    found, notes = [], []
    for item in topics:
        own = item
        period = _usual(item.time) if item.clock is None else item.clock.period
        text = "{topic}: every {period:.4g} ms"
        values: dict[str, str | int | float] = {"topic": item.title, "period": 1e3 * period}
        if item.clock is not None:
            if item.clock.lost:
                text += ", {lost:d} of {sent:d} messages lost"
                values |= {"lost": item.clock.lost, "sent": item.clock.lost + item.time.size}
            if regular:
                own = replace(item, time=item.clock.times)
            if 1e3 * item.clock.beside >= 1e-3:
                how = "which is used" if regular else "but the readings follow the stamps"
                text += ", stamps {off:.2g} ms off a regular clock, {how}"
                values |= {"off": 1e3 * item.clock.beside, "how": how}
        found.append(own)
        notes.append(Note(text, **values))
    return found, notes


def _usual(time: FloatArray) -> float:
    return float(np.median(np.diff(time))) if time.size > 1 else np.inf


def _driving_ticks(driving: Sequence[_Topic], same: float) -> FloatArray:
    """Return the ticks of all that drives a model, lost ones included, the fastest's first."""
    ticks = np.zeros(0)
    for item in sorted(driving, key=lambda item: -item.time.size):
        time = _with_lost_ticks(item.time)
        if ticks.size:
            time = time[np.abs(time - ticks[nearest(ticks, time)]) > same]
        ticks = np.sort(np.concatenate([ticks, time]))
    return ticks


def _with_lost_ticks(time: FloatArray) -> FloatArray:
    """Return a topic's instants with those of lost messages, if it ticks regularly."""
    if time.size < 3:
        return time
    steps = np.diff(time)
    count = _periods(time)
    gaps = np.flatnonzero((count > 1) & (count <= _LOST + 1))
    own = [time[k] + steps[k] * np.arange(1, int(count[k])) / count[k] for k in gaps]
    return np.sort(np.concatenate([time, *own]))


def _periods(time: FloatArray) -> FloatArray:
    """Return how many periods pass between samples, (n - 1,); 1 where that is not known.

    Where stamps scatter, single steps do not tell it, and the clock that all stamps stay near does.
    """
    steps = np.diff(time)
    usual = float(np.median(steps))
    count = np.rint(steps / usual)
    regular = np.abs(steps - count * usual) <= _PERIODIC * usual
    if np.mean(regular) < _USUALLY and (clock := clock_beside(time)) is not None:
        count, regular = np.diff(clock.tick), np.ones(steps.size, dtype=np.bool_)
    usually = np.mean(regular) >= _USUALLY and np.mean(regular & (count == 1)) >= _MOSTLY
    return np.where(regular, count, 1.0) if usually else np.ones(steps.size)


def _with_own(ticks: FloatArray, time: FloatArray, reach: float) -> FloatArray:
    """Return ticks with those that samples need which lie near none, or share one."""
    at = nearest(ticks, time)
    alone = np.abs(time - ticks[at]) > reach
    near = np.flatnonzero(~alone)
    alone[near[1:][at[near[1:]] == at[near[:-1]]]] = True
    return np.unique(np.concatenate([ticks, time[alone]])) if alone.any() else ticks

"""Logs that begin with a valve's command, of a machine that stands.

A script opens a valve and then writes its first row. The machine stands in the first rows, and
moves later under the same command: had that come long before, it would be moving already. So it
began about at the first sample, and what delays it shows. A row from just before says so, in which
nothing is asked for.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.note import Note
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Run
from eha_bench.diagnosis.data.noise import quantum_of, sharp_noise_of
from eha_bench.plants.channel_roles import ChannelRoles

_MUCH: Final = 0.1
"""Share of a command's largest value from which it is on."""
_SAME: Final = 1e-3
"""What a command that rests changes by, as a share of its largest value."""
_FEWEST: Final = 4.0
"""Least time that the machine stands, in periods."""
_FIRST: Final = 4
"""Samples that say where a channel is at first, and how much it flickers there."""
_LEAVES, _MOVES = 15.0, 30.0
"""Distances from the first readings, in noise, between which a channel's speed is taken."""


def topics_from_onset(
    run: Run, inputs: Collection[str], outputs: Collection[str], roles: ChannelRoles
) -> tuple[Recording, ...]:
    """Read a run's topics, with the row before the first one where a valve has just been opened.

    Args:
        run: the run. inputs: channels that drive the model. outputs: that are compared with it.
        roles: what the plant's channels are.

    Raises:
        RecordingError: it cannot be read.
    """
    topics = run.topics()
    commands = [name for name in roles.remembered if name in inputs]
    # what is locked stands whatever is asked for
    return topics if run.locked else with_onset(topics, commands, outputs)


def with_onset(
    topics: tuple[Recording, ...], commands: Collection[str], outputs: Collection[str]
) -> tuple[Recording, ...]:
    """Return a log with the row before its first one, where a command has just begun there.

    Args:
        topics: of the log; only one that holds all is looked at. commands: of valves.
        outputs: channels that tell whether the machine stands.
    """
    if len(topics) != 1:
        return topics
    (recording,) = topics
    read = [recording[name] for name in outputs if name in recording and name not in commands]
    asked = {name: recording[name] for name in commands if name in recording}
    begun = [name for name, values in asked.items() if _is_on(values)]
    if not read or not begun:
        return topics
    unchanged = min(_unchanged(asked[name]) for name in begun)
    time = recording.time
    period = float(np.median(np.diff(time)))
    standing = min(_standing(time[:unchanged], values[:unchanged]) for values in read)
    if not _FEWEST * period <= standing < np.inf:
        return topics
    values = {
        name: np.concatenate([[0.0 if name in commands else np.nan], column])
        for name, column in recording.values.items()
    }
    note = Note(
        "'{command}' is on at the first sample, and the machine stands for {standing:.2g} s yet: "
        "it is taken to have begun there, from zero",
        command="', '".join(begun),
        standing=standing,
    )
    return (
        replace(
            recording,
            time=np.concatenate([[time[0] - period], time]),
            values=values,
            notes=(*recording.notes, note),
        ),
    )


def _is_on(values: FloatArray) -> bool:
    there = values[np.isfinite(values)]
    return there.size > 0 and abs(there[0]) > _MUCH * float(np.max(np.abs(there)))


def _unchanged(values: FloatArray) -> int:
    """Return how many samples a command stays what it is at the first one."""
    little = _SAME * float(np.nanmax(np.abs(values)))
    changed = np.flatnonzero(~(np.abs(values - values[0]) <= little))
    return int(changed[0]) if changed.size else values.size


def _standing(time: FloatArray, values: FloatArray) -> float:
    """Return how long a channel stays what it is at first, s; infinite where it always does.

    By its speed once it is clearly elsewhere: within noise and resolution what moves slowly stands.
    """
    there = np.isfinite(values)
    time, values = time[there], values[there]
    if values.size < 2 * _FEWEST:
        return np.inf
    first = float(np.ptp(values[:_FIRST]))
    noise = max(sharp_noise_of(values), quantum_of(values), 0.5 * first, np.finfo(float).tiny)
    apart = np.abs(values - np.median(values[:_FIRST])) / noise
    left, gone = (int(np.argmax(apart > least)) for least in (_LEAVES, _MOVES))
    if gone == 0:
        return np.inf
    if gone == left:
        return float(time[left - 1] - time[0])
    speed = (apart[gone] - apart[left]) / (time[gone] - time[left])
    return float(time[left] - time[0] - apart[left] / speed) if speed > 0.0 else 0.0

"""Where training recordings have been, by setup and channel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.replay.errors_by_channel import ChannelError
from eha_bench.posterior.covered import Covered, CoveredSetup, setup_of

_FIRST = 5
"""Readings at the start of a recording that are averaged."""
_AT_FIRST = 0.1
"""How long a machine is looked at where its recording begins, s."""
_MOVES = 0.2
"""Part of a channel's recorded range that it goes in that time where it was not at rest."""
_NOISES = 10.0
"""And more than so many standard deviations of its noise."""


def covered_ranges(
    runs: Sequence[Measured],
    noise: Mapping[str, float],
    errors: Mapping[str, ChannelError],
    dataset: str = "",
) -> Covered:
    """Return where training recordings have been.

    Args:
        runs: that passed the gate. noise: channel -> standard deviation, SI.
        errors: of the revised model on them. dataset: that names them.
    """
    setups: dict[tuple[str, str], dict[str, tuple[float, float]]] = {}
    starts: dict[tuple[str, str], dict[str, list[float]]] = {}
    moving = {
        setup_of(locked=item.run.locked, bypass_open=item.run.bypass_open)
        for item in runs
        if _moves_at_first(item, noise)
    }
    inputs: dict[str, list[np.ndarray]] = {}
    shaken: dict[str, list[float]] = {}
    for item in runs:
        setup = setup_of(locked=item.run.locked, bypass_open=item.run.bypass_open)
        own = setups.setdefault(setup, {})
        began = starts.setdefault(setup, {})
        columns = {name: item.values[item.valid[:, k], k] for k, name in enumerate(item.outputs)}
        for name, values in {**columns, **item.inputs}.items():
            if values.size:
                low, high = own.get(name, (math.inf, -math.inf))
                own[name] = min(low, float(values.min())), max(high, float(values.max()))
                began.setdefault(name, []).append(float(values[:_FIRST].mean()))
        for name, values in item.inputs.items():
            inputs.setdefault(name, []).append(values)
        for name, level in item.input_noise.items():
            shaken.setdefault(name, []).append(level)
    together = {name: np.concatenate(parts) for name, parts in inputs.items()}
    left = {}
    for name, error in errors.items():
        after = error.after_windows if math.isfinite(error.after_windows) else error.after
        left[name] = math.sqrt(max(after**2 - error.noise_floor**2, 0.0))
    return Covered(
        min((1.0 / item.tick for item in runs), default=math.nan),
        sum(float(item.time[-1]) for item in runs),
        {name: (float(v.min()), float(v.max()), float(v.mean())) for name, v in together.items()},
        {name: float(value) for name, value in noise.items()},
        left,
        tuple(
            CoveredSetup(
                *key,
                extremes,
                {name: float(np.median(values)) for name, values in starts[key].items()},
                key not in moving,
            )
            for key, extremes in setups.items()
        ),
        str(Path(dataset).resolve()) if Path(dataset).is_file() else "",
        {name: float(np.median(levels)) for name, levels in shaken.items()},
    )


def _moves_at_first(run: Measured, noise: Mapping[str, float]) -> bool:
    """Whether a machine moves where its recording begins, though what drives it hardly does.

    It was not at rest then: what it is commanded there began with the recording.
    """
    first = run.time <= run.time[0] + max(_AT_FIRST, 2 * _FIRST * run.tick)
    for values in run.inputs.values():
        # means, as an input that was measured may hold nothing but noise
        ends = values[first][:_FIRST].mean(), values[first][-_FIRST:].mean()
        if abs(ends[1] - ends[0]) > _MOVES * np.ptp(values):
            return False
    for number, name in enumerate(run.outputs):
        values, known = run.values[:, number], run.valid[:, number]
        if name in run.roles.rate_of or np.count_nonzero(known & first) <= _FIRST:
            continue
        begun = float(values[known & first][:_FIRST].mean())
        way = float(np.abs(values[known & first] - begun).max())
        if way > max(_MOVES * np.ptp(values[known]), _NOISES * noise.get(name, 0.0)):
            return True
    return False

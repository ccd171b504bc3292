"""Runs of which a calibrated model explains nothing, while it explains others of the same setup.

A log under another name, a sensor with the wrong sign, a setup that was not the one that is
declared: such a run is another machine's, and what is missing in it is missing nowhere else. An
effect leaves an error of some percent of a signal; where the error is larger than what the signal
itself does, no effect is meant. Only a run beside which as many others of its setup are explained
is odd: else nobody knows whether it is the run or the model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from eha_bench.diagnosis.data.gate import Measured
from eha_bench.diagnosis.fit.problem import FloatArray, Problem

_NOTHING = 1.0
"""Error over what a channel does itself from which nothing of it is explained."""
_WELL = 0.3
"""And below which a channel is explained, whatever is missing in the model."""
_LOUD = 10.0
"""Least that a channel must do to be asked, in standard deviations of its noise."""
_FEW = 1.0 / 3.0
"""Largest share of all runs that may be odd."""


def odd_runs(problem: Problem, residual: FloatArray) -> dict[str, str]:
    """Return the runs that are left out, each with the channel of which least is explained.

    Args:
        problem: over whole runs. residual: its residual, of a calibrated model.
    """
    runs = {window.measured.run.name: window.measured for window in problem.windows}
    worst = {
        name: max(shares.items(), key=lambda item: item[1])
        for name, shares in _shares(problem, residual, runs).items()
    }
    found: dict[str, str] = {}
    setups = {(item.run.locked, item.run.bypass_open) for item in runs.values()}
    for setup in sorted(setups):
        own = [n for n in worst if (runs[n].run.locked, runs[n].run.bypass_open) == setup]
        odd = [name for name in own if worst[name][1] > _NOTHING]
        if len(odd) <= sum(worst[name][1] < _WELL for name in own):
            found |= {name: worst[name][0] for name in odd}
    return found if len(found) <= _FEW * len(runs) else {}


def notes_of(odd: Mapping[str, str]) -> tuple[str, ...]:
    """Say which runs are left out, and what to look at."""
    return tuple(
        f"{run} is left out: nothing of its '{channel}' is explained, as it is in other runs of "
        "this setup; are its file, its channel map, its piston and bypass the right ones?"
        for run, channel in odd.items()
    )


def _shares(
    problem: Problem, residual: FloatArray, runs: Mapping[str, Measured]
) -> dict[str, dict[str, float]]:
    """Return the error of every run's channels over what they do themselves."""
    names: Sequence[str] = problem.plant.outputs
    sums: dict[str, dict[str, list[float]]] = {}
    for piece in problem.pieces:
        run = problem.windows[piece.window].measured.run.name
        for channel in np.unique(piece.channels):
            part = residual[piece.rows][piece.channels == channel]
            entry = sums.setdefault(run, {}).setdefault(names[channel], [0.0, 0.0])
            entry[0] += float(part @ part)
            entry[1] += part.size
    found: dict[str, dict[str, float]] = {}
    for run, channels in sums.items():
        for channel, (total, count) in channels.items():
            column = runs[run].column(channel)
            moves = 0.0 if column is None else float(np.nanstd(column)) / problem.noise[channel]
            error = float(np.sqrt(total / max(count, 1.0)))
            found.setdefault(run, {})[channel] = error / max(moves, _LOUD)
    return found

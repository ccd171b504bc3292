"""Runs of which a calibrated model explains nothing, while it explains others of the same setup.

A log under another name, a sensor with the wrong sign, a setup that was not the one that is
declared: such a run is another machine's, and what is missing in it is missing nowhere else. An
effect leaves an error of some percent of a signal; where the error is larger than what the signal
itself does, no effect is meant. Only a run for which as many others of its setup are explained
is an outlier: otherwise run and model cannot be distinguished.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.problem import Problem

_NOTHING = 1.0
"""Error over the channel's own standard deviation from which nothing of it is explained."""
_WELL = 0.3
"""And below which a channel is explained, whatever is missing in the model."""
_LOUD = 10.0
"""Least standard deviation of a channel that counts, in those of its noise."""
_ALIKE = 0.5
"""Correlation of what is simulated and measured from which something of it is explained."""
_FEW = 1.0 / 3.0
"""Largest share of all runs that may be outliers."""


def outlier_runs(problem: Problem, residuals: Sequence[FloatArray]) -> dict[str, str]:
    """Return the runs that are left out, each with the channel of which least is explained.

    Args:
        problem: over whole runs. residuals: of models, of which each run counts by the one that
            explains most of it: a fit that is caught somewhere makes no run an outlier.
    """
    runs = {window.measured.run.name: window.measured for window in problem.windows}
    tried = [_shares(problem, problem.in_readings(residual)) for residual in residuals]
    worst = {
        name: min((max(own[name].items(), key=lambda item: item[1]) for own in tried),
                  key=lambda item: item[1])
        for name in runs
        if all(name in own for own in tried)
    }  # fmt: skip
    found: dict[str, str] = {}
    setups = {(item.run.locked, item.run.bypass_open) for item in runs.values()}
    for setup in sorted(setups):
        own = [n for n in worst if (runs[n].run.locked, runs[n].run.bypass_open) == setup]
        far = [name for name in own if worst[name][1] > _NOTHING]
        if len(far) <= sum(worst[name][1] < _WELL for name in own):
            found |= {name: worst[name][0] for name in far}
    return found if len(found) <= _FEW * len(runs) else {}


def notes_of(outliers: Mapping[str, str]) -> tuple[str, ...]:
    """Say which runs are left out, and what to look at."""
    return tuple(
        f"{run} is left out: the model explains nothing of its '{channel}', but does in other "
        "runs of this setup: check its file, channel map, piston and bypass"
        for run, channel in outliers.items()
    )


def _shares(problem: Problem, residual: FloatArray) -> dict[str, dict[str, float]]:
    """Return the error of every run's channels over what they do themselves."""
    names = problem.plant.outputs
    errors: dict[str, dict[str, list[FloatArray]]] = {}
    scale = problem.scale
    for piece in problem.pieces:
        window = problem.windows[piece.window]
        run = window.measured.run.name
        for channel, mask in piece.by_channel():
            name = names[channel]
            own = window.measured.values[window.first + piece.ticks[mask],
                                         window.measured.outputs.index(name)]  # fmt: skip
            pair = np.stack([own / scale[piece.rows][mask], residual[piece.rows][mask]])
            errors.setdefault(run, {}).setdefault(name, []).append(pair)
    found: dict[str, dict[str, float]] = {}
    for run, channels in errors.items():
        for name, pairs in channels.items():
            measured, error = np.hstack(pairs)
            # a rod that sticks while the model's moves is what tells of friction
            if np.std(measured) > _LOUD:
                found.setdefault(run, {})[name] = _share(measured, error)
    return found


def _share(measured: FloatArray, error: FloatArray) -> float:
    """Return an error over what a channel does itself, both (n,) in its noise.

    What is simulated may be far off in size and still be the same: where it goes with what was
    measured, something is explained.
    """
    moves, size = float(np.std(measured)), float(np.sqrt(np.mean(error**2)))
    simulated = measured - error
    both = moves * float(np.std(simulated))
    alike = float(np.mean((measured - measured.mean()) * simulated)) / both if both > 0.0 else 0.0
    share = size / moves
    return min(share, _NOTHING) if alike > _ALIKE else share

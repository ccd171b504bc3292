"""Unmeasured states where windows begin in the midst of a run.

A window needs every state at its start. What has no sensor, or a dead one, is carried there: the
run is simulated from its beginning, and at every window's start what is measured is set again, what
is not stays as the simulation has it (an observer whose measured states are reset; the reduced
observer of Luenberger, IEEE Trans. Autom. Control 16 (1971) 596, doi:10.1109/TAC.1971.1099826).
A default would be off by megapascals, and an effect would be made up for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.windows import Window, window_at
from eha_bench.plants.plant import Plant

_TRUSTED = 0.1
"""How far a carried state may be off, as a share of what it moves by in its run."""


def missing(plant: Plant, window: Window) -> tuple[str, ...]:
    """Return the plant's states that a window does not know at its start."""
    roles = window.measured.roles
    still = roles.locked if window.measured.run.locked else ()
    if window.first == 0:
        # a run begins at rest, where what moves is zero
        still = (*still, *roles.rates, *roles.acting)
    told = {shown for name, (shown, _) in roles.geared.items() if name in window.initial}
    return tuple(
        name
        for name in plant.states
        if name in plant.outputs
        and name not in still
        and name not in window.initial
        and name not in told
        and name not in window.measured.inputs
    )


def with_carried_states(
    plant: Plant, vector: FloatArray, windows: Sequence[Window], step: float
) -> list[Window]:
    """Return windows of one run with the states that they miss, as a simulation carries them.

    Args:
        plant: the plant. vector: its parameters. step: of the integration, s.
        windows: of one run, in the order of time; each gets a start value and a spread, SI.
    """
    measured = windows[0].measured
    started = list(windows)
    if windows[0].first > 0:
        started.insert(0, window_at(measured, 0, windows[0].first, windows[0].noise))
    stops = [*(window.first for window in started[1:]), measured.time.size - 1]
    known: dict[str, float] = {}
    paths: dict[str, list[float]] = {}
    found: list[dict[str, float]] = []
    for window, stop in zip(started, stops, strict=True):
        unread = missing(plant, window)
        own = {name: known[name] for name in unread if name in known}
        start = {**plant.at_rest(window.initial), **window.initial, **own}
        drive = measured.drive(window.first, stop + 1, start)
        out = plant.simulate(vector, drive, step)
        for at, name in enumerate(plant.outputs):
            part = out[:, at]
            if name in plant.states and np.isfinite(part).all():
                known[name] = float(part[-1])
                paths.setdefault(name, []).extend((float(part.min()), float(part.max())))
                if name in unread:
                    own[name] = float(part[0])
        found.append(own)
    moves = {name: float(np.ptp(path)) for name, path in paths.items()}
    done = []
    for window, own in zip(started[-len(windows) :], found[-len(windows) :], strict=True):
        spread = {name: _TRUSTED * moves[name] for name in own}
        done.append(
            replace(window, initial={**window.initial, **own}, spread={**window.spread, **spread})
        )
    return done

"""Unmeasured states where windows begin in the midst of a run.

A window needs every state at its start. What has no sensor, or a dead one, is carried there: the
run is simulated from its beginning, and at every window's start what is measured is set again, what
is not stays as the simulation has it (an observer whose measured states are reset; the reduced
observer of Luenberger, IEEE Trans. Autom. Control 16 (1971) 596, doi:10.1109/TAC.1971.1099826).
A default would be off by megapascals, and an effect would be made up for it. Where a log begins
nobody knows a pressure without a sensor: the oil may have been under any load.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.first_rates import first_rates
from eha_bench.diagnosis.data.windows import Window, window_at
from eha_bench.diagnosis.fit.beyond_springs import beyond_springs
from eha_bench.diagnosis.fit.start_state import start_of
from eha_bench.plants.plant import Plant

_TRUSTED = 0.1
"""How far a carried state may be off, as a share of what it moves by in its run."""
_UNKNOWN = 0.5
"""The same of a pressure where a log begins."""


def missing(plant: Plant, window: Window) -> tuple[str, ...]:
    """Return the plant's states that a window does not know at its start.

    A pressure, a speed or a position is one whether or not a channel is declared for it; the angle
    of a shaft that turns on and on is told otherwise (`start_angles`).
    """
    measured = window.measured
    roles = measured.roles
    still = roles.locked if measured.run.locked else ()
    if window.first == 0:
        # a run begins at rest, where what moves is zero, or as its positions tell (`first_rates`)
        still = (*still, *roles.rates, *roles.acting)
        # and where it is charged to is a parameter of its own
        still += tuple(name for name, key in plant.charged_by.items() if key in measured.run.own)
    moving = {*roles.rates, *roles.rate_of} - {*roles.turning.values()}
    told = {shown for name, (shown, _) in roles.geared.items() if name in window.initial}
    return tuple(
        name
        for name in plant.states
        if (name in plant.outputs or name in moving or name in plant.charged_by)
        and name not in still
        and name not in window.initial
        and name not in told
        and name not in measured.inputs
    )


def with_carried_states(
    plant: Plant, vector: FloatArray, windows: Sequence[Window], step: float
) -> list[Window]:
    """Return windows of one run with the states that they miss, as a simulation carries them.

    Args:
        plant: the plant. vector: its parameters. step: of the integration, s.
        windows: of one run, in the order of time; each gets a start value and a spread, SI.
    """
    measured, at = windows[0].measured, plant.at(vector)
    started = list(windows)
    if windows[0].first > 0:
        started.insert(0, window_at(measured, 0, windows[0].first, windows[0].noise))
    stops = [*(window.first for window in started[1:]), measured.time.size - 1]
    carried = _Carried(plant)
    found: list[dict[str, float]] = []
    springs: list[dict[str, tuple[float, float]]] = []
    for window, stop in zip(started, stops, strict=True):
        unread = missing(plant, window)
        moving = first_rates(measured) if window.first == 0 else {}
        springs.append({**moving, **beyond_springs(plant, vector, window)})
        told = {name: value for name, (value, _) in springs[-1].items()}
        own = {**carried.values(unread, window.initial), **told}
        drive = measured.drive(window.first, stop + 1)
        begin = start_of(at, drive, window.initial, own)
        out, end = at.simulate_to_end(drive, begin, step)
        begin = carried.take({**plant.rest(vector), **begin}, out, end)
        found.append(
            {name: begin[name] for name in {**dict.fromkeys(unread), **told} if name in begin}
        )
    done = []
    count = len(windows)
    for window, own, told_by in zip(
        started[-count:], found[-count:], springs[-count:], strict=True
    ):
        free = measured.roles.pressures if window.first == 0 else ()
        spread = {
            name: (_UNKNOWN if name in free else _TRUSTED) * carried.moves(name, window.initial)
            for name in own
        }
        spread |= {name: off for name, (_, off) in told_by.items()}
        done.append(replace(window, carried=own, spread={**window.spread, **spread}))
    return done


class _Carried:
    """What a simulation carries from window to window.

    Args:
        plant: what is simulated.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._known: dict[str, float] = {}
        self._ends: dict[str, tuple[float, float]] = {}
        pairs = [ends for pair in plant.elastic_pairs for ends in (pair.positions, pair.rates)]
        self._partner = {**dict(pairs), **{second: first for first, second in pairs}}

    def values(self, unread: Sequence[str], read: Mapping[str, float]) -> dict[str, float]:
        """Return unread states as they were carried to here.

        What is joined to a part that is read by a spring is as far from it as it was carried.
        """
        found = {}
        for name in unread:
            partner = self._partner.get(name, "")
            if partner in read:
                known = name in self._known and partner in self._known
                apart = self._known[name] - self._known[partner] if known else 0.0
                found[name] = read[partner] + apart
            elif name in self._known:
                found[name] = self._known[name]
        return found

    def take(
        self, begin: Mapping[str, float], out: FloatArray, end: Mapping[str, float]
    ) -> dict[str, float]:
        """Take what was simulated from one window to the next; return the states at its start.

        Args:
            begin: states at its start. out: (n, outputs) simulated. end: states at its end.
        """
        paths = {
            name: out[:, k]
            for k, name in enumerate(self._plant.outputs)
            if name in self._plant.states and np.isfinite(out[:, k]).all()
        }
        self._known |= {name: value for name, value in end.items() if np.isfinite(value)}
        for name, value in self._known.items():
            if name not in paths and name in end:
                paths[name] = np.array([begin.get(name, value), value])
        for name, path in paths.items():
            self._widen(name, path)
            other = paths.get(self._partner.get(name, ""))
            if other is not None:
                ends = slice(None) if path.size == other.size else [0, -1]
                self._widen(f"{name} apart", path[ends] - other[ends])
        return {name: begin.get(name, float(path[0])) for name, path in paths.items()}

    def moves(self, name: str, read: Mapping[str, float]) -> float:
        """Return what a state moved by: beside one that is read and joined to it, or by itself."""
        low, high = self._ends[f"{name} apart" if self._partner.get(name, "") in read else name]
        return high - low

    def _widen(self, name: str, path: FloatArray) -> None:
        low, high = self._ends.get(name, (np.inf, -np.inf))
        self._ends[name] = min(low, float(path.min())), max(high, float(path.max()))

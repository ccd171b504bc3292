"""The simulation error of a parameter vector over all windows, whitened for what shakes it.

The weighted residual of a window is r = (measured - simulated) / noise. Its start state comes from
noisy measurements, so r carries the part U z, z ~ N(0, 1), with U the sensitivity to the start
state times its spread; with C = I + U U' the whitened residual is C^(-1/2) r, and an error that a
start state could have made no longer counts. U comes from a few perturbed simulations a window and
is kept until `prepare` is called again (the approach of error-in-start-state multiple shooting; see
Ljung 1999, section 5.3). Where inputs were measured, U holds what their noise does as well
(`input_noise`).

In the midst of an oscillation U holds only near the measured state. Where a window stands out, its
start is moved to the best one, z', and U is taken there: r(z') - U z' is then whitened (an iterated
Kalman update; Bell, Cathey, IEEE Trans. Autom. Control 38 (1993) 294, doi:10.1109/9.250476).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import TypeVar

import numpy as np
from scipy.sparse.linalg import spsolve

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.core.interruption import checkpoint
from eha_bench.diagnosis.data.first_rates import first_rates
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.start_angle import StartAngle
from eha_bench.diagnosis.data.wander import cosines
from eha_bench.diagnosis.data.windows import Window, from_another_angle
from eha_bench.diagnosis.fit import side_by_side
from eha_bench.diagnosis.fit.beliefs import Belief, believed_residual
from eha_bench.diagnosis.fit.effort import note_simulated_time
from eha_bench.diagnosis.fit.groups import WindowGroup, groups_of
from eha_bench.diagnosis.fit.input_noise import input_noise_of
from eha_bench.diagnosis.fit.instants import instants_of
from eha_bench.diagnosis.fit.lost_inputs import lost_input_noise
from eha_bench.diagnosis.fit.own_parameters import places_of
from eha_bench.diagnosis.fit.prepared import Prepared, best_start
from eha_bench.diagnosis.fit.readings import StartBases, WindowReadings
from eha_bench.diagnosis.fit.start_state import starts_of
from eha_bench.diagnosis.fit.unmeasured import missing, with_carried_states
from eha_bench.diagnosis.fit.whitening import whitening
from eha_bench.plants.plant import Drive, Drives, Parametrised, Plant

T = TypeVar("T")

SLOPES = 3.4e-4
"""Integration step of slopes, s: both ends are off by the same."""
_HISTORY = 100
"""Ticks of the inputs before a window: a delayed command looks back."""
_SOFT = 5.0
_LOUD = 10.0
"""Mean square of a window's residual, in that of most, from which it says nothing of the rest."""
_STANDS_OUT = 1.4
"""The same, from which its start is moved, beyond what chance makes of a window of its length."""
_CHANCE = 6.0
"""Standard deviations of a window's mean square that chance does not reach."""
_HOLDS = 4.0
"""Mean square of most windows, in the noise's, below which the model holds: beyond it, what stands
out is what the model lacks."""
_FEW = 0.2
"""Largest share of windows that stand out: where more do, the model does not hold."""
_BENDS = 0.5
"""What a start's effect is off its slopes, as a part of what they leave, from which these say
nothing of where the start is."""
_TAKES = 10.0
"""Multiple of what is left that a start takes of a window where that bend may be all."""
_SPREADS = 20.0
"""How far off, in its spreads, such a start is at most."""
_HORIZONS = (0.06, 0.12, 0.25, 0.5, 1.0, 1.0)
"""Shares of such a window that say one after the other where its start is."""
_HELPS = 0.9
"""Share of a window's cost that is left by a move that helps."""


@dataclass(frozen=True)
class _InRuns:
    """What runs are simulated with.

    Attributes:
        plants: run -> the plant with its parameters.
        lateness: run -> clock -> s that its stamps are late by.
    """

    plants: Mapping[str, Parametrised]
    lateness: Mapping[str, Mapping[str, float]]

    def plant_of(self, part: Prepared) -> Parametrised:
        """Return what a window is simulated with."""
        return self.plants[part.window.measured.run.name]


@dataclass(frozen=True)
class Piece:
    """Which part of the stacked residual belongs to which window and channel."""

    window: int
    rows: slice
    ticks: IndexArray
    channels: IndexArray

    def by_channel(self) -> Iterator[tuple[int, BoolArray]]:
        """Yield each channel, by number, with the mask of its rows within this piece."""
        for channel in np.unique(self.channels):
            yield int(channel), self.channels == channel


class Problem:
    """Residuals of one plant over windows, for any parameter vector.

    Args:
        plant: the plant.
        windows: stretches to simulate.
        noise: channel -> standard deviation; channels without are not compared.
        step: largest integration step, s.
        beliefs: of parameters; each is one more row, behind those of the windows.
        stretch: how many times as long every step may be (`stretched_steps`).
    """

    def __init__(
        self,
        plant: Plant,
        windows: Sequence[Window],
        noise: Mapping[str, float],
        step: float,
        beliefs: Sequence[Belief] = (),
        stretch: float = 1.0,
    ) -> None:
        self.plant = plant
        self.windows = tuple(windows)
        self.noise = dict(noise)
        self.step = step
        self.stretch = stretch
        self.soft = 1.0
        self.beliefs = tuple(beliefs)
        self._defect: FloatArray | None = None
        self._outputs = {name: at for at, name in enumerate(plant.outputs)}
        self.places = places_of(plant.layout, (window.measured for window in windows))
        self._parts = [self._ready(window) for window in windows]
        self._kept_groups: tuple[WindowGroup, ...] | None = None
        self._kept_bases: dict[tuple[int, ...], StartBases] = {}
        offsets = np.concatenate([[0], np.cumsum([part.pick.size for part in self._parts])])
        self._rows = [slice(int(a), int(b)) for a, b in pairwise(offsets)]
        self.size = int(offsets[-1])

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """Layout of the stacked residual."""
        found = []
        for number, (part, rows) in enumerate(zip(self._parts, self._rows, strict=True)):
            width = part.columns.size
            found.append(Piece(number, rows, part.pick // width, part.columns[part.pick % width]))
        return tuple(found)

    @property
    def scale(self) -> FloatArray:
        """The noise of each reading, SI, (size,): that of its channel, and more where it moves."""
        return np.concatenate([np.zeros(0), *(part.scale for part in self._parts)])

    @property
    def floors(self) -> dict[str, float]:
        """Channel -> noise of its readings in all, SI: more than at rest if stamps scatter."""
        found = dict(self.noise)
        if not any(window.measured.scattered for window in self.windows):
            return found
        squares = self.mean_squares(self.scale)
        return found | {name: float(np.sqrt(square)) for name, square in squares.items()}

    def mean_squares(self, values: FloatArray) -> dict[str, float]:
        """Return channel -> mean square of what belongs to its readings.

        Args:
            values: (size,) of each reading; what stands behind them, as of beliefs, is left out.
        """
        squares: dict[str, list[FloatArray]] = {}
        for piece in self.pieces:
            rows = values[piece.rows]
            for channel, mask in piece.by_channel():
                squares.setdefault(self.plant.outputs[channel], []).append(rows[mask] ** 2)
        return {name: float(np.mean(np.concatenate(own))) for name, own in squares.items()}

    @property
    def has_moved_starts(self) -> bool:
        """Whether any window begins elsewhere than where it was measured."""
        return any(part.moved is not None for part in self._parts)

    def hides_more(self, vector: FloatArray) -> bool:
        """Whether these parameters leave more of the windows' starts open than is prepared for."""
        hidden = self.plant.at(vector[: self.plant.layout.size]).hidden
        return any(name not in part.starts for part in self._parts for name in hidden)

    def subset(self, keep: Sequence[int]) -> Problem:
        """Return the problem over some of the windows; start-state bases are shared."""
        other = object.__new__(Problem)
        other.plant, other.noise = self.plant, self.noise
        other.step, other.stretch = self.step, self.stretch
        other.soft, other.beliefs = self.soft, self.beliefs
        other._defect = None
        other._outputs = self._outputs
        other.places = self.places
        other.windows = tuple(self.windows[k] for k in keep)
        other._parts = [self._parts[k] for k in keep]
        is_whole = [*keep] == [*range(len(self._parts))]
        other._kept_groups = self._kept_groups if is_whole else None
        other._kept_bases = {}
        offsets = np.concatenate([[0], np.cumsum([part.pick.size for part in other._parts])])
        other._rows = [slice(int(a), int(b)) for a, b in pairwise(offsets)]
        other.size = int(offsets[-1])
        return other

    def of_run(self, name: str) -> tuple[Problem, IndexArray]:
        """Return the problem over one run's windows, and the places of their rows in this one."""
        keep = [k for k, window in enumerate(self.windows) if window.measured.run.name == name]
        other = self.subset(keep)
        other.beliefs = ()
        rows = self.rows_of(keep) if keep else np.zeros(0, dtype=np.intp)
        other._defect = None if self._defect is None else self._defect[rows]
        return other, rows

    def without_loud(self, residual: FloatArray) -> Problem | None:
        """Return the problem without the windows that stand out in a residual, or None."""
        squares = [float(np.sum(residual[rows] ** 2)) for rows in self._rows]
        loud = {*self._loud(squares, np.full(len(squares), _LOUD))}
        return self.subset([k for k in range(len(self.windows)) if k not in loud]) if loud else None

    def apart(self) -> Problem:
        """Return the same problem with its own start-state bases."""
        other = self.subset(range(len(self.windows)))
        other._parts = [replace(part) for part in self._parts]
        return other

    def at_step(self, step: float) -> Problem:
        """Return the same problem integrated at another step; start-state bases are shared."""
        other = self.subset(range(len(self.windows)))
        other.step = step
        return other

    def stretched(self, stretch: float) -> Problem:
        """Return the same problem with every step so many times as long; bases are shared."""
        other = self.subset(range(len(self.windows)))
        other.stretch = stretch
        return other

    def halved(self) -> Problem:
        """Return the same problem at half the step; what it is stretched by goes first.

        Coarser steps of the problem that is returned are stretched as little.
        """
        if self.stretch > 1.0:
            return self.stretched(max(0.5 * self.stretch, 1.0))
        return self.at_step(0.5 * self.step)

    @property
    def longest_step(self) -> float:
        """The longest step that is simulated, s."""
        return self.step * self.stretch

    def at_angles(self, starts: Mapping[str, StartAngle]) -> Problem:
        """Return the same problem with the shaft at other angles where runs begin, by run's name.

        Start-state bases are shared until it is prepared.
        """
        other = self.subset(range(len(self.windows)))
        other._defect = self._defect
        runs = {id(item.measured): item.measured.at_angles(starts) for item in self.windows}
        other.windows = tuple(
            from_another_angle(item, runs[id(item.measured)]) for item in self.windows
        )
        other._parts = [
            replace(part, window=from_another_angle(part.window, runs[id(part.window.measured)]))
            for part in self._parts
        ]
        return other

    def coarser(self, step: float, vector: FloatArray, residual: FloatArray) -> Problem:
        """Return the problem at a coarser step, less that step's own error at a vector.

        Args:
            step: s. vector: where the residual of the coarser problem becomes `residual`.
            residual: of this problem there.
        """
        other = self.at_step(step)
        other._defect = residual - other.residual(vector)
        return other

    def over(self, windows: Sequence[Window]) -> Problem:
        """Return the same over other windows; it needs `prepare`."""
        other = Problem(self.plant, windows, self.noise, self.step, self.beliefs, self.stretch)
        other.soft = self.soft
        return other

    def with_measured(self, change: Callable[[Measured], Measured]) -> Problem:
        """Return the same windows of runs that are changed; it needs `prepare`."""
        runs = {id(window.measured): window.measured for window in self.windows}
        changed = {key: change(item) for key, item in runs.items()}
        return self.over(
            [replace(window, measured=changed[id(window.measured)]) for window in self.windows]
        )

    def with_noise(self, noise: Mapping[str, float]) -> Problem:
        """Return the same windows weighted by another noise; it needs `prepare`."""
        other = Problem(self.plant, self.windows, noise, self.step, self.beliefs, self.stretch)
        for own, part in zip(self._parts, other._parts, strict=True):
            if own.pick.size != part.pick.size:
                continue
            ratio = own.scale / part.scale
            part.shaken = own.shaken.reweighted(ratio) if own.shaken is not None else None
            part.lost = own.lost.reweighted(ratio) if own.lost is not None else None
            part.starts, part.moved = own.starts, own.moved  # `prepare` takes U there
        return other

    def scale_to(self, residual: FloatArray) -> None:
        """Set what counts as an outlier by a residual's usual size, never below the noise.

        Where the model is far off everywhere, 5 sigma of the noise would make outliers of all.
        """
        usual = float(np.median(np.abs(residual))) if residual.size else 0.0
        self.soft = max(1.0, usual / 0.6745)

    def rows_of(self, keep: Sequence[int]) -> IndexArray:
        """Return the places in the stacked residual of some windows."""
        return np.concatenate([np.arange(self._rows[k].start, self._rows[k].stop) for k in keep])

    def prepare(self, vector: FloatArray) -> None:
        """Linearise the windows' start states and their inputs' noise about a parameter vector."""
        for part in self._parts:
            if part.shaken is not None and not part.shaken.is_near(vector):
                part.shaken = None
            if part.lost is not None and not part.lost.is_near(vector):
                part.lost = None
        self.prepare_starts(vector)

    def prepare_starts(self, vector: FloatArray) -> None:
        """Linearise the windows' start states; what is known of their inputs' noise stays."""
        rough = self.at_step(max(self.step, SLOPES))
        self._carry(vector, rough.step)
        in_run = self._in_runs(vector)
        for part in self._parts:
            rough._look_at_starts(part, in_run.plant_of(part))
        seconds = sum((1 + len(part.starts)) * part.length for part in self._parts)

        sizes = np.array([max(part.pick.size, 1) for part in self._parts])
        limits = _STANDS_OUT + _CHANCE * np.sqrt(2.0 / sizes)
        bent: set[int] = set()

        def linearised(group: WindowGroup) -> list[float]:
            parts = [self._parts[k] for k in group.members]
            slopes = rough._slopes(parts, group.drives, group.readings, in_run)
            further = []
            for k, part, own in zip(group.members, parts, slopes, strict=True):
                further.append(rough._linearise(part, in_run, vector, *own))
                loud = part.starts and part.cost > limits[k] * sizes[k]
                if loud and rough._is_bent(part, in_run, *own):
                    bent.add(k)
            return further

        further = sum(self._of_groups(linearised, seconds))
        loud = {*self._loud([part.cost for part in self._parts], limits), *bent}
        for k, part in enumerate(self._parts):
            if k not in loud and part.moved is None:
                continue
            further += rough._move_start(part, in_run)
        if further:
            note_simulated_time(further)

    def _look_at_starts(self, part: Prepared, plant: Parametrised) -> None:
        """Find the states that are uncertain at a window's start."""
        starts = {
            name: spread
            for name, spread in part.window.spread.items()
            if np.isfinite(spread) and spread > 0 and name in self.plant.states
        }
        starts |= plant.hidden
        if [*starts] != [*part.starts]:
            part.moved = None
        part.starts = starts

    def _linearise(
        self,
        part: Prepared,
        in_run: _InRuns,
        vector: FloatArray,
        base: FloatArray,
        columns: FloatArray,
    ) -> float:
        """Take a window's U about its start; return what was simulated beyond its states, s."""
        part.offset = columns @ part.moved if part.moved is not None else None
        readings = WindowReadings((part,), len(self.plant.outputs))

        def of_drives(drives: Sequence[Drive]) -> list[FloatArray]:
            return self._of_drives(part, drives, readings, in_run)

        further = 0.0
        if (noise := part.window.measured.input_noise) and part.shaken is None:
            part.shaken = input_noise_of(
                part.drive,
                noise,
                part.window.measured.colours,
                vector,
                of_drives,
            )
            further = part.shaken.simulations * part.length
        if (unsure := part.window.measured.unsure) and part.lost is None:
            part.lost = lost_input_noise(
                part.drive,
                unsure,
                part.window.first - part.drive.first,
                part.drive.time[part.drive.first + part.pick // part.columns.size],
                vector,
                of_drives,
            )
            further += part.lost.simulations * part.length
        self._span(part, columns)
        part.cost = float(np.sum(part.white(part.from_start(base)) ** 2))
        return further

    def _is_bent(
        self, part: Prepared, in_run: _InRuns, base: FloatArray, slopes: FloatArray
    ) -> bool:
        """Whether the start that a window's slopes ask for does much else than they say.

        Then they tell neither where it is nor what is missing: a joint rings on from a speed that
        was told to a tenth. It is asked of windows whose start takes nearly all that is off, and is
        no further off than it may be: elsewhere something is missing.
        """
        every = np.ones(part.pick.size, dtype=np.bool_)
        best, _ = best_start(base, slopes, part.of_inputs, part.shift, every)
        change = slopes @ (best - part.shift)
        taken = float(np.sum(change**2))
        if taken < _TAKES * part.cost or np.abs(best).max(initial=0.0) > _SPREADS:
            return False
        trial = replace(part, moved=best)
        readings = WindowReadings((part,), len(self.plant.outputs))
        (there,) = self._of_drives(trial, [part.drive], readings, in_run)
        off = there - (base + change)
        return float(np.sum(part.white(off) ** 2)) > _BENDS**2 * part.cost

    def _span(self, part: Prepared, slopes: FloatArray) -> None:
        """Give a window what its start, its inputs' noise and wandering zeros do."""
        part.span(np.column_stack([slopes, part.of_inputs]), self._wandering(part))

    def _slopes(
        self, parts: Sequence[Prepared], drives: Drives, readings: WindowReadings, in_run: _InRuns
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Return windows' weighted residuals, and what each uncertain state does to them, (N, k).

        Args:
            parts: windows of runs with the same parameters. drives: what drives them.
            readings: what they are compared with. in_run: what they are simulated with.
        """
        plant = in_run.plant_of(parts[0])
        which: list[int] = []
        starts: list[dict[str, float]] = []
        for number, (part, start) in enumerate(
            zip(parts, self._starts(parts, drives, plant), strict=True)
        ):
            # a fifth of a spread: a compromise between noise of stick events and curvature
            moved = [
                {**start, name: start.get(name, 0.0) + 0.2 * spread}
                for name, spread in part.starts.items()
            ]
            starts += [start, *moved]
            which += [number] * (1 + len(moved))
        simulated = plant.simulate_each(drives, which, starts, self.longest_step)
        windows = np.array(which)
        left = iter(readings.each(readings.left(simulated, windows, in_run.lateness), windows))
        found = []
        for part in parts:
            base = next(left)
            moved_by = [next(left) - base for _ in part.starts]
            columns = np.array(moved_by).T / 0.2 if moved_by else np.zeros((base.size, 0))
            found.append((base, columns))
        return found

    def _loud(self, squares: Sequence[float], limits: FloatArray) -> list[int]:
        """Return which windows stand out, by the sum of squares of each one's residual.

        Args:
            squares: of each window. limits: (windows,) mean square of each, in that of most.
        """
        if not self._parts:
            return []
        means = np.array(squares) / [max(part.pick.size, 1) for part in self._parts]
        usual = max(1.0, float(np.median(means)))
        loud = np.flatnonzero(means > limits * usual)
        return [*map(int, loud)] if usual < _HOLDS and loud.size <= _FEW * means.size else []

    def _move_start(self, part: Prepared, in_run: _InRuns) -> float:
        """Move a window's start to its best, and take U there; return what was simulated, s.

        Its first part tells it first: over many periods of an oscillation there are many minima.
        """
        if not part.starts:
            return 0.0
        others, moved = part.of_inputs, part.shift
        drives, readings = Drives((part.drive,)), WindowReadings((part,), len(self.plant.outputs))
        ((base, slopes),) = self._slopes([part], drives, readings, in_run)
        for share in _HORIZONS:
            rows = part.pick // part.columns.size < share * (part.window.last - part.window.first)
            best, before = best_start(base, slopes, others, moved, rows)
            trial = replace(part, moved=best)
            ((there, its),) = self._slopes([trial], drives, readings, in_run)
            if best_start(there, its, others, best, rows)[1] < before:
                moved, base, slopes = best, there, its
        trial = replace(part, moved=moved, offset=slopes @ moved)
        self._span(trial, slopes)
        trial.cost = float(np.sum(trial.white(trial.from_start(base)) ** 2))
        if trial.cost < part.cost * (_HELPS if part.moved is None else 1.0):
            part.moved, part.offset, part.cost = trial.moved, trial.offset, trial.cost
            part.basis, part.shrink = trial.basis, trial.shrink
        return (1 + len(_HORIZONS)) * (1 + len(part.starts)) * part.length

    def _carry(self, vector: FloatArray, step: float) -> None:
        """Give windows what no sensor says of their start."""
        runs: dict[int, list[int]] = {}
        for number, window in enumerate(self.windows):
            runs.setdefault(id(window.measured), []).append(number)
        for numbers in runs.values():
            numbers.sort(key=lambda k: self.windows[k].first)
            own = [self.windows[k] for k in numbers]
            unread = any(missing(self.plant, window) for window in own)
            if unread or (own[0].first == 0 and first_rates(own[0].measured)):
                note_simulated_time(float(own[0].measured.time[-1]))
                for number, window in zip(
                    numbers,
                    with_carried_states(
                        self.plant,
                        own[0].measured.run.vector(self.plant.layout, vector),
                        own,
                        step,
                    ),
                    strict=True,
                ):
                    self._parts[number].window = window

    def raw(self, vector: FloatArray) -> FloatArray:
        """Return the weighted residual as it is, start states and all, (size,)."""
        return np.concatenate(self._left(vector, lambda _, left: left))

    def residual(self, vector: FloatArray) -> FloatArray:
        """Return the whitened weighted residual: white, variance 1 where the model is complete.

        (size,) of the readings, and behind them one of each belief.
        """

        def white(group: WindowGroup, left: FloatArray) -> FloatArray:
            return self._bases(group).white(left)

        found = np.concatenate(
            [*self._left(vector, white), believed_residual(self.beliefs, vector)]
        )
        return found if self._defect is None else found + self._defect

    def with_best_start(self, vector: FloatArray) -> FloatArray:
        """Return what is left of each reading, in its noise, from a window's best start, (size,).

        The noise of measured inputs is at its best too. Needs `prepare` at this vector.
        """
        left = self.raw(vector)
        best = [
            part.at_best(part.from_start(left[rows]))
            for part, rows in zip(self._parts, self._rows, strict=True)
        ]
        return self.in_readings(np.concatenate(best))

    def in_readings(self, residual: FloatArray) -> FloatArray:
        """Return what a residual is of each reading, in its noise: the same where that is white."""
        out = residual[: self.size].copy()
        for part, rows in zip(self._parts, self._rows, strict=True):
            if part.whitening is not None:
                out[rows] = spsolve(part.whitening, residual[rows])
        return out

    def corrected_outputs(self, vector: FloatArray) -> list[FloatArray]:
        """Return each window's simulated outputs with the start state's best correction, SI.

        Each is (ticks, outputs of the plant).
        """
        in_run = self._in_runs(vector)

        def several(group: WindowGroup) -> list[FloatArray]:
            parts = [self._parts[k] for k in group.members]
            simulated = self._simulated(group, in_run)
            return [
                values[part.drive.first :] for part, values in zip(parts, simulated, strict=True)
            ]

        return self._of_groups(several)

    def _in_runs(self, vector: FloatArray) -> _InRuns:
        """Return what windows are simulated with: the plant with the parameters of their runs."""
        late = self.places.lateness(vector)
        measured = {part.window.measured.run.name: part.window.measured for part in self._parts}
        layout = self.plant.layout
        shared = self.plant.at(vector[: layout.size])
        return _InRuns(
            {
                name: self.plant.at(item.run.vector(layout, vector))
                if item.run.parameters or item.run.own
                else shared
                for name, item in measured.items()
            },
            {name: {**item.lateness, **late} for name, item in measured.items()},
        )

    @property
    def _groups(self) -> tuple[WindowGroup, ...]:
        """Windows that are simulated in one call; a few groups a processor."""
        if self._kept_groups is None:
            count = 2 * side_by_side.PROCESSORS
            self._kept_groups = groups_of(self._parts, count, len(self.plant.outputs))
        return self._kept_groups

    def _bases(self, group: WindowGroup) -> StartBases:
        """Return what the start states of a group's windows do."""
        parts = [self._parts[k] for k in group.members]
        kept = self._kept_bases.get(group.members)
        if kept is None or not kept.are_of(parts):
            kept = self._kept_bases[group.members] = StartBases(parts)
        return kept

    def _simulated(self, group: WindowGroup, in_run: _InRuns) -> list[FloatArray]:
        """Return what the sensors read in each window of a group, (ticks, outputs)."""
        parts = [self._parts[k] for k in group.members]
        plant = in_run.plant_of(parts[0])
        starts = self._starts(parts, group.drives, plant)
        return plant.simulate_each(group.drives, range(len(parts)), starts, self.longest_step)

    def _left(
        self, vector: FloatArray, function: Callable[[WindowGroup, FloatArray], FloatArray]
    ) -> list[FloatArray]:
        """Simulate every group, and do something with its weighted residual, in order."""
        in_run = self._in_runs(vector)

        def several(group: WindowGroup) -> list[FloatArray]:
            every = np.arange(len(group.members))
            left = group.readings.left(self._simulated(group, in_run), every, in_run.lateness)
            return [function(group, left)]

        return self._of_groups(several)

    def _of_groups(
        self, function: Callable[[WindowGroup], list[T]], seconds: float | None = None
    ) -> list[T]:
        """Do something with every group; `seconds` are simulated by it (default: all once)."""
        checkpoint()
        note_simulated_time(
            sum(part.length for part in self._parts) if seconds is None else seconds
        )
        groups = self._groups
        threads = 1 if side_by_side.is_one_of_several() else side_by_side.PROCESSORS
        each = map if threads == 1 or len(groups) < 2 else _pool(threads).map
        return [item for items in each(function, groups) for item in items]

    def _wandering(self, part: Prepared) -> list[tuple[IndexArray, FloatArray]]:
        """Return what zeros that wander do in a window: a sensor's rows, a column a cosine."""
        measured = part.window.measured
        ticks, channels = np.divmod(part.pick, part.columns.size)
        time = measured.time[part.window.first + ticks]
        found = []
        for number, at in enumerate(part.columns):
            wander, rows = measured.wander.get(self.plant.outputs[at]), channels == number
            if wander is None or np.count_nonzero(rows) < 2:
                continue
            own, places = cosines(time[rows], wander), np.flatnonzero(rows)
            if part.whitening is not None:
                # noise that remembers does so within its own channel
                own = part.whitening[places][:, places] @ own
            found.append((places, own))
        return found

    def _ready(self, window: Window) -> Prepared:
        measured = window.measured
        use = [
            at
            for at, name in enumerate(measured.outputs)
            if name in self.noise and self.noise[name] > 0 and name in self._outputs
        ]
        span = slice(window.first, window.last)
        drive = measured.drive(window.first, window.last, history=_HISTORY)
        compared_at = measured.distinct_within(span)[:, use]
        compared = [measured.outputs[at] for at in use]
        levels = np.array([self.noise[name] for name in compared])
        scale = _scale_of(measured, compared, levels, span)
        pick = np.flatnonzero(compared_at.ravel())
        columns = np.array([self._outputs[measured.outputs[at]] for at in use], dtype=np.intp)
        ticks, channels = np.divmod(pick, columns.size)
        colours = [measured.colours.get(name) for name in compared]
        return Prepared(
            window,
            drive,
            columns,
            pick,
            (drive.first + ticks) * len(self.plant.outputs) + columns[channels],
            (measured.values[span][:, use] / scale).ravel()[pick],
            np.broadcast_to(scale, compared_at.shape).ravel()[pick],
            np.zeros((pick.size, 0)),
            np.zeros(0),
            whitening=whitening(
                measured.time[span],
                compared_at,
                colours,
                levels / scale if measured.scattered else None,
            ),
            instants=instants_of(
                measured,
                compared,
                columns,
                window.first,
                drive,
                (ticks, channels),
            ),
        )

    def _starts(
        self, parts: Sequence[Prepared], drives: Drives, plant: Parametrised
    ) -> list[dict[str, float]]:
        """Return where windows start that are simulated with the same parameters."""
        windows = [part.window for part in parts]
        read, carried = [item.initial for item in windows], [item.carried for item in windows]
        starts = starts_of(plant, drives, read, carried)
        for part, start in zip(parts, starts, strict=True):
            if part.moved is not None:
                for (name, spread), z in zip(part.starts.items(), part.moved, strict=True):
                    if name in self.plant.states or name in plant.hidden:
                        start[name] = start.get(name, 0.0) + float(z) * spread
        return starts

    def _of_drives(
        self, part: Prepared, drives: Sequence[Drive], readings: WindowReadings, in_run: _InRuns
    ) -> list[FloatArray]:
        """Return a window's weighted residual under each of some other drives, (N,)."""
        plant = in_run.plant_of(part)
        laid_out = Drives(tuple(drives))
        starts = self._starts([part] * len(drives), laid_out, plant)
        simulated = plant.simulate_each(laid_out, range(len(drives)), starts, self.longest_step)
        windows = np.zeros(len(drives), dtype=np.intp)
        return readings.each(readings.left(simulated, windows, in_run.lateness), windows)


def _scale_of(
    measured: Measured, names: Sequence[str], levels: FloatArray, span: slice
) -> FloatArray:
    """Return the noise of readings, SI, (m,) or where stamps scatter (ticks, m).

    Args:
        measured: the run. names: m channels. levels: (m,) their noise at rest. span: ticks.
    """
    if measured.scattered.keys().isdisjoint(names):
        return levels
    nothing = np.zeros(span.stop - span.start)
    moved = [
        measured.scattered[name].moved[span] if name in measured.scattered else nothing
        for name in names
    ]
    return np.asarray(np.hypot(levels, np.stack(moved, axis=1)), dtype=np.float64)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Return the threads that simulate windows; the kernel runs without the interpreter's lock."""
    return ThreadPoolExecutor(threads, thread_name_prefix="simulate")


def soften(residual: FloatArray, scale: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Return residuals and row weights under soft-L1 at 5 sigma, or 5 times a larger scale.

    rho(r) = 2 c^2 (sqrt(1 + (r / c)^2) - 1); the weights multiply the rows of a Jacobian.
    """
    limit = _SOFT * scale
    ratio = residual / limit
    root = np.sqrt(1.0 + ratio * ratio)
    soft = np.sign(residual) * np.sqrt(2.0 * limit**2 * (root - 1.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        weight = np.where(np.abs(residual) > 1e-6, residual / (root * soft), 1.0)
    return soft, np.where(np.isfinite(weight), weight, 1.0)


def cost_of(problem: Problem, vector: FloatArray) -> float:
    """Return the sum of squares of a problem's softened residual."""
    soft, _ = soften(problem.residual(vector), problem.soft)
    return float(soft @ soft)

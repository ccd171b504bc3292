"""Bounds of an effect's parameters by what was measured.

A valve that is open most of the time is a leak with another name: above its setting, a relief valve
that drains to a tank is a leak that drains to a vessel of that pressure, and no recording tells the
two apart. So a setting is no lower than what is reached half of the time, nor than a tenth of what
is hardly ever exceeded. A search begins at none above the highest, where the valve never opens; a
fit may end a little above it, as a stiff valve holds the pressure at its setting.

A friction that is still falling at the fastest speed is a curve like any other: with a viscous
friction beside it, it is as good as a drag that grows with the square of the speed. So the speed by
which it falls is at most a fifth of the fastest: of an exponential, less than 1 % is left there.

A play as large as all travel never closes: what is beyond it would be another mass.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.noise import quantum_of, sharp_noise_of
from eha_bench.plants.effect import AT, BoundEffect, Spot
from eha_bench.plants.layout import Layout

_SAMPLES = 2000
"""Samples that a median is taken over, evenly spread."""
_LOWEST = 0.1
"""Least setting, as a share of a pressure that is hardly ever exceeded."""
_FADED = 1.0 / 5.0
"""Largest speed by which something falls, as a share of the fastest."""
_STRETCHES = (0.02, 0.05, 0.1, 0.2, 0.5)
"""Times over which a speed may be read from a position, s."""
_CLEAR = 10.0
"""How often the noise of a position it has to move by for a speed to be read."""
_FEWEST = 10
"""Fewest readings of a position that show a speed."""
_FASTEST = 0.995
"""Share of samples below what counts as the fastest, or the highest: the rest may be outliers."""

NO_BOUNDS = (-np.inf, np.inf)


@dataclass(frozen=True)
class ReachedBounds:
    """Between what a parameter may be by what was measured.

    Attributes:
        key: `effect.parameter`. choices: places of the choices that it depends on.
        bounds: their values -> lowest and highest value, SI.
        first: their values -> highest value that a search begins from, SI; where there is one.
    """

    key: str
    choices: tuple[int, ...]
    bounds: dict[tuple[float, ...], tuple[float, float]]
    first: dict[tuple[float, ...], float] = field(default_factory=dict)

    def at(self, vector: FloatArray) -> tuple[float, float]:
        """Return them for the choices of a vector of parameters, SI."""
        return self.bounds.get(self._chosen(vector), NO_BOUNDS)

    def highest_first(self, vector: FloatArray) -> float:
        """Return the highest value that a search begins from, for the same choices, SI."""
        return self.first.get(self._chosen(vector), np.inf)

    def _chosen(self, vector: FloatArray) -> tuple[float, ...]:
        return tuple(float(vector[place]) for place in self.choices)


def reached_bounds(layout: Layout, runs: Sequence[Measured]) -> tuple[ReachedBounds, ...]:
    """Return the bounds of the parameters of a plant's effects by what was measured.

    Args:
        layout: of the plant. runs: what was measured; those that do not show it say nothing.
    """
    return (*_settings(layout, runs), *_fading_speeds(layout, runs), *_plays(layout, runs))


def _settings(layout: Layout, runs: Sequence[Measured]) -> Iterable[ReachedBounds]:
    opening = [effect for effect in layout.effects if effect.action.opens is not None]
    if not opening:
        return ()
    of_runs = [_pair(run) for run in runs]
    pairs = [pair for pair in of_runs if pair.size]
    if not pairs:
        return ()
    pressures = np.concatenate(pairs)
    a, b = pressures.T
    highest = pressures[[int(np.argmax(values)) for values in (a, b, a - b, b - a)]]
    if len(pairs) < len(of_runs):
        # nobody knows how high the others went
        highest = highest[:0]
    pressures = pressures[:: max(1, len(pressures) // _SAMPLES)]
    return tuple(_least_and_first(layout, effect, pressures, highest) for effect in opening)


def _least_and_first(
    layout: Layout, effect: BoundEffect, pressures: FloatArray, highest: FloatArray
) -> ReachedBounds:
    """Return between what a setting may be, and the highest that a search begins from.

    Args:
        layout: of the plant. effect: what opens. pressures: of both chambers, (n, 2) Pa.
        highest: where one of them, or their difference, is the highest, (k, 2) Pa; none: not known.
    """
    opening = effect.action.opens
    assert opening is not None
    names = [name for name in inspect.signature(opening.reached).parameters
             if name not in ("p_a", "p_b")]  # fmt: skip
    words = [range(len(effect.parameter(name).choices)) for name in names]
    bounds, first = {}, {}
    for chosen in product(*words):
        values = tuple(map(float, chosen))
        reached = [opening.reached(p_a, p_b, *values) for p_a, p_b in pressures.tolist()]
        usual, hardly_ever = (float(np.quantile(reached, share)) for share in (0.5, _FASTEST))
        bounds[values] = max(usual, _LOWEST * hardly_ever), np.inf
        if highest.size:
            first[values] = max(opening.reached(p_a, p_b, *values) for p_a, p_b in highest.tolist())
    places = tuple(layout.index[f"{effect.id}.{name}"] for name in names)
    return ReachedBounds(f"{effect.id}.{opening.setting}", places, bounds, first)


def _pair(run: Measured) -> FloatArray:
    """Return both pressures where both were read, (k, 2) Pa; none where they were not."""
    read = [run.read(name) for name in run.roles.pair]
    known = [values for values in read if values is not None]
    if len(known) != 2:
        return np.zeros((0, 2))
    both = np.column_stack(known)
    return np.asarray(both[np.isfinite(both).all(axis=1)])


def _fading_speeds(layout: Layout, runs: Sequence[Measured]) -> Iterable[ReachedBounds]:
    for effect in layout.effects:
        if name := effect.action.fades_by:
            yield _at_most(layout, effect, name, lambda spots: _FADED * _fastest(spots, runs))


def _plays(layout: Layout, runs: Sequence[Measured]) -> Iterable[ReachedBounds]:
    for effect in layout.effects:
        if name := effect.action.plays:
            yield _at_most(layout, effect, name, lambda spots: _travel(spots, runs))


def _at_most(
    layout: Layout, effect: BoundEffect, name: str, most: Callable[[Sequence[Spot]], float]
) -> ReachedBounds:
    """Return the bounds of a parameter that is at most so much, by the places where it acts."""
    several = len(effect.places) > 1
    bounds: dict[tuple[float, ...], tuple[float, float]] = {
        (float(number),) if several else (): (-np.inf, most(effect.spots_of(number)))
        for number in range(len(effect.places))
    }
    places = (layout.index[f"{effect.id}.{AT}"],) if several else ()
    return ReachedBounds(f"{effect.id}.{name}", places, bounds)


def _travel(spots: Sequence[Spot], runs: Sequence[Measured]) -> float:
    """Return the longest way that a run shows at some places, SI; inf if none shows one."""
    read = [way for spot in spots for run in runs if (way := run.read(spot.motion[0])) is not None]
    ways = [float(np.ptp(way[np.isfinite(way)])) for way in read if np.isfinite(way).any()]
    return max((way for way in ways if way > 0.0), default=np.inf)


def _fastest(spots: Sequence[Spot], runs: Sequence[Measured]) -> float:
    """Return the fastest speed that was reached at all of some places, SI; inf if none is seen.

    Places that never move are left out.
    """
    found = []
    for spot in spots:
        speeds = [np.abs(speed) for run in runs if (speed := _speed(run, spot)).size]
        if speeds:
            found.append(float(np.quantile(np.concatenate(speeds), _FASTEST)))
    return min((speed for speed in found if speed > 0.0), default=np.inf)


def _speed(run: Measured, spot: Spot) -> FloatArray:
    """Return the speeds at a place that a run shows, (k,); none where it shows none."""
    position, speed = spot.motion
    read = run.read(speed)
    if read is None and (way := run.read(position)) is not None:
        read = _clear_slopes(run.time, way)
    return np.zeros(0) if read is None else np.asarray(read[np.isfinite(read)])


def _clear_slopes(time: FloatArray, way: FloatArray) -> FloatArray:
    """Return the speeds behind a position, (k,): over the shortest time that shows more than noise.

    None where no time does: the place does not move, or a coarse sensor does not say how fast.
    """
    good = np.isfinite(way)
    time, way = time[good], way[good]
    if way.size < _FEWEST:
        return np.zeros(0)
    loud = max(sharp_noise_of(way), quantum_of(way))
    for stretch in _STRETCHES:
        speeds = _slopes(time, way, max(stretch, float(np.median(np.diff(time)))))
        if speeds.size and np.quantile(np.abs(speeds), _FASTEST) * stretch > _CLEAR * loud:
            return speeds
    return np.zeros(0)


def _slopes(time: FloatArray, way: FloatArray, stretch: float) -> FloatArray:
    """Return the speeds between readings of a position some time apart, none across gaps, (k,)."""
    first = np.arange(way.size)
    second = np.searchsorted(time, time + (1.0 - 1e-9) * stretch)
    inside = second < way.size
    first, second = first[inside], second[inside]
    lasts = time[second] - time[first]
    near = lasts < 2.0 * stretch
    return np.asarray((way[second] - way[first])[near] / lasts[near])

"""What simulations leave of readings: one call of compiled code against the same in NumPy."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array

from eha_bench.diagnosis.fit.instants import Instants
from eha_bench.diagnosis.fit.prepared import Prepared, WanderingZero
from eha_bench.diagnosis.fit.readings import StartBases, WindowReadings

WIDTH = 3


def part(rng: np.random.Generator, ticks: int, *, coloured: bool, timed: bool) -> Any:
    """A window of two outputs with readings missing, as a problem prepares it."""
    pick = np.sort(rng.choice(2 * ticks, size=int(1.4 * ticks), replace=False))
    columns = np.array([2, 0])
    step, channel = np.divmod(pick, 2)
    size = pick.size
    whitening = None
    if coloured:
        dense = np.eye(size) - 0.5 * np.eye(size, k=-1)
        whitening = csr_array(dense)
    instants = None
    if timed:
        rows = np.flatnonzero(channel == 1)
        time = 0.01 * np.arange(ticks)
        stamps = time[step[rows]] + 0.004
        clocks = np.zeros(rows.size, dtype=np.intp)
        instants = Instants(rows, np.zeros(rows.size, dtype=np.intp), stamps, clocks,
                            ("bus",), time, 0)  # fmt: skip
    return SimpleNamespace(
        pick=pick,
        places=step * WIDTH + columns[channel],
        target=rng.normal(size=size),
        scale=rng.uniform(0.5, 2.0, size),
        whitening=whitening,
        instants=instants,
        basis=np.linalg.qr(rng.normal(size=(size, 2)))[0],
        shrink=rng.uniform(0.1, 0.9, 2),
        offset=rng.normal(size=size) if timed else None,
        weights=None if timed else rng.uniform(0.5, 1.0, size),
        zeros=tuple(
            WanderingZero.of(
                np.flatnonzero(channel == number), rng.normal(size=((channel == number).sum(), 3))
            )
            for number in ((0, 1) if timed else ())
        ),
        window=SimpleNamespace(measured=SimpleNamespace(run=SimpleNamespace(name="r"))),
    )


def expected(item: Any, simulated: np.ndarray, late: float) -> np.ndarray:
    """The weighted residual of one window, reading by reading."""
    out = simulated.ravel()[item.places]
    if item.instants is not None:
        its = item.instants
        at = its.stamps - late
        for row, column, instant in zip(its.rows, its.columns, at, strict=True):
            after = int(np.clip(np.searchsorted(its.ticks, instant), 1, its.ticks.size - 1))
            share = (instant - its.ticks[after - 1]) / (its.ticks[after] - its.ticks[after - 1])
            before, then = simulated[after - 1, column], simulated[after, column]
            out[row] = before + share * (then - before)
            if 0.0 <= share <= 1.0 and after + 1 < its.ticks.size:
                # ticks are 10 ms apart: a parabola through three
                three = slice(after - 1, after + 2)
                bent = np.polyfit(its.ticks[three] - instant, simulated[three, column], 2)[-1]
                out[row] = bent if np.isfinite(bent) else np.nan
    left = np.nan_to_num(item.target - out / item.scale, nan=1e9, posinf=1e9, neginf=-1e9)
    left = np.clip(left, -1e9, 1e9)
    return left if item.whitening is None else item.whitening @ left


@pytest.mark.parametrize("late", [0.0, 0.003, 0.5])
def test_readings_of_several_windows_are_left_as_one_by_one(late: float) -> None:
    rng = np.random.default_rng(4)
    parts = [
        part(rng, 20, coloured=False, timed=True),
        part(rng, 31, coloured=True, timed=False),
        part(rng, 12, coloured=True, timed=True),
    ]
    which = np.array([0, 1, 1, 2])
    simulated = [rng.normal(size=(ticks, WIDTH)) for ticks in (20, 31, 31, 12)]
    simulated[1][7, 0] = np.nan
    simulated[2][3, 2] = -np.inf
    readings = WindowReadings(parts, WIDTH)
    found = readings.left(simulated, which, {"r": {"bus": late}})
    each = readings.each(found, which)
    for values, own, number in zip(simulated, each, which, strict=True):
        np.testing.assert_allclose(own, expected(parts[number], values, late), rtol=1e-12)


def test_start_bases_take_what_starts_could_have_done() -> None:
    rng = np.random.default_rng(5)
    parts = [part(rng, 20, coloured=False, timed=timed) for timed in (True, False)]
    sizes = [item.pick.size for item in parts]
    residual = rng.normal(size=sum(sizes))
    bases = StartBases(parts)
    found = np.split(bases.white(residual), [sizes[0]])
    for item, own, rest in zip(parts, np.split(residual, [sizes[0]]), found, strict=True):
        left = own if item.offset is None else own - item.offset
        left = left if item.weights is None else left * item.weights
        for zero in item.zeros:
            left = zero.without(left)
        projected = item.basis @ (item.shrink * (item.basis.T @ left))
        np.testing.assert_allclose(rest, left - projected, atol=1e-12)
    assert bases.are_of(parts)
    parts[1].basis = parts[1].basis.copy()
    assert not bases.are_of(parts)


def test_a_residual_of_noise_starts_and_wandering_zeros_is_white() -> None:
    """T (1 + U U' + W W') T' = 1, and C^(-1) is its inverse, by a matrix of columns."""
    rng = np.random.default_rng(6)
    size = 12
    nothing: Any = None
    item = Prepared(
        nothing, nothing, np.arange(2), np.arange(size), *[nothing] * 3, nothing, nothing
    )
    starts = 3.0 * rng.normal(size=(size, 2))
    rows = np.arange(1, size, 2), np.arange(0, size, 2)
    zeros = [(own, 2.0 * rng.normal(size=(own.size, 3))) for own in rows]
    item.span(starts, zeros)
    covariance = np.eye(size) + starts @ starts.T
    for own, columns in zeros:
        covariance[np.ix_(own, own)] += columns @ columns.T
    white = np.column_stack([item.white(unit) for unit in np.eye(size)])
    inverse = np.column_stack([item.at_best(unit) for unit in np.eye(size)])
    np.testing.assert_allclose(white @ covariance @ white.T, np.eye(size), atol=1e-10)
    np.testing.assert_allclose(inverse @ covariance, np.eye(size), atol=1e-10)

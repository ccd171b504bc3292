"""Cuts runs into windows that are simulated on their own: multiple shooting.

A locked piston, or ports connected, keep the model's error bounded, so such runs are replayed whole
from their start; so does a position loop inside the plant, where a log is too slow for windows. A
free rod integrates every error, so those runs are cut into windows of some 0.4 s (Bock's multiple
shooting with the start states taken from the measurement; Ljung, System Identification, 2nd ed.
1999, section 5.3). A window never starts at a jump of the command, nor within 1.5 mm of a stop or
reversal, where bristles and backlash have an unmeasured state.

Where an input is a measured state its noise drives every simulation, and what that adds up to grows
with the length of a window, so then locked and bypassed runs are cut as well, and where nothing
moves for long, in parts of a second: how many simulations a window takes grows with its length too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.diagnosis.data.measured import Measured

FREE_WINDOW = 0.4
"""Length of a window of a free run, s."""
LONGEST_SHAKEN = 1.0
"""About the longest window of a run that a measured input's noise drives, s."""
_CLEAR = {"m": 1.5e-3, "rad": 0.02}
"""How far something has to have moved on since it last reversed or rested, by its unit."""
_QUIET = 0.015
_FEWEST = 100
"""Least readings of a window in which a position that is controlled tells enough."""
_HALF_FIT = 8
"""Most ticks on either side of one from which its state is taken."""
_READINGS = 4
"""Readings on either side of a channel that is read less often than that."""
_RESTED = 5
"""Fewest samples of a speed, all within the noise of nothing, from which a run begins at rest."""
_STEP = 0.1
"""Share of what a valve's command goes through from which it is much."""
_ASKED = 0.02
"""Share of what a valve's command goes through from which it moves the machine."""
_LITTLE = 1e-3
"""Share of an input's range within which it rests."""
_HELD = 0.03
"""How long a command that rests stays so, s: a controller slower than the log holds it for less."""
_ENOUGH = 7
"""Samples around a tick that say how far a polynomial through them may be off."""
_BENDS = 3.0
"""What a polynomial may be off, in the noise, up to which it says more than a single reading."""
_FEWEST_BESIDE = 3
_BESIDE = 0.04
"""And about how far they may be, s, where a controller moves the state within fewer readings."""


@dataclass(frozen=True)
class Window:
    """A stretch of a run that is simulated from its own start state.

    Attributes:
        measured: the run.
        first, last: ticks, last exclusive.
        initial: channel -> what its sensor reads at the start, SI.
        spread: channel -> standard deviation of that state, SI; those without are exact.
        noise: channel -> standard deviation of its noise, SI.
        carried: state -> where a simulation brought it, SI, of states that nothing reads.
    """

    measured: Measured
    first: int
    last: int
    initial: Mapping[str, float]
    spread: Mapping[str, float]
    noise: Mapping[str, float] = field(default_factory=dict)
    carried: Mapping[str, float] = field(default_factory=dict)


def runs_of(windows: Iterable[Window]) -> tuple[Measured, ...]:
    """Return the runs that windows are of, each once."""
    return tuple({id(window.measured): window.measured for window in windows}.values())


def cut_windows(
    measured: Measured, noise: Mapping[str, float], length: float = FREE_WINDOW
) -> list[Window]:
    """Return the windows of a run, in the order of time, without overlap.

    Args:
        measured: the run.
        noise: channel -> standard deviation of its noise.
        length: shortest window of a run that is cut, s.
    """
    n = measured.time.size
    allowed = None if is_whole(measured) else _permitted_starts(measured, noise)
    starts = [0 if allowed is None else _first_start(measured, noise, allowed)]
    forced = set(measured.breaks)
    for k in range(starts[0] + 1, n):
        long_enough = measured.time[k] - measured.time[starts[-1]] >= length
        if k in forced or (allowed is not None and long_enough and allowed[k]):
            starts.append(k)
    windows = [
        window_at(measured, first, last, noise)
        for first, last in zip(starts, [*starts[1:], n], strict=True)
        if last - first >= 4
    ]
    if not _is_shaken(measured):
        return windows
    return [part for window in windows for part in split(window, LONGEST_SHAKEN)]


def _first_start(measured: Measured, noise: Mapping[str, float], allowed: BoolArray) -> int:
    """Return the tick at which a run's first window starts: where what nobody logs is known.

    A run that begins at rest starts at its first sample. In the midst of a motion, or where a log
    begins with a valve's step, what its spool and a drive were asked for before is not in the log.
    """
    moves = _begins_in_motion(measured, noise) or _turns_at_first(measured, noise)
    given = any(is_given_at_first(measured, name) for name in measured.roles.remembered)
    if not (moves or steps_at_first(measured) or given):
        return 0
    within = np.flatnonzero(allowed[: np.searchsorted(measured.time, FREE_WINDOW)])
    return int(within[0]) if within.size else 0


def is_whole(measured: Measured) -> bool:
    """Whether a run is simulated from its start, and cut nowhere but at gaps.

    Of a position that follows an input only in a slow log: in a window of few readings the start
    state takes what the controller holds against.
    """
    slow = _FEWEST * measured.tick > FREE_WINDOW
    held = measured.run.locked or measured.run.bypass_open or (slow and _follows(measured))
    # what an elastic joint holds in the midst of a motion is only known from the run's start on
    return (held or bool(measured.roles.bent)) and not _is_shaken(measured)


def is_bounded(measured: Measured) -> bool:
    """Whether an error does not add up over a whole run: something holds what moves to its place.

    That is a locked piston, ports that are connected, or a controller inside the plant.
    """
    held = measured.run.locked or measured.run.bypass_open or _follows(measured)
    return held and not _is_shaken(measured)


def _follows(measured: Measured) -> bool:
    """Whether a controller inside the plant makes a position follow an input."""
    return any(name in measured.inputs for name in measured.roles.followed)


def _is_shaken(measured: Measured) -> bool:
    """Whether a run's inputs drive a balance with their sensors' noise."""
    roles = measured.roles
    own = roles.added_up if measured.run.locked else (*roles.added_up, *roles.added_up_by_rod)
    return any(name in measured.input_noise for name in own)


def split(window: Window, length: float) -> list[Window]:
    """Return a long window as parts of about a length in s; a short one as it is."""
    measured = window.measured
    time = measured.time
    parts = max(1, round(float(time[window.last - 1] - time[window.first]) / length))
    edges = np.linspace(window.first, window.last, parts + 1).round().astype(int)
    if parts == 1:
        return [window]
    pieces = [window_at(measured, int(a), int(b), window.noise) for a, b in pairwise(edges)]
    return [replace(window, last=int(edges[1])), *pieces[1:]]


def window_at(measured: Measured, first: int, last: int, noise: Mapping[str, float]) -> Window:
    """Return one window, its start state taken from the measurement around its first tick."""
    state, spread = _start(measured, first, noise, rested=first == 0)
    return Window(measured, first, last, state, spread, noise)


def from_another_angle(window: Window, measured: Measured) -> Window:
    """Return a window of the same run, of which only the shaft's angle at the start is another."""
    state, spread = dict(window.initial), dict(window.spread)
    _turn(measured, window.first, window.noise, state, spread)
    return replace(window, measured=measured, initial=state, spread=spread)


def _permitted_starts(measured: Measured, noise: Mapping[str, float]) -> BoolArray:
    """Where a window may start: command without jumps, rod and shaft well under way."""
    time = measured.time
    n = time.size
    fine = np.ones(n, dtype=np.bool_)
    reach = max(2, round(_QUIET / measured.tick))
    for k in measured.jumps:
        fine[max(0, k - reach) : k + reach] = False
    for name in measured.roles.rate_of:
        position = measured.column(name)
        if position is not None:
            least = _CLEAR.get(measured.roles.units.get(name, "m"), 1.5e-3)
            fine &= _clear_of_reversals(time, position, noise.get(name, 0.0), least)
    for name in measured.roles.rates:
        speed = measured.column(name)
        if speed is not None:
            if measured.apart:
                good = np.isfinite(speed)
                speed = np.interp(time, time[good], speed[good])
            level = np.abs(_smooth(np.nan_to_num(speed), reach))
            fine &= level > 5.0 * noise.get(name, 0.0)
    ticks = np.arange(n)
    for column, name in enumerate(measured.outputs):
        valid = measured.valid[:, column]
        if half_fit(measured, name) > _HALF_FIT:
            # beyond a jump of a command its readings tell nothing, and there are few of them
            near = _counted(valid, *_own_side(measured, ticks, _half_around(measured, name)))
            fine &= near >= _ENOUGH
            fine &= valid | measured.apart
        else:
            fine &= _known_near(valid) if measured.apart else valid
    half = max((half_fit(measured, name) for name in measured.outputs), default=_HALF_FIT)
    fine[: half + 1] = False
    fine[n - half - 1 :] = False
    return fine


def half_fit(measured: Measured, name: str) -> int:
    """Return the ticks on either side of one from which the state of a channel is taken there."""
    return max(_HALF_FIT, _READINGS * measured.strides[name])


def _known_near(valid: BoolArray) -> BoolArray:
    """Where enough samples are near for a start state, of a channel that ticks by itself."""
    tick = np.arange(valid.size)
    low, high = np.maximum(tick - _HALF_FIT, 0), np.minimum(tick + _HALF_FIT + 1, valid.size)
    return np.asarray(_counted(valid, low, high) >= _ENOUGH)


def _counted(valid: BoolArray, low: IndexArray, high: IndexArray) -> IndexArray:
    """Return how many values are valid from each of `low` to before each of `high`."""
    total = np.concatenate([[0], np.cumsum(valid)])
    return np.asarray(total[high] - total[low], dtype=np.intp)


def _own_side(measured: Measured, ticks: IndexArray, half: int) -> tuple[IndexArray, IndexArray]:
    """Return where the neighbours of some ticks begin and end, on their own side of what bends.

    That is a gap, or a jump of an input: beyond one everything bends, and a current is another one.
    """
    low, high = np.maximum(ticks - half, 0), np.minimum(ticks + half + 1, measured.time.size)
    breaks = np.asarray(sorted(measured.breaks), dtype=np.intp)
    jumps = np.setdiff1d(measured.jumps, breaks).astype(np.intp)
    # what is logged at the tick of a jump belongs to what was before, unless that was a gap
    before = np.searchsorted(jumps, ticks, side="left")
    _cut_at(jumps + 1, before, low, high)
    _cut_at(breaks, np.searchsorted(breaks, ticks, side="right"), low, high)
    return low, high


def _cut_at(edges: IndexArray, before: IndexArray, low: IndexArray, high: IndexArray) -> None:
    """Cut neighbourhoods at the edges next to them, of which so many are before their ticks."""
    some, more = before > 0, before < edges.size
    low[some] = np.maximum(low[some], edges[before[some] - 1])
    high[more] = np.minimum(high[more], edges[before[more]])


def _clear_of_reversals(
    time: FloatArray, position: FloatArray, noise: float, least: float
) -> BoolArray:
    """Whether a position has moved on by some way since it last reversed or rested."""
    good = np.isfinite(position)
    x = np.interp(time, time[good], position[good])
    clear = min(least, 0.1 * float(np.ptp(x)))
    hysteresis = max(6.0 * noise, 0.02 * clear)
    ok = np.zeros(x.size, dtype=np.bool_)
    direction = 0.0
    extreme = turn = x[0]
    for k in range(1, x.size):
        if direction == 0.0:
            if abs(x[k] - turn) > hysteresis:
                direction = float(np.sign(x[k] - turn))
                extreme = x[k]
        elif direction * (x[k] - extreme) > 0.0:
            extreme = x[k]
        elif direction * (extreme - x[k]) > hysteresis:
            turn, direction, extreme = extreme, -direction, x[k]
        ok[k] = direction != 0.0 and abs(x[k] - turn) > clear
    return ok


def _smooth(values: FloatArray, half: int) -> FloatArray:
    kernel = np.ones(2 * half + 1) / (2 * half + 1)
    return np.convolve(values, kernel, mode="same")


def _start(
    measured: Measured, first: int, noise: Mapping[str, float], *, rested: bool
) -> tuple[dict[str, float], dict[str, float]]:
    """State at a window's start from the measurement around it, and how far it may be off."""
    state: dict[str, float] = dict(measured.held)
    spread: dict[str, float] = {}
    lead = _lead(measured, noise) if rested else 0
    for name in measured.outputs:
        column = measured.column(name)
        if column is None:
            continue
        sigma = noise.get(name, 0.0)
        colour = measured.colours.get(name)
        part = column[:lead]
        part = part[np.isfinite(part)]
        # a channel that is first read after it has begun to move is known by what follows
        if part.size:
            loud = sigma * (colour.loudness_of_mean(part.size) if colour else 1.0)
            state[name] = float(np.median(part) if part.size > 4 else part.mean())
            if name in measured.roles.rates:
                at_rest = abs(part.mean()) < 4.0 * loud / np.sqrt(part.size) + 1e-12
                state[name] = 0.0 if at_rest else float(part.mean())
                if at_rest and part.size >= _RESTED:
                    continue
            spread[name] = max(3.0 * loud / np.sqrt(part.size), 0.1 * sigma)
        else:
            around = _around(measured, first, name)
            since = measured.at(name, around) - measured.time[first]
            local = _local(since, column[around], sigma)
            if local is None and rested:
                local = _before_first_reading(measured.at(name, slice(None)), column)
            if local is None:
                continue
            state[name] = local[0]
            spread[name] = 10.0 * sigma + local[1]
    _spread_through_gears(measured, state, spread)
    if lead <= 1:
        _derive_velocities(measured, first, noise, state, spread)
    _start_of_acting(measured, first, lead, state, spread)
    if measured.run.locked:
        for name in measured.roles.locked:
            if name in measured.roles.rates:
                state.pop(name, None)
                spread.pop(name, None)
    _turn(measured, first, noise, state, spread)
    return state, spread


def _start_of_acting(
    measured: Measured,
    first: int,
    lead: int,
    state: dict[str, float],
    spread: dict[str, float],
) -> None:
    """Set what acts in a drive at a tick: what was read there, or asked for before."""
    for name, asked in measured.roles.acting.items():
        command = measured.inputs.get(asked)
        current = measured.column(name)
        if first in measured.breaks and current is not None and np.isfinite(current[first]):
            # what was commanded in the gap is unknown, and a polynomial bends where it steps
            state[name] = float(current[first])
        elif name not in state and command is not None:
            state[name] = float(command[first if first in measured.breaks else max(0, first - 1)])
        if lead > 0:
            state[name] = _start_current(measured, name, state)
        spread.pop(name, None)


def _turn(
    measured: Measured,
    first: int,
    noise: Mapping[str, float],
    state: dict[str, float],
    spread: dict[str, float],
) -> None:
    """Set the angle of the shaft at a tick, and how far it may be off."""
    if measured.turning is None or measured.shaft_angle is None:
        return
    speed, angle, ratio = measured.turning
    state[angle] = float(measured.shaft_angle[first])
    walked = 0.0
    own = measured.input_noise if speed in measured.inputs else noise
    if speed in own:
        # what the noise of the speed adds up to
        period = float(measured.time[-1]) / (measured.time.size - 1)
        colour = measured.colours.get(speed)
        loud = own[speed] * (colour.loudness_of_mean(max(1, first)) if colour else 1.0)
        walked = loud / abs(ratio) * np.sqrt(float(measured.time[first]) * period)
    elif not measured.start.is_estimated:
        return
    spread[angle] = float(np.hypot(walked, measured.start.spread))


def _start_current(measured: Measured, name: str, state: Mapping[str, float]) -> float:
    value = state.get(name, 0.0)
    column = measured.column(name)
    first = int(np.argmax(np.isfinite(column))) if column is not None and measured.apart else 0
    if column is not None and np.isfinite(column[first]):
        value = float(column[first])
        # at rest a current within the noise of nothing is nothing
        if abs(value) < 0.02 * float(np.nanmax(np.abs(column))):
            value = 0.0
    return value


def _spread_through_gears(
    measured: Measured, state: Mapping[str, float], spread: dict[str, float]
) -> None:
    """Set how far states may be off that channels behind gears tell of (`through_parts`)."""
    for name, (shown, ratio) in measured.roles.geared.items():
        if name in spread and shown not in state and shown not in measured.inputs:
            spread[shown] = spread[name] / abs(ratio)


def _unread_rates(measured: Measured) -> Iterator[tuple[str, str]]:
    """Yield positions with their rates, where nothing reads or holds these."""
    roles, run = measured.roles, measured.run
    read = {*measured.inputs}
    read |= {name for name in measured.outputs if measured.column(name) is not None}
    told = {shown for name, (shown, _) in roles.geared.items() if name in read}
    for name, rate in roles.rate_of.items():
        if rate not in read | told and not (run.locked and name in roles.locked):
            yield name, rate


def _derive_velocities(
    measured: Measured,
    first: int,
    noise: Mapping[str, float],
    state: dict[str, float],
    spread: dict[str, float],
) -> None:
    """Where nothing reads a velocity, take the slope of its position."""
    for name, rate in _unread_rates(measured):
        if rate not in state and (slope := _slope(measured, first, noise, name)) is not None:
            state[rate], spread[rate] = slope


def _lead(measured: Measured, noise: Mapping[str, float]) -> int:
    """Return the samples from a run's start over which all rests, 1 where it begins in motion."""
    return 1 if _begins_in_motion(measured, noise) else _rest_length(measured, noise)


def _begins_in_motion(measured: Measured, noise: Mapping[str, float]) -> bool:
    """Whether a position whose velocity nothing reads has a slope at a run's start.

    A slow channel has few samples before it leaves the noise, and seems to rest so long.
    """
    slopes = (_slope(measured, 0, noise, name) for name, _ in _unread_rates(measured))
    return any(abs(value) > spread for value, spread in filter(None, slopes))


def steps_at_first(measured: Measured) -> tuple[str, ...]:
    """Return the valves' commands that ask for much at a run's first sample."""
    commands = {name: measured.inputs.get(name) for name in measured.roles.remembered}
    return tuple(
        name
        for name, own in commands.items()
        if own is not None and abs(own[0]) > _STEP * float(np.ptp(own))
    )


def is_given_at_first(measured: Measured, name: str) -> bool:
    """Whether a valve is asked for something at a run's first sample, and at once for another.

    What it was asked for before is in no log then; a command that rests was there before.
    """
    own = measured.inputs.get(name)
    if own is None:
        return False
    swing = float(np.ptp(own))
    since = max(_RESTED, round(_HELD / measured.tick))
    rests = np.all(np.abs(own[:since] - own[0]) <= _LITTLE * swing)
    return bool(abs(own[0]) > _ASKED * swing and not rests)


def _turns_at_first(measured: Measured, noise: Mapping[str, float]) -> bool:
    """Whether a speed that was logged is not that of rest in a run's first samples."""
    for name in measured.roles.rates:
        column = measured.column(name)
        if column is None:
            continue
        part = column[: 2 * _HALF_FIT]
        part = part[np.isfinite(part)][:_RESTED]
        sigma = noise.get(name, 0.0)
        if part.size and float(np.abs(part).min()) > 4.0 * sigma:
            return True
    return False


def _slope(
    measured: Measured, first: int, noise: Mapping[str, float], name: str
) -> tuple[float, float] | None:
    """Return the velocity behind a position at a tick, and how far it may be off; None for none."""
    position = measured.column(name)
    if position is None:
        return None
    around = _around(measured, first, name)
    t, x = measured.at(name, around), position[around]
    good = np.isfinite(x)
    if good.sum() < 4:
        return None
    t = t[good] - measured.time[first]
    slope = float(np.polyfit(t, x[good], 2 if good.sum() > 5 else 1)[-2])
    sigma = noise.get(name, 0.0)
    random = 10.0 * sigma / float(np.sqrt(np.sum((t - t.mean()) ** 2)) + 1e-300)
    further = float(np.polyfit(t, x[good], 3)[-2]) if good.sum() > 6 else slope
    _, ratio = measured.roles.geared.get(name, ("", 1.0))
    return slope / ratio, (random + 3.0 * abs(further - slope)) / abs(ratio)


def _rest_length(measured: Measured, noise: Mapping[str, float]) -> int:
    """Samples from the start until something moves, an input or an output: 1 to 200."""
    longest = min(200, measured.time.size)
    end = longest
    for name, values in measured.inputs.items():
        little = max(_LITTLE * (np.ptp(values) or 1.0), 6.0 * measured.input_noise.get(name, 0.0))
        moved = np.flatnonzero(np.abs(values[:longest] - values[0]) > little)
        if moved.size:
            end = min(end, int(moved[0]) + 1)
    for name in measured.outputs:
        column = measured.column(name)
        if column is None:
            continue
        begins = column[int(np.argmax(np.isfinite(column)))]
        moved = np.flatnonzero(np.abs(column[:end] - begins) > 6.0 * noise.get(name, 0.0))
        if moved.size:
            # it began to move earlier than it left the noise
            end = min(end, max(1, int(moved[0]) // 4))
    return max(1, end)


def _half_around(measured: Measured, name: str) -> int:
    """Return how far a channel's neighbours are taken, in ticks: less where it is controlled."""
    half = half_fit(measured, name)
    if _follows(measured):
        half = min(half, max(_FEWEST_BESIDE, round(_BESIDE / measured.tick)))
    return half


def _around(measured: Measured, first: int, name: str) -> slice:
    """Return a tick's neighbours on its own side of gaps and of jumps of an input.

    Of a channel that is read less often than others, ticks further away are neighbours.
    """
    low, high = _own_side(measured, np.array([first]), _half_around(measured, name))
    return slice(int(low[0]), int(high[0]))


def _before_first_reading(t: FloatArray, y: FloatArray) -> tuple[float, float] | None:
    """Return the value at time zero by a line through the first readings, and how far it may be."""
    first = np.flatnonzero(np.isfinite(y))[:_ENOUGH]
    if first.size < _ENOUGH:
        return None
    value = float(np.polyfit(t[first], y[first], 1)[-1])
    return value, 2.0 * abs(value - float(y[first[0]]))


def _local(t: FloatArray, y: FloatArray, noise: float) -> tuple[float, float] | None:
    """Value at time zero from a polynomial through neighbours, and how far the next degree is.

    Where that is far beyond the noise, as while a joint rings after a jump, no polynomial follows,
    and the reading of that tick itself says more.
    """
    good = np.isfinite(y)
    if good.sum() < 3:
        return None
    if good.sum() < _ENOUGH:
        return float(np.mean(y[good])), float(np.ptp(y[good]))
    value = float(np.polyfit(t[good], y[good], 2)[-1])
    further = abs(float(np.polyfit(t[good], y[good], 4)[-1]) - value)
    here = np.flatnonzero(good & (t == 0.0))
    if here.size and 0.0 < _BENDS * noise < further:
        return float(y[here[0]]), 0.0
    return value, further

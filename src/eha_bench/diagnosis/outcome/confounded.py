"""What speaks of causes that these recordings, or any, cannot tell from something more ordinary.

A weight that is small beside a declared one is what a sensor's zero that is off makes of that one:

    G cos(q - alpha_0) = W (delta cos q - epsilon sin q),  -W (1 + epsilon) sin(q - delta)

to first order, with W = m g l.

Where the speed alone is read of a machine that is linear, its sensor's lag and a lag of the command
can be taken one for the other: linear filters in a row have no order.

Friction that seems to grow with pressure may as well fall with speed, where every run at a higher
pressure moved more slowly. Within a run both may hardly change; so runs are compared, by ranks
(Spearman, Am. J. Psychol. 15 (1904) 72): the usual pressure, and the usual speed while something
moves.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.per_cent import per_cent
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.reversals import goes_one_way
from eha_bench.diagnosis.outcome.diagnosis import FoundEffect
from eha_bench.plants.effect import EVERYWHERE, BoundEffect
from eha_bench.plants.plant import Plant

_FEWEST = 3
"""Least number of runs that say how two quantities change together."""
_TOGETHER = 0.9
"""Rank correlation from which they do."""
_VARIES = 1.2
"""Least ratio of the largest to the smallest value over runs that is a change."""
_MOVES = 0.2
"""Share of a run's largest speed from which something moves."""
_WEIGHT = "gravity_load"
_OFFSET = "pressure_sensor_offset"
_LOPSIDED = "asymmetric_friction"
_DRY = "coulomb"
"""In the name of a dry friction's size."""
_SMALL = 0.2
"""Share of a declared weight up to which first order holds: 2 % of it is lost."""
_LAGS_OF_DRIVES = ("current_lag", "command_lag")
_LAG_OF_SENSOR = "sensor_lag"
_PRESSED = {"p_a", "p_b", "pump_load", "difference"}
"""What laws name that follow a pressure."""
_FRICTION = {"dry", "viscous"}
"""Hooks of a friction, which may as well follow the speed."""


def confounding_notes(
    measured: Sequence[Measured], effects: Sequence[BoundEffect]
) -> tuple[str, ...]:
    """Return what speaks of friction that follows a pressure where speed changes with it.

    Args:
        measured: runs that were fitted. effects: those that were found.
    """
    pressed = [
        effect.id
        for effect in effects
        if follows_pressure(effect) and _FRICTION & set(effect.action.hooks)
    ]
    if not pressed or len(measured) < _FEWEST:
        return ()
    # where several do, the closest says it all
    closest = max(_together(measured), key=lambda item: abs(item[2]), default=None)
    if closest is None:
        return ()
    pressure, speed, rho = closest
    way = "lower" if rho < 0.0 else "higher"
    return (
        f"CAUTION: speed and pressure are confounded: from run to run, {speed} is {way} where "
        f"{pressure} is higher (rank correlation {rho:.2f} over {len(measured)} runs), so the "
        f"pressure dependence of {' and '.join(pressed)} may in part be one on speed; runs at "
        "one speed and all pressures would separate them",
    )


def lag_notes(compared: Collection[str], plant: Plant, effects: Sequence[BoundEffect]) -> list[str]:
    """Return what speaks of a lag of the drive that may be one of the only sensor, or the reverse.

    Args:
        compared: channels that were fitted. plant: of the model. effects: those that were found.
    """
    named = [effect.id for effect in effects if effect.id in (*_LAGS_OF_DRIVES, _LAG_OF_SENSOR)]
    known = {effect.id for effect in plant.layout.effects}
    sensors = {
        name
        for effect in plant.layout.effects
        if effect.id == _LAG_OF_SENSOR
        for spot in effect.spots
        for name in spot.sensors
    }
    if len(named) != 1 or len(compared) > 1 or not sensors.intersection(compared):
        return []
    others = [_LAG_OF_SENSOR] if named[0] != _LAG_OF_SENSOR else sorted(known & {*_LAGS_OF_DRIVES})
    if not others:
        return []
    return [
        f"'{name}' alone is read: {' or '.join(others)} would look much like {named[0]}; log a "
        "position, or a current, as well"
        for name in compared
    ]


def one_way_notes(
    measured: Sequence[Measured], noise: Mapping[str, float], calibrated: Collection[str]
) -> list[str]:
    """Return what a dry friction holds as well where nothing goes both ways.

    Args:
        measured: runs that were fitted. noise: of their channels. calibrated: keys of parameters.
    """
    dry = [key for key in calibrated if _DRY in key.rpartition(".")[2]]
    moving = {name for item in measured for name in item.outputs if name in item.roles.rates}
    moving |= {name for item in measured for name in item.outputs if name in item.roles.rate_of}
    one_way = goes_one_way(measured, noise)
    if not dry or not one_way or set(one_way) != moving:
        # what rests, or goes both ways, says nothing of the kind
        return []
    return [
        f"every fitted run goes one way ({', '.join(one_way)}), so {' and '.join(sorted(dry))} "
        "may hold a constant load, or a friction that differs by direction, as well: record runs "
        "that go both ways"
    ]


def constant_load_notes(plant: Plant, effects: Sequence[FoundEffect]) -> list[str]:
    """Return what looks like a friction that differs by direction, where no weight was tried.

    Args:
        plant: of the model. effects: those that were found.
    """
    tried = {
        spot.name
        for effect in plant.layout.effects
        if effect.id == _WEIGHT
        for spot in effect.spots
    }
    return [
        f"CAUTION: a constant load at '{item.at}' (a weight on a drum, a zero of the command) "
        f"looks much like {item.id} while it moves; at rest, without a command, it pulls"
        for item in effects
        if item.id == _LOPSIDED and item.at not in tried
    ]


def zero_offset_notes(
    plant: Plant, vector: FloatArray, effects: Sequence[FoundEffect]
) -> tuple[str, ...]:
    """Return what speaks of a small weight beside a declared one: a zero that is off.

    Args:
        plant, vector: as fitted. effects: those that were found.
    """
    notes = []
    for item in effects:
        declared = plant.hanging_weight(vector, item.at)
        if item.id != _WEIGHT or not declared > 0.0 or item.settings.get("posture") != "link":
            continue
        torque, level = (item.parameters[name].value for name in ("gravity_torque", "level_angle"))
        zero, heavier = (
            torque * math.cos(level) / declared, -torque * math.sin(level) / declared
        )  # fmt: skip
        if max(abs(zero), abs(heavier)) < _SMALL:
            notes.append(
                f"CAUTION: {_WEIGHT} is small beside the weight that is declared at '{item.at}': "
                f"an angle whose zero is {math.degrees(zero):.2g} deg off, and a weight "
                f"{per_cent(heavier, 1)} larger, look the same; read the angle where it hangs"
            )
    return tuple(notes)


def shared_offset_notes(
    plant: Plant, calibrated: Collection[str], effects: Sequence[FoundEffect]
) -> list[str]:
    """Return what looks like one offset of all pressure sensors: reservoirs that hold more.

    Flows follow differences of pressures. Where all are read as much too high, a tank and a supply
    that are as much higher than declared do the same, but for oil that is softer at less pressure.

    Args:
        plant: of the model. calibrated: keys of parameters that were fitted. effects: those found.
    """
    held = [key for key in plant.reservoir_pressures if key not in calibrated]
    offset = next(
        (
            item.parameters["offset"].value
            for item in effects
            if item.id == _OFFSET and item.at == EVERYWHERE
        ),
        None,
    )
    if offset is None or not held:
        return []
    way = "higher" if offset > 0.0 else "lower"
    is_, it = ("is", "it") if len(held) == 1 else ("are", "them")
    return [
        f"CAUTION: {' and '.join(held)} {is_} not calibrated: {abs(offset) / 1e3:.3g} kPa {way} "
        f"than declared looks the same as that offset of all sensors; measure {it}, or list {it} "
        "under `calibrate`"
    ]


def follows_pressure(effect: BoundEffect) -> bool:
    """Whether the laws of an effect name a pressure."""
    return bool(_wants(effect) & _PRESSED)


def is_pressure(plant: Plant, variable: str) -> bool:
    """Whether what a curve follows is a pressure, or a difference of two."""
    return variable.startswith("pressure_") or plant.units.get(variable) == "Pa"


def _wants(effect: BoundEffect) -> set[str]:
    """Return what the laws of an effect name."""
    functions = effect.action.hooks.values()
    return {name for law in functions for name in inspect.signature(law).parameters}


def _together(measured: Sequence[Measured]) -> Iterator[tuple[str, str, float]]:
    """Yield pressures and speeds that change together over runs, with their rank correlation."""
    from scipy.stats import spearmanr

    pressures = [_pressures(item) for item in measured]
    speeds = [_speeds(item) for item in measured]
    for pressure in sorted(set.intersection(*(set(item) for item in pressures))):
        for speed in sorted(set.intersection(*(set(item) for item in speeds))):
            pair = np.array(
                [[a[pressure], b[speed]] for a, b in zip(pressures, speeds, strict=True)]
            )
            low, high = pair.min(axis=0), pair.max(axis=0)
            if (low <= 0.0).any() or (high < _VARIES * low).any():
                continue
            rho = float(spearmanr(pair[:, 0], pair[:, 1]).statistic)
            if abs(rho) >= _TOGETHER:
                yield pressure, speed, rho


def _columns(item: Measured) -> Iterator[tuple[str, FloatArray]]:
    for name in (*item.inputs, *item.outputs):
        column = item.inputs.get(name, item.column(name))
        if column is not None:
            yield name, column


def _pressures(item: Measured) -> dict[str, float]:
    """Return the usual size of each pressure in a run, Pa."""
    units = item.roles.units
    return {
        name: float(np.nanmedian(np.abs(column)))
        for name, column in _columns(item)
        if units.get(name) == "Pa" or name in item.roles.pressures
    }


def _speeds(item: Measured) -> dict[str, float]:
    """Return the usual speed in a run while something moves, of each rate and each position."""
    found = {}
    for name, column in _columns(item):
        if name in item.roles.rates:
            found[name] = _usual(column)
        elif name in item.roles.rate_of:
            good = np.isfinite(column)
            if good.sum() > 4 * _MEAN:
                found[f"the speed of {name}"] = _usual(_slope(item.time[good], column[good]))
    return found


_MEAN = 10
"""Samples over which a speed is taken from a position."""


def _slope(time: FloatArray, position: FloatArray) -> FloatArray:
    return (position[_MEAN:] - position[:-_MEAN]) / (time[_MEAN:] - time[:-_MEAN])


def _usual(speed: FloatArray) -> float:
    size = np.abs(speed[np.isfinite(speed)])
    if not size.size:
        return 0.0
    moving = size[size > _MOVES * np.quantile(size, 0.95)]
    return float(np.median(moving)) if moving.size else 0.0

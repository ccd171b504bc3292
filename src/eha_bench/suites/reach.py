"""What a trial asks of its channel, key by key, and whether that can be reached."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

from eha_bench.core.channels import unit_of
from eha_bench.core.errors import InputError, Place
from eha_bench.core.limit import Bounds
from eha_bench.core.located import Located
from eha_bench.core.trial import AskedLevel, Trial
from eha_bench.suites.signals.signal_model import SignalModel

ANYWHERE: Final[Mapping[str, Bounds]] = {"joint_angle": Bounds(0.0, math.pi)}
"""What a channel can be by its definition: the angle between two links is between 0 and 180 deg."""

_PLAIN: Final = ("initial", "final", "value", "low", "high", "levels")
_SHOWN: Final = {"rad": ("deg", 180.0 / math.pi), "m": ("mm", 1e3)}
_SLACK: Final = 1e-9


def asked_levels(
    channel: str, initial: Mapping[str, float], signal: SignalModel, trial: Located
) -> tuple[AskedLevel, ...]:
    """Return the levels that a trial names, each with the key it was written under.

    Args:
        channel: what the trial controls.
        initial: start values by channel, SI.
        signal: of the trial, as it was written.
        trial: the trial as it was written.
    """
    wave = trial.at("signal")
    found: list[AskedLevel] = []
    start = initial.get(channel)
    if start is not None:
        found.append(AskedLevel(start, start, trial.place(("setup", "initial", channel))))
    for key in (key for key in _PLAIN if key in type(signal).model_fields):
        for place, value in _numbers(getattr(signal, key)):
            found.append(AskedLevel(value, value, wave.place((key, *place))))
    if "amplitude" in type(signal).model_fields:
        offset = float(getattr(signal, "offset", 0.0))
        largest = max(abs(value) for _, value in _numbers(signal.__dict__["amplitude"]))
        found.append(AskedLevel(offset, offset, wave.place(("offset",))))
        found.append(AskedLevel(offset - largest, offset + largest, wave.place(("amplitude",))))
    return tuple(found)


def _numbers(value: Any) -> Iterator[tuple[tuple[int, ...], float]]:
    if isinstance(value, (list, tuple)):
        for place, item in enumerate(value):
            yield (place,), float(item)
    elif isinstance(value, (int, float)):
        yield (), float(value)


def check_anywhere(trial: Trial) -> None:
    """Raise an InputError where a trial asks for, or starts at, what no target can reach.

    Args:
        trial: its levels and its setup know where they were written.
    """
    why = "the angle between two links is from"
    for name, bounds in ANYWHERE.items():
        if trial.channel == name:
            check_reach(trial, bounds, why)
        start, places = trial.setup.initial, trial.setup.places
        if name in start:
            level = AskedLevel(start[name], start[name], places.get(name, Place()))
            _check_level(level, bounds, unit_of(name), why)


def check_reach(trial: Trial, bounds: Bounds, why: str) -> None:
    """Raise an InputError where a trial asks for what lies beyond the bounds (SI).

    Args:
        trial: its levels know where they were written.
        bounds: of the channel that the trial controls.
        why: what the bounds are, for the message: 'the knee of simulator goes from'.
    """
    for level in trial.levels:
        _check_level(level, bounds, trial.mode.unit, why)


def _check_level(level: AskedLevel, bounds: Bounds, si_unit: str, why: str) -> None:
    low, high = bounds.low - _SLACK, bounds.high + _SLACK
    if level.low < low or level.high > high:
        wrong = level.low if level.low < low else level.high
        unit, factor = _SHOWN.get(si_unit, (si_unit, 1.0))
        raise InputError(
            f"{factor * wrong:.4g} {unit} cannot be reached: {why} "
            f"{factor * bounds.low:.4g} to {factor * bounds.high:.4g} {unit}",
            where=level.where,
            hint="ask for less, or name a target that goes that far",
        )

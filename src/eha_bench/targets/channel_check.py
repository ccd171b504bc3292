"""Whether a target has the channels that a trial names, in the units that its suite wrote."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from eha_bench.core.channels import CHANNELS, unit_of
from eha_bench.core.errors import InputError, Place
from eha_bench.core.near_miss import suggest
from eha_bench.core.trial import Trial, passes_on


def check_channels(
    trial: Trial,
    units: Mapping[str, str],
    target: str,
    command: str = "",
    held: Collection[str] = (),
) -> None:
    """Refuse a trial on channels that the target does not have, or has in another unit.

    Args:
        trial: what is to be run.
        units: SI unit of every channel that the target measures, derives or is commanded by.
        target: what it is, for messages.
        command: what it is commanded by; a trial that only commands needs no measurement of it.
        held: inputs that no trial drives.

    Raises:
        InputError: with file, line and key of the trial's mode, or the file alone.
    """
    if "pressure_a" in units and "pressure_b" in units:
        units = {"pressure_difference": unit_of("pressure_difference"), **units}
    where = trial.mode.where
    if trial.channel in held and trial.channel not in units:
        raise InputError(
            f"trial '{trial.id}' controls {trial.channel}, an input of {target} that stays at what "
            "the model declares",
            where=where,
            hint=f"a suite drives its command{f', {command}' if command else ''}, or what a "
            "controller follows",
        )
    if trial.channel not in units and not passes_on(trial.mode, command):
        raise InputError(
            f"trial '{trial.id}' controls {trial.channel}, which {target} does not have",
            where=where,
            hint=suggest(trial.channel, [name for name in units if name != "reference"]),
        )
    known = trial.mode.known
    written = trial.mode.unit if known else trial.mode.declared
    _check_unit(trial, trial.channel, written, units, target, where)
    file = Place(file=where.file)
    for name, unit in trial.setup.units.items():
        _check_unit(trial, name, unit, units, target, file)
    for safety in trial.safety:
        if safety.unit:
            _check_unit(trial, safety.channel, safety.unit, units, target, file)
    for limit in trial.limits:
        if limit.channel not in CHANNELS and trial.spec_of(limit.metric).unit is None:
            _check_unit(trial, limit.channel, limit.unit or None, units, target, file)


def _check_unit(
    trial: Trial,
    channel: str,
    written: str | None,
    units: Mapping[str, str],
    target: str,
    where: Place,
) -> None:
    """Refuse a unit other than the target's; nothing written is that of the target."""
    found = units.get(channel)
    if written is not None and found is not None and found != written:
        raise InputError(
            f"trial '{trial.id}' has {channel} in {written or 'a pure number'}, and {target} has "
            f"it in {found or 'a pure number'}",
            where=where,
            hint="write its quantities in a unit of that dimension",
        )

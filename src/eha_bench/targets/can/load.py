"""Reads target.yaml and DBC together; every message and signal that is named has to be there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eha_bench.core import yaml_file
from eha_bench.core.channels import CHANNELS, unit_of
from eha_bench.core.errors import InputError, Place, TargetFault, UnitError
from eha_bench.core.extras import way_to_install
from eha_bench.core.near_miss import likely, suggest
from eha_bench.core.trial import ControlMode, mode_named
from eha_bench.core.units import base_unit
from eha_bench.targets.can.bus import check_channel
from eha_bench.targets.can.drive import (
    CanDrive,
    Coding,
    CommandMessage,
    Condition,
    StatusMessage,
    coding,
)
from eha_bench.targets.can.target_file import CanTargetFile

if TYPE_CHECKING:
    from cantools.database.can.message import Message

STATES = ("off", "enabled", "fault")
_MISSPELT = 0.8
"""So like a known channel is one that was meant to be it."""


def load_drive(path: Path) -> CanDrive:
    """Read a target.yaml of kind `can` and its DBC.

    Raises:
        InputError: a wrong key, unit, message or signal, with file, line and key; or python-can
            and cantools are not installed.
    """
    reader = _DriveReader(path)
    file = reader.file
    for name in STATES:
        if name not in file.state.values:
            raise reader.error(f"no value for '{name}'", ("state", "values"))
    for number, step in enumerate(file.control_word.enable):
        if step.state not in file.state.values:
            hint = suggest(step.state, file.state.values)
            keys = ("control_word", "enable", number, "state")
            raise reader.error(f"unknown state '{step.state}'", keys, hint)
    try:
        check_channel(file.bus)
    except TargetFault as error:
        raise reader.error(error.what, ("bus", "channel"), error.hint) from error
    if file.control_word.enable[-1].state != "enabled":
        raise reader.error("enabling does not end in the state 'enabled'", ("control_word",))
    status, commands = _status(reader), _commands(reader)
    return CanDrive(
        path=path,
        file=file,
        units=reader.units,
        messages={message.frame_id: message for message in reader.database.messages},
        status=status,
        commands=commands,
        sync=_sync(reader),
        state=Condition(
            reader.message(file.state.message, ("state", "message")),
            reader.signal(file.state.message, file.state.signal, ("state",)),
            file.state.mask,
        ),
        states={value & file.state.mask: name for name, value in file.state.values.items()},
        emergency_stop=_condition(reader, file.emergency_stop, "emergency_stop"),
        heartbeat=_heartbeat(reader),
        fault_code=_condition(reader, file.fault_code, "fault_code"),
        fixture=_fixture(reader),
        fixture_done=(
            _condition(reader, file.fixture.done, "fixture", "done") if file.fixture else None
        ),
        model=reader.beside("model", file.model),
        controller=reader.beside("controller", file.controller),
        dbc=reader.dbc,
    )


class _DriveReader:
    """The two files while they are read: places for messages, look-up of names."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.content, self.places = _content(path, ())
        self.file = yaml_file.validate(
            CanTargetFile, self.content, str(path), places=self.place, kind="target"
        )
        dbc = self.beside("dbc", self.file.dbc)
        if dbc is None:
            raise self.error("names no file", ("dbc",))
        self.dbc = dbc
        self.database = _database(dbc, self.place(("dbc",)))
        self._check_names()

    def place(self, keys: Sequence[int | str]) -> Place:
        """Return where a key stands: in the file itself or in its base."""
        file, content = self.places.get(str(keys[0]) if keys else "", (self.path, self.content))
        key = ".".join(str(part) for part in keys)
        return Place(file=str(file), line=yaml_file.line_of(content, keys), key=key)

    def beside(self, key: str, name: str) -> Path | None:
        """Return a file that a key names, relative to the file in which the key stands."""
        if not name:
            return None
        where = self.place((key,))
        folder = Path(where.file).resolve().parent
        # the DBC's reader reports what is wrong with it
        return folder / name if key == "dbc" else yaml_file.named_file(folder, name, where)

    def error(self, what: str, keys: Sequence[int | str], hint: str = "") -> InputError:
        return InputError(what, where=self.place(keys), hint=hint)

    def message(self, name: str, keys: Sequence[int | str]) -> Message:
        try:
            found: Message = self.database.get_message_by_name(name)
            return found
        except KeyError as error:
            names = [message.name for message in self.database.messages]
            raise self.error(
                f"{self.dbc.name} has no message '{name}'", keys, suggest(name, names)
            ) from error

    def signal(self, message: str, name: str, keys: Sequence[int | str]) -> str:
        names = [signal.name for signal in self.message(message, keys).signals]
        if name not in names:
            raise self.error(
                f"message '{message}' has no signal '{name}'",
                (*keys, "signal"),
                suggest(name, names),
            )
        return name

    def coding(self, message: str, place: Any, channel: str, keys: Sequence[int | str]) -> Coding:
        found = self.message(message, (*keys, "message"))
        self.signal(message, place.signal, keys)
        try:
            return coding(found, place, self.unit_of(channel, place))
        except UnitError as error:
            raise self.error(error.what, (*keys, "unit"), error.hint) from error

    def unit_of(self, channel: str, place: Any) -> str:
        """Return a channel's SI unit: as known, or that of the unit that the file gives it."""
        return unit_of(channel) if channel in CHANNELS else base_unit(place.unit)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of every channel that is measured or commanded."""
        found = {name: self.unit_of(name, place) for name, place in self.file.channels.items()}
        for name, place in self.file.commands.items():
            channel = mode_named(name).channel
            found.setdefault(channel, self.unit_of(channel, place))
        return found

    def _check_names(self) -> None:
        for group, names in (
            ("channels", self.file.channels),
            ("limits", self.file.limits),
            ("following", self.file.following),
        ):
            known = CHANNELS if group == "channels" else self.file.channels
            for name in names:
                own = group == "channels" and self.file.channels[name].unit
                near = likely(name, known, likeness=_MISSPELT)
                if name not in known and (near or not own):
                    raise self.error(
                        f"unknown channel '{name}'", (group, name), suggest(name, known)
                    )


def _content(path: Path, above: tuple[Path, ...]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the keys of a file laid over those of its base, and where each of them stands."""
    content = yaml_file.load(path)
    if not isinstance(content, dict):
        raise InputError("expected keys and values", where=Place(file=str(path), line=1))
    places = {str(key): (path, content) for key in content}
    base = content.get("base")
    if not isinstance(base, str) or not base:
        return content, places
    line = yaml_file.line_of(content, ["base"])
    below = (path.resolve().parent / base).resolve()
    if below in above or below == path.resolve():
        where = Place(file=str(path), line=line, key="base")
        raise InputError("a target cannot be its own base", where=where)
    found, found_places = _content(below, (*above, path.resolve()))
    return {**found, **content}, {**found_places, **places}


def _database(path: Path, where: Place) -> Any:
    try:
        import cantools
    except ImportError as error:
        raise InputError(
            "CAN needs the packages cantools, python-can and pyserial",
            hint=way_to_install("can"),
        ) from error
    try:
        return cantools.database.load_file(path, database_format="dbc")
    except OSError as error:
        raise InputError(
            f"the DBC file {path.name} cannot be read ({error.strerror or error})", where=where
        ) from error
    except Exception as error:  # the parser raises errors of several libraries
        first = str(error).strip().splitlines() or [type(error).__name__]
        raise InputError(f"not a DBC file ({first[0]})", where=Place(file=str(path))) from error


def _status(reader: _DriveReader) -> dict[int, StatusMessage]:
    file = reader.file
    names: dict[str, dict[str, Coding]] = {}
    for channel, place in file.channels.items():
        keys = ("channels", channel)
        found = reader.coding(place.message, place, channel, keys)
        names.setdefault(place.message, {})[channel] = found
    names.setdefault(file.state.message, {})
    if file.emergency_stop is not None:
        names.setdefault(file.emergency_stop.message, {})
    for name in file.counters:
        if name not in names:
            hint = suggest(name, names)
            raise reader.error(f"'{name}' is not a message with channels", ("counters", name), hint)
    result = {}
    for name, channels in names.items():
        message = reader.message(name, ("channels",))
        counter = file.counters.get(name, "")
        if counter:
            reader.signal(name, counter, ("counters", name))
        modulus = 1 << message.get_signal_by_name(counter).length if counter else 1
        result[message.frame_id] = StatusMessage(message, channels, counter, modulus)
    return result


def _commands(reader: _DriveReader) -> dict[ControlMode, CommandMessage]:
    commands = {}
    word = reader.file.control_word.signal
    for mode, place in reader.file.commands.items():
        keys = ("commands", mode)
        message = reader.message(place.message, (*keys, "message"))
        reader.signal(place.message, word, ("control_word",))
        for name in place.fixed:
            reader.signal(place.message, name, (*keys, "with", name))
        named = mode_named(mode, where=reader.place(keys))
        code = reader.coding(place.message, place, named.channel, keys)
        if not named.known:
            named = replace(named, declared=reader.unit_of(named.channel, place))
        commands[named] = CommandMessage(message, code, place.fixed)
    return commands


def _sync(reader: _DriveReader) -> Message | None:
    sync = reader.file.sync
    if sync is None:
        return None
    if sync.counter:
        reader.signal(sync.message, sync.counter, ("sync",))
    return reader.message(sync.message, ("sync", "message"))


def _condition(reader: _DriveReader, place: Any, *keys: str) -> Condition | None:
    if place is None:
        return None
    reader.signal(place.message, place.signal, keys)
    mask = getattr(place, "mask", 0xFFFFFFFF)
    value = getattr(place, "value", 0) & mask
    return Condition(reader.message(place.message, keys), place.signal, mask, value)


def _heartbeat(reader: _DriveReader) -> Message | None:
    heartbeat = reader.file.heartbeat
    if heartbeat is None:
        return None
    if heartbeat.signal:
        reader.signal(heartbeat.message, heartbeat.signal, ("heartbeat",))
    return reader.message(heartbeat.message, ("heartbeat", "message"))


def _fixture(reader: _DriveReader) -> Message | None:
    fixture = reader.file.fixture
    if fixture is None:
        return None
    for name in (
        fixture.request,
        fixture.piston.signal,
        fixture.bypass.signal,
        fixture.position.signal,
    ):
        reader.signal(fixture.message, name, ("fixture",))
    reader.coding(fixture.message, fixture.position, "piston_position", ("fixture", "position"))
    return reader.message(fixture.message, ("fixture", "message"))

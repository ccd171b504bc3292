"""`channels`: a first `channels.yaml` for a log, guessed from names, units and types."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import lru_cache
from pathlib import Path

from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import Place, RecordingError, UnitError
from eha_bench.core.units import base_unit, factor_and_offset
from eha_bench.recordings.budget import OverBudget, budget, spending
from eha_bench.recordings.clock_guess import (
    NamedClock,
    best_clock,
    clock_by_values,
    title,
    unlike_their_group,
)
from eha_bench.recordings.information import RecordingInformation, TopicInformation, info
from eha_bench.recordings.source import HOLDS_DATES
from eha_bench.recordings.tables.self_description import named_unit
from eha_bench.recordings.values import ValueInformation

_WORDS = {
    "current_command": ("current command", "current cmd", "current ref", "i cmd", "i ref", "cmd"),
    "current": ("motor current", "current", "i meas", "amps", "effort"),
    "motor_speed": ("motor speed", "speed", "velocity", "rpm", "omega", "shaft speed"),
    "pressure_a": ("pressure a", "p a", "pa", "p1", "pressure 1", "press a", "chamber a"),
    "pressure_b": ("pressure b", "p b", "pb", "p2", "pressure 2", "press b", "chamber b"),
    "pressure_difference": ("pressure difference", "delta p", "dp", "diff pressure"),
    "piston_position": ("piston position", "rod position", "stroke", "position", "pos", "x"),
    "piston_velocity": ("piston velocity", "rod velocity", "rod speed"),
    "joint_angle": ("joint angle", "knee angle", "knee", "angle", "theta"),
    "force": ("force", "load cell", "load"),
    "oil_temperature": ("oil temperature", "temperature", "temp", "t oil"),
    "voltage": ("voltage", "volts", "u"),
    "reference": ("reference", "setpoint", "set point", "target", "desired"),
}
_ALIASES = frozenset(alias for aliases in _WORDS.values() for alias in aliases)
_LETTERS = {
    alias: tuple(Counter(alias).items())
    for channel, aliases in _WORDS.items()
    for alias in (channel.replace("_", " "), *aliases)
}
_UNIT_AT_END = re.compile(
    r"[_\s]+(bar|mbar|psi|pa|kpa|mpa|mm|cm|m|um|rad|deg|rpm|a|ma|v|mv|n|kn|s|ms|us|ns|degc|c|k)$",
    re.I,
)
_SPELT = {
    "a": "A", "c": "degC", "k": "K", "pa": "Pa", "kpa": "kPa", "mpa": "MPa", "ma": "mA", "v": "V",
    "mv": "mV", "n": "N", "kn": "kN", "degc": "degC",
}  # fmt: skip
_SPELT_OUT = {
    "volt": "V", "volts": "V", "amp": "A", "amps": "A", "ampere": "A", "amperes": "A",
    "newton": "N", "newtons": "N", "pascal": "Pa", "pascals": "Pa", "degrees": "deg",
    "radians": "rad", "metres": "m", "meters": "m",
}  # fmt: skip
"""Last words of a name that are its unit, and may tell the channel as well."""
_BARS = (1.0, 1000.0)
"""Pressures whose largest value lies between are hardly in Pa."""
_TIMES = ("time", "timestamp", "t", "stamp", "zeit", "seconds", "sec")
_OWN_CLOCKS = ("mdf", "ulog", "tdms")
"""Formats of tables that say themselves when samples were taken."""
_LIKE = 0.75
_SHARE = 0.9
"""What equal letters count compared with equal words."""
_THE_VALUE = ("data", "fluid_pressure", "temperature", "value")
"""Fields that are all that a message is about: the topic's name tells what that is."""
_BESIDE = ("variance", "data_offset")
_PLAIN = re.compile(r"[A-Za-z/_][\w/.]*")
_WORDS_OF_YAML = frozenset({"y", "n", "yes", "no", "on", "off", "true", "false", "null"})


@dataclass(frozen=True)
class Guess:
    """A field or column, and the channel that it may be.

    Attributes:
        channel: name of the channel; the field's own name where none fits.
        place: `topic: /f, field: data` or `column: p`.
        unit: its unit; empty where nothing tells it.
        reason: what the guess stands on.
        likeness: how sure it is, 0 to 1.
        largest: magnitude of its largest value.
    """

    channel: str
    place: str
    unit: str
    reason: str
    likeness: float
    largest: float = 0.0


def first_map(path: str | Path) -> str:
    """Return a `channels.yaml` for a log, every guess marked as one.

    Raises:
        RecordingError: it is not a recording, or holds no numbers.
    """
    with spending(Path(path)):
        found = info(path)
        table = all(not topic.encoding for topic in found.topics)
        clock = _clock(found) if table else None
        guesses = _guesses(found, clock, table=table)
    if not guesses and found.unseen:
        raise OverBudget(
            f"no number was found in the time that a file of this size may take; {found.unseen} "
            "of its topics or columns were not looked at",
            where=Place(file=str(path)),
            hint="if you trust the file, allow more with --max-time",
        )
    if not guesses:
        raise RecordingError(f"{path}: it holds no numbers that a channel could be")
    lines = [
        f"# A first channel map of {Path(path).name}, GUESSED from names and units:",
        "# check every line. value = (raw * scale + offset) in `unit`, then SI",
    ]
    if found.unseen:
        lines.append(f"# {found.unseen} more topics or columns were not looked at")
    if table:
        lines += _clock_lines(found, clock)
    lines.append("channels:")
    odd = {_place_of(item) for item in _without_clock(found, clock)} if table else set()
    owner: dict[str, Guess] = {}
    for guess in sorted(guesses, key=lambda guess: -guess.likeness):
        owner.setdefault(guess.channel, guess)
    names = _Names(owner)
    left_out: list[str] = []
    for guess in guesses:
        name = guess.channel
        if owner[name] is not guess:
            name = names.unlike(_plain_name(guess.place))
        known = name in CHANNELS
        unit = guess.unit or (CHANNELS[name].unit if known else "")
        why = guess.reason if known else "no channel is called like it"
        caution = "" if guess.unit else ", unit assumed"
        if caution and unit == "Pa" and _BARS[0] <= guess.largest <= _BARS[1]:
            caution += f": its values, up to {guess.largest:.3g}, look like bar"
        entry = f"{_quoted(name)}: {{{guess.place}, unit: {_quoted(unit)}}}"
        if guess.place in odd:
            left_out.append(f"  # {entry}")
        else:
            lines.append(f"  {entry}  # guessed: {why}{caution}")
    if left_out:
        lines.append(
            "  # left out, as the clock above is not theirs; a map of their own reads them:"
        )
        lines += left_out
    return "\n".join(lines) + "\n"


def _guesses(found: RecordingInformation, clock: NamedClock | None, *, table: bool) -> list[Guess]:
    guesses = []
    clocks = {column.name for column, _ in _clocks(found)} if table else set()
    if clock is not None:
        clocks |= {item.name for item in found.topics if clock.name in (item.name, title(item))}
    for topic in found.topics:
        for value in topic.values:
            budget().tick()
            if table and value.name in clocks:
                continue
            if table:
                place, heading = _place_of(topic), value.name
            else:
                place = f"topic: {_quoted(topic.name)}, field: {_quoted(value.name)}"
                last = value.name.rpartition(".")[2]
                if last in _BESIDE or value.name.startswith("layout."):
                    continue
                heading = topic.name if last in _THE_VALUE else f"{topic.name} {value.name}"
            guesses.append(_guess(heading, value, place, timed=clock is not None))
    return guesses


def _guess(heading: str, value: ValueInformation, place: str, *, timed: bool) -> Guess:
    """Return what a field or column may be; `timed` says whether another one is the time."""
    name, unit = named_unit(heading)
    unit = value.unit or unit or ""
    at_end = _UNIT_AT_END.search(name)
    # `p_a` is a pressure, not a p in amperes
    if at_end is not None and not unit and _words(name) not in _ALIASES:
        word = at_end[1].lower()
        # nor is `Boom Ms`, which may be measured, one in milliseconds
        if not (timed and at_end[1] == "Ms"):
            unit, name = _SPELT.get(word, word), name[: at_end.start()]
    words = _words(name)
    unit = unit or _SPELT_OUT.get(words.rpartition(" ")[2], "")
    best, likeness = "", 0.0
    for channel, aliases in _WORDS.items():
        if unit and not _fits(unit, channel):
            continue
        for alias in (channel.replace("_", " "), *aliases):
            ratio = _like(words, alias, max(likeness, _LIKE))
            if ratio > likeness:
                best, likeness = channel, ratio
    if not _is_unit(unit):
        unit = ""
    largest = max(abs(value.minimum), abs(value.maximum))
    if likeness < _LIKE:
        return Guess(_plain_name(place), place, unit, "", 0.0, largest)
    reason = f"'{heading}' is like {best}" + (f", and {unit} fits" if unit else "")
    return Guess(best, place, unit, reason.replace("\n", " "), likeness, largest)


def _words(name: str) -> str:
    """Return a name as words in small letters: `motorSpeed_2` is `motor speed 2`."""
    apart = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return re.sub(r"[^a-z0-9]+", " ", apart.lower()).strip()


def _like(words: str, alias: str, least: float) -> float:
    """Return how alike they are, 0 to 1; 0 where that is below `least`."""
    if words == alias:
        return 1.0
    # whole words at the end tell most: `/drive/current_cmd`
    if len(alias) > 2 and (words.endswith(f" {alias}") or words.startswith(f"{alias} ")):
        return 0.95
    if len(alias) > 3 and f" {alias} " in f" {words} ":
        return 0.9
    if len(alias) < 4:
        return 0.0
    # two bounds first: in a table of thousands of columns nearly all are far from every alias
    enough = least * (len(words) + len(alias)) / (2 * _SHARE)
    if min(len(words), len(alias)) < enough or _in_common(words, alias) < enough:
        return 0.0
    return _SHARE * SequenceMatcher(None, words, alias).ratio()


def _in_common(words: str, alias: str) -> int:
    """Return how many letters they share, in whatever order."""
    return sum(min(count, words.count(letter)) for letter, count in _LETTERS[alias])


@lru_cache(maxsize=4096)
def _fits(unit: str, channel: str) -> bool:
    wanted = CHANNELS[channel].unit
    if not wanted:
        return True
    try:
        factor_and_offset(unit, wanted)
    except UnitError:
        return False
    return True


@lru_cache(maxsize=4096)
def _is_unit(unit: str) -> bool:
    try:
        base_unit(unit)
    except UnitError:
        return False
    return bool(unit)


def _place_of(column: TopicInformation) -> str:
    """Return how a map names a column."""
    return f"column: {_quoted(column.name)}"


def _without_clock(
    found: RecordingInformation, clock: NamedClock | None
) -> Iterator[TopicInformation]:
    """Yield the columns that cannot be read by the clock of the map."""
    if clock is None:
        return unlike_their_group(found.topics)
    return (item for item in found.topics if item.values and not clock.times(item, found.topics))


def _clocks(found: RecordingInformation) -> list[tuple[TopicInformation, str]]:
    """Return the columns that may hold the time, and their units, the likeliest first."""
    clocks = []
    for topic in found.topics:
        for value in topic.values:
            name, unit = named_unit(value.name)
            at_end = _UNIT_AT_END.search(name)
            stem = name[: at_end.start()] if at_end else name
            if stem.rpartition("/")[2].lower() in _TIMES and not value.nan_share > 0:
                written = value.unit or unit or (at_end[1].lower() if at_end else "")
                # `T_c` is a temperature
                if not written or (_is_unit(written) and base_unit(written) == "s"):
                    clocks.append((topic, written))
    return sorted(clocks, key=lambda clock: not clock[0].name.lower().startswith("time"))


def _clock(found: RecordingInformation) -> NamedClock | None:
    """Return the clock of a table: by names; where none is named so, by values."""
    likely = _clocks(found)
    if likely or found.format in _OWN_CLOCKS or _dates(found):
        return best_clock(likely, found.topics)
    return clock_by_values(found)


def _dates(found: RecordingInformation) -> str:
    """Return the column that holds dates, "" if there is none."""
    return next((item.name for item in found.topics if HOLDS_DATES in item.readable), "")


def _clock_lines(found: RecordingInformation, clock: NamedClock | None) -> list[str]:
    if clock is not None:
        source = f"its unit is {'given' if clock.unit else 'assumed'}"
        unit = clock.unit or clock.likely_unit
        line = f"time: {{column: {_quoted(clock.name)}, unit: {_quoted(unit)}}}"
        return [f"{line}  # guessed: {clock.reason or 'by its name'}; {source}"]
    if dates := _dates(found):
        return [f"time: {{column: {_quoted(dates)}}}  # guessed: it {HOLDS_DATES}"]
    if found.format in _OWN_CLOCKS:
        return []
    return ["sample_rate: 1 kHz  # ASSUMED: no column is called like a time"]


def _plain_name(place: str) -> str:
    """Return a channel's name for a place that is like no known channel."""
    words = re.sub(r"\b(topic|field|column):", " ", place)
    name = re.sub(r"[^a-z0-9]+", "_", words.lower()).strip("_") or "channel"
    return name if name != "time" else "time_2"


class _Names:
    """Names that are given once."""

    def __init__(self, taken: Iterable[str]) -> None:
        self._taken = set(taken)
        self._next: dict[str, int] = {}

    def unlike(self, name: str) -> str:
        """Return the name, with a number where it is taken."""
        unique = name
        while unique in self._taken:
            number = self._next.get(name, 2)
            self._next[name] = number + 1
            unique = f"{name}_{number}"
        self._taken.add(unique)
        return unique


def _quoted(text: str) -> str:
    """Return text as YAML reads it back."""
    if _PLAIN.fullmatch(text) and text.lower() not in _WORDS_OF_YAML:
        return text
    return json.dumps(text, ensure_ascii=not text.isprintable())

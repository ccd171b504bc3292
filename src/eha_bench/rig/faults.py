"""What may be made to go wrong, when and for how long: `KIND[=VALUE][@START[+LENGTH]]`."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import InputError, UnitError
from eha_bench.core.near_miss import suggest
from eha_bench.core.units import parse


class FaultKind(StrEnum):
    """What goes wrong."""

    SILENT = "silent"
    FROZEN = "frozen"
    LATE = "late"
    LOST = "lost"
    SCALE = "scale"
    OVER_PRESSURE = "over-pressure"
    BUS_OFF = "bus-off"
    EMERGENCY_STOP = "emergency-stop"


@dataclass(frozen=True)
class Fault:
    """A fault on request.

    Attributes:
        kind: what goes wrong.
        channel: of a sensor fault.
        value: delay in s, share of frames, factor, or Pa/s.
        start: s after the torque first came on; negative infinity: from the beginning.
        length: s.
        text: as it was asked for.
    """

    kind: FaultKind
    channel: str = ""
    value: float = 0.0
    start: float = -math.inf
    length: float = math.inf
    text: str = ""


_FORM = re.compile(r"(?P<kind>[a-z-]+)(=(?P<value>[^@]+))?(@(?P<start>[^+]+)(\+(?P<length>.+))?)?")
_DEFAULTS = {FaultKind.LATE: "5 ms", FaultKind.LOST: "0.1", FaultKind.OVER_PRESSURE: "5000 MPa/s"}
_UNITS = {FaultKind.LATE: "s", FaultKind.LOST: "", FaultKind.OVER_PRESSURE: "Pa/s"}


def parse_fault(text: str) -> Fault:
    """Return the fault that a text asks for, e.g. `frozen=pressure_a@0.5 s` or `late=5 ms@1+0.2`.

    Raises:
        InputError: it is none.
    """
    match = _FORM.fullmatch(text.strip())
    kinds = [kind.value for kind in FaultKind]
    if match is None or match["kind"] not in kinds:
        hint = suggest(match["kind"], kinds) if match else f"kinds: {', '.join(kinds)}"
        raise InputError(f"'{text}' is not a fault", hint=hint or f"kinds: {', '.join(kinds)}")
    kind = FaultKind(match["kind"])
    channel, value = "", 0.0
    try:
        start = parse(match["start"].strip(), "s") if match["start"] else -math.inf
        length = parse(match["length"].strip(), "s") if match["length"] else math.inf
        given = (match["value"] or _DEFAULTS.get(kind, "")).strip()
        if kind in (FaultKind.FROZEN, FaultKind.SCALE):
            channel, _, factor = given.partition(":")
            if channel not in CHANNELS:
                raise InputError(
                    f"'{text}': unknown channel '{channel}'",
                    hint=suggest(channel, CHANNELS) or "e.g. frozen=pressure_a",
                )
            value = parse(factor, "") if kind is FaultKind.SCALE else 0.0
        elif kind in _UNITS:
            value = parse(given, _UNITS[kind])
    except UnitError as error:
        raise InputError(f"'{text}': {error.what}", hint=error.hint) from error
    return Fault(kind, channel, value, start, length, text)


class Faults:
    """The faults of a rig as time goes on."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self._faults = faults
        self._torque_at: float | None = None
        self._started: set[Fault] = set()
        self._held: dict[str, float] = {}
        self._active: dict[FaultKind, Fault] = {}

    def torque_on(self, now: float) -> None:
        """Start the clock of the faults when the torque first comes on."""
        if self._torque_at is None:
            self._torque_at = now

    def update(self, now: float) -> list[str]:
        """Let the faults of this moment act; return those that have just started."""
        started, self._active = [], {}
        for fault in self._faults:
            if fault.start == -math.inf:
                since = 0.0
            elif self._torque_at is None:
                continue
            else:
                since = now - self._torque_at - fault.start
            if 0.0 <= since < fault.length:
                self._active[fault.kind] = fault
                if fault not in self._started:
                    self._started.add(fault)
                    started.append(fault.text)
        if FaultKind.FROZEN not in self._active:
            self._held = {}
        return started

    def active(self, kind: FaultKind) -> Fault | None:
        """Return the fault of a kind that acts now."""
        return self._active.get(kind)

    def faulty_readings(self, reading: Mapping[str, float]) -> dict[str, float]:
        """Return what faulty sensors show for what sound ones would."""
        shown = dict(reading)
        for kind in (FaultKind.FROZEN, FaultKind.SCALE):
            fault = self._active.get(kind)
            if fault is None or fault.channel not in shown:
                continue
            if kind is FaultKind.SCALE:
                shown[fault.channel] *= fault.value
            else:
                shown[fault.channel] = self._held.setdefault(fault.channel, shown[fault.channel])
        return shown

"""What has to hold at every tick before the command goes out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from eha_bench.core.errors import InputError, Place, UnitError
from eha_bench.core.limit import SafetyLimit
from eha_bench.core.linkage import Linkage
from eha_bench.core.units import parse
from eha_bench.targets.can.balance import (
    BALANCED,
    Balance,
    BalanceLimits,
    Tolerance,
    TorqueModel,
)
from eha_bench.targets.can.drive import CanDrive
from eha_bench.targets.can.target_file import BalanceFile, ChannelLimitFile, FollowingFile

_STALE = 0.012
"""Oldest value that is used where the target says nothing, s: well within a 20 ms watchdog."""


@dataclass(frozen=True)
class ChannelLimit:
    """What a channel has to keep, SI; infinite where it need not."""

    channel: str
    low: float = -math.inf
    high: float = math.inf
    rate: float = math.inf
    stale: float = math.inf
    frozen: float = math.inf
    unit: str = ""


@dataclass(frozen=True)
class Following:
    """How far a channel may be from its command (SI) for how long (s)."""

    channel: str
    within: float
    length: float
    unit: str = ""


def channel_limit(channel: str, unit: str, file: ChannelLimitFile, where: Place) -> ChannelLimit:
    """Return a limit of the target file in SI.

    Raises:
        InputError: a wrong unit.
    """
    try:
        return ChannelLimit(
            channel,
            -math.inf if file.low is None else parse(file.low, unit),
            math.inf if file.high is None else parse(file.high, unit),
            math.inf if file.rate is None else parse(file.rate, f"{unit or 1}/s"),
            _STALE if file.stale is None else file.stale,
            math.inf if file.frozen is None else file.frozen,
            unit,
        )
    except UnitError as error:
        raise InputError(error.what, where=where, hint=error.hint) from error


def following(channel: str, unit: str, file: FollowingFile, where: Place) -> Following:
    """Return how closely a channel has to follow, SI.

    Raises:
        InputError: a wrong unit.
    """
    try:
        return Following(channel, parse(file.within, unit), file.length, unit)
    except UnitError as error:
        raise InputError(error.what, where=where, hint=error.hint) from error


def balance_limits(file: BalanceFile, model: TorqueModel) -> BalanceLimits:
    """Return which balances are checked."""
    torque, motion = (
        None if item is None else Tolerance(item.within, item.share)
        for item in (file.torque, file.motion)
    )
    return BalanceLimits(file.over, torque, motion, model)


@dataclass(frozen=True)
class GuardLimits:
    """All that a guard checks."""

    channels: tuple[ChannelLimit, ...]
    following: tuple[Following, ...]
    joint_agrees: float
    balance: BalanceLimits | None = None

    @staticmethod
    def of(drive: CanDrive, model: TorqueModel | None = None) -> GuardLimits:
        """Return the limits of a target file; balances only where the model is known.

        Raises:
            InputError: a wrong unit.
        """

        def where(*keys: str) -> Place:
            return Place(file=str(drive.path), key=".".join(keys))

        file = drive.file
        # a channel without limits is still checked for being frozen
        limits = {name: file.limits.get(name, ChannelLimitFile()) for name in drive.channels}
        return GuardLimits(
            tuple(
                channel_limit(k, drive.units[k], v, where("limits", k)) for k, v in limits.items()
            ),
            tuple(
                following(k, drive.units[k], v, where("following", k))
                for k, v in file.following.items()
            ),
            math.inf if file.joint_agrees is None else file.joint_agrees,
            None if model is None else balance_limits(file.balance, model),
        )


class Guard:
    """Checks readings tick by tick; the first thing that is wrong ends the run."""

    def __init__(
        self,
        limits: GuardLimits,
        safety: Sequence[SafetyLimit],
        linkage: Linkage | None,
        period: float = 1e-3,
    ) -> None:
        self._period = period
        self._balance = Balance(limits.balance, period) if limits.balance is not None else None
        self._limits = limits
        self._safety = safety
        self._linkage = linkage if math.isfinite(limits.joint_agrees) else None
        self._last: dict[str, tuple[float, float]] = {}
        self._same: dict[str, int] = {}
        self._apart: dict[str, float] = {}

    def check(self, now: float, readings: Mapping[str, float], stamps: Mapping[str, float]) -> str:
        """Return what is wrong now, or an empty text.

        Args:
            now: time, s.
            readings: by channel, SI.
            stamps: when each channel was read last, s; a channel that never was is missing.
        """
        for limit in self._limits.channels:
            name = limit.channel
            value, stamp = readings.get(name, math.nan), stamps.get(name, -math.inf)
            if now - stamp > limit.stale:
                return f"stale {name}: nothing for {_ms(now - stamp)} (at most {_ms(limit.stale)})"
            if not limit.low <= value <= limit.high:
                return f"{name} {_text(value, limit.unit)} outside {limit.low:g} .. {limit.high:g}"
            # an answer that came late was not measured when its Sync was sent
            wrong = self._movement_fault(limit, value, stamp) if now - stamp < self._period else ""
            if wrong:
                return wrong
        for safety in self._safety:
            value = readings.get(safety.channel, math.nan)
            if not safety.bounds.holds(value):
                return safety.broken_by(value)
        if self._balance is not None:
            used = [stamps.get(name, -math.inf) for name in BALANCED if name in readings]
            fresh = bool(used) and now - min(used) < self._period
            wrong = self._balance.check(min(used), readings) if fresh else ""
            if wrong:
                return wrong
        if self._linkage is not None:
            angle = self._linkage.angle_at(readings["piston_position"])
            if not abs(angle - readings["joint_angle"]) <= self._limits.joint_agrees:
                return (
                    f"joint_angle {_text(readings['joint_angle'], 'rad')} does not agree "
                    f"with the rod's position, which makes it {_text(angle, 'rad')}"
                )
        return ""

    def follows(
        self,
        now: float,
        readings: Mapping[str, float],
        stamps: Mapping[str, float],
        commanded: float,
    ) -> str:
        """Return which channel does not follow the command of the tick before, or an empty text.

        A channel that is not fresh says nothing about the newest command.
        """
        for item in self._limits.following:
            name = item.channel
            apart = abs(readings.get(name, math.nan) - commanded)
            fresh = now - stamps.get(name, -math.inf) < self._period
            if not fresh or apart <= item.within:
                self._apart.pop(name, None)
            elif now - self._apart.setdefault(name, now) >= item.length:
                return (
                    f"{name} is {_text(apart, item.unit)} from its command for more than "
                    f"{_ms(item.length)}"
                )
        return ""

    def _movement_fault(self, limit: ChannelLimit, value: float, stamp: float) -> str:
        """Return whether a channel jumps, or does not move at all where a sensor has noise."""
        name = limit.channel
        before = self._last.get(name)
        if before is None:
            self._last[name], self._same[name] = (stamp, value), 0
            return ""
        if stamp <= before[0]:
            return ""
        self._last[name] = (stamp, value)
        change = abs(value - before[1])
        # samples are counted, not time: one after a gap may well repeat the one before it
        self._same[name] = 0 if change > 0 else self._same[name] + 1
        if self._same[name] * self._period >= limit.frozen:
            same = f"{self._same[name] + 1} samples"
            return f"{name} is frozen at {_text(value, limit.unit)} for {same}"
        rate = change / (stamp - before[0])
        if rate > limit.rate:
            return f"{name} changes by {rate:.3g} {limit.unit}/s (at most {limit.rate:.3g})"
        return ""


def _text(value: float, unit: str) -> str:
    return f"{value:.5g} {unit}".strip()


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.1f} ms" if math.isfinite(seconds) else "ever"

"""What a rig permits: limits of channels, the range of its command, and the setups it can have."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eha_bench.core import yaml_file
from eha_bench.core.errors import InputError, Place
from eha_bench.core.file_kind import kind_by_keys
from eha_bench.core.shipped import find
from eha_bench.core.trial import Bypass, Piston
from eha_bench.experiment.commanded import Commanded
from eha_bench.plants.plant import Plant
from eha_bench.posterior.covered import Covered
from eha_bench.suites import load_suite
from eha_bench.suites.suite import Suite

SetUp = tuple[Piston, Bypass]

PLANT, RECORDINGS = "the plant", "the recordings"
"""Who says so, where no file does."""
SIGMAS = 4.0
"""Noise, in standard deviations, that a reading has to stay off a limit: one sample in 16,000."""
SHARE = 0.03
"""Further margin, as a share of the distance between a channel's start and its limit."""


@dataclass(frozen=True)
class Limit:
    """What a channel has to keep, SI; infinite where it need not.

    Attributes:
        low, high: its values. rate: its largest change a second.
        reason: who says so: a file, the plant, or the recordings.
    """

    low: float
    high: float
    rate: float = math.inf
    reason: str = ""

    def within(self, other: Limit) -> Limit:
        """Return what both permit."""
        low, high = max(self.low, other.low), min(self.high, other.high)
        tighter = other if (low, high) != (self.low, self.high) else self
        return Limit(low, high, min(self.rate, other.rate), tighter.reason)

    def inside(self, margin: float) -> Limit:
        """Return what may be asked for where a reading of it, with its noise, has to keep this.

        Args:
            margin: that noise takes, SI.
        """
        way = self.high - self.low
        if math.isinf(way):
            way = min(abs(self.low), abs(self.high))
        off = margin + (SHARE * way if math.isfinite(way) else 0.0)
        return Limit(self.low + off, self.high - off, self.rate, self.reason)


@dataclass(frozen=True)
class Permitted:
    """What may be asked of a rig.

    Attributes:
        command: setup -> range of the plant's command, SI.
        limits: setup -> channel -> limit. Setups that are not there are not permitted.
        words: one sentence that says where that is from.
        unwatched: limited channels that the model does not have.
    """

    command: Mapping[SetUp, Limit]
    limits: Mapping[SetUp, Mapping[str, Limit]]
    words: str
    unwatched: tuple[str, ...] = ()


def permitted_ranges(
    plant: Plant,
    commanded: Commanded,
    vectors: Sequence[np.ndarray],
    covered: Covered,
    safety: str | Path | None,
) -> Permitted:
    """Return what a safety file permits; without one, what the recordings have already been to.

    Args:
        plant: of the model. commanded: what experiments give.
        vectors: parameters of each rival, whose ends of stroke count.
        covered: where the recordings have been.
        safety: a target.yaml with `limits`, or a suite whose trials have `safety`; or None.

    Raises:
        InputError: the file is wrong, or says nothing of what is safe.
    """
    seen = {
        item.setup: {
            name: Limit(
                low - _noise(covered, name), high + _noise(covered, name), reason=RECORDINGS
            )
            for name, (low, high) in item.extremes.items()
        }
        for item in covered.setups
    }
    channel = commanded.channel
    ends = _ends(plant, vectors)
    plants_own = Limit(-commanded.limit, commanded.limit, reason=PLANT)
    if channel in ends:
        plants_own = plants_own.within(ends.pop(channel))

    def asked_within(limit: Limit) -> Limit:
        # what is measured has to keep its limit by what the sensor reads of it
        read = limit.inside(_noise(covered, channel)) if commanded.is_imposed else limit
        return plants_own.within(read)

    asked = {
        key: asked_within(own[channel])
        for key, own in seen.items()
        if _can(plant, key) and channel in own
    }
    if safety is None:
        limits = {
            key: _both(
                {
                    name: limit
                    for name, limit in seen[key].items()
                    if name in plant.outputs and (commanded.is_imposed or name != channel)
                },
                ends,
            )
            for key in asked
        }
        words = "no safety file: the extremes of the recordings are the limits"
        return Permitted(asked, limits, words)
    path = find(safety, "suites", "targets")
    file = _safety_file(path)
    command = plants_own
    for name in dict.fromkeys((channel, commanded.mode)):
        if name in file.channels:
            command = command.within(asked_within(file.channels[name]))
    setups = [key for key in file.setups if _can(plant, key)] or list(asked)
    if asked and (math.isinf(command.low) or math.isinf(command.high)):
        # an end without a limit: as far as it has been
        command = command.within(
            Limit(
                min(own.low for own in asked.values()) if math.isinf(command.low) else -math.inf,
                max(own.high for own in asked.values()) if math.isinf(command.high) else math.inf,
                reason=RECORDINGS,
            )
        )
    channels = {
        name: item
        for name, item in file.channels.items()
        if commanded.is_imposed or name != channel
    }
    known = {*measured_of(plant), *plant.inputs, channel}
    return Permitted(
        dict.fromkeys(setups, command),
        dict.fromkeys(setups, _both(channels, ends)),
        f"the limits are those of {path.name}",
        tuple(name for name in channels if name not in known),
    )


def measured_of(plant: Plant) -> frozenset[str]:
    """Return the channels of a plant that a rig measures, or that follow from what it measures."""
    return frozenset((*plant.outputs, *plant.derived_channels, "pressure_difference"))


@dataclass(frozen=True)
class _SafetyFile:
    channels: Mapping[str, Limit]
    setups: tuple[SetUp, ...]


def _safety_file(path: Path) -> _SafetyFile:
    content = yaml_file.load(path)
    if isinstance(content, dict) and content.get("target") == "can":
        return _of_drive(path)
    kind = kind_by_keys(content)
    if kind is not None and kind.name == "suite":
        return _of_suite(load_suite(path))
    raise InputError(
        "it has no safety limits",
        where=Place(file=str(path), line=1),
        hint="give a target.yaml of a drive (key 'limits'), or a suite whose trials have 'safety'",
    )


def _of_suite(suite: Suite) -> _SafetyFile:
    found: dict[str, Limit] = {}
    for trial in suite.trials:
        for item in trial.safety:
            new = Limit(item.bounds.low, item.bounds.high, reason=suite.path.name)
            found[item.channel] = found[item.channel].within(new) if item.channel in found else new
    if not found:
        raise InputError(
            "none of its trials has a safety limit",
            where=Place(file=str(suite.path), line=1),
            hint="add 'safety: {pressure_a: <= 30 MPa}' to its defaults",
        )
    setups = dict.fromkeys((trial.setup.piston, trial.setup.bypass) for trial in suite.trials)
    return _SafetyFile(found, tuple(setups))


def _of_drive(path: Path) -> _SafetyFile:
    # what reads a DBC is an extra
    from eha_bench.targets.can.guard import GuardLimits
    from eha_bench.targets.can.load import load_drive

    drive = load_drive(path)
    found = {
        item.channel: Limit(item.low, item.high, item.rate, path.name)
        for item in GuardLimits.of(drive).channels
    }
    if not found:
        raise InputError(
            "it has no limits", where=Place(file=str(path), line=1), hint="add key 'limits'"
        )
    setups: list[SetUp] = [(Piston.FREE, Bypass.CLOSED)]
    fixture, by_hand = drive.file.fixture, drive.file.setup
    if by_hand is not None:
        setups = [(by_hand.piston, by_hand.bypass)]
    elif fixture is not None:
        pistons = [Piston.FREE, Piston.LOCKED]
        valves = [Bypass.CLOSED, Bypass.OPEN]
        setups = [(piston, bypass) for piston in pistons for bypass in valves]
    return _SafetyFile(found, tuple(setups))


def _noise(covered: Covered, name: str) -> float:
    """Return what noise alone may read beyond where a channel has been, SI."""
    return SIGMAS * covered.sensor_noise(name)


def _can(plant: Plant, setup: SetUp) -> bool:
    locked, opened = setup[0] is Piston.LOCKED, setup[1] is Bypass.OPEN
    return (plant.can_lock or not locked) and (plant.has_bypass or not opened)


def _ends(plant: Plant, vectors: Iterable[np.ndarray]) -> dict[str, Limit]:
    """Return the ends of what is a position, by channel: where any rival has them."""
    found: dict[str, Limit] = {}
    for vector in vectors:
        for name, (low, high) in plant.position_range(vector).items():
            if math.isfinite(low) or math.isfinite(high):
                new = Limit(low, high, reason=PLANT)
                found[name] = found[name].within(new) if name in found else new
    return found


def _both(first: Mapping[str, Limit], second: Mapping[str, Limit]) -> dict[str, Limit]:
    out = dict(first)
    for name, item in second.items():
        out[name] = out[name].within(item) if name in out else item
    return out

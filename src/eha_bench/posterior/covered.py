"""Where the recordings have been that a model was fitted to, and what lies beyond them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from eha_bench.core.finite import finite_or_none
from eha_bench.core.trial import Bypass, Piston

_MARGIN: Final = 0.1
"""Part of a recorded range that something may lie outside of it and still count as recorded."""
_NOISES: Final = 5.0
"""Standard deviations of a channel's noise that do the same."""


def setup_of(*, locked: bool, bypass_open: bool) -> tuple[str, str]:
    """Return how a suite calls the piston and the bypass of a setup."""
    piston = Piston.LOCKED if locked else Piston.FREE
    bypass = Bypass.OPEN if bypass_open else Bypass.CLOSED
    return piston.value, bypass.value


@dataclass(frozen=True)
class Beyond:
    """A channel outside of what was recorded of it.

    Attributes:
        channel: its name. reached: how far, SI. low, high: recorded, SI.
        distance: outside of them, as a part of the recorded range.
    """

    channel: str
    reached: float
    low: float
    high: float
    distance: float


@dataclass(frozen=True)
class CoveredSetup:
    """One setup of the rig.

    Attributes:
        piston, bypass: their states.
        extremes: channel -> (lowest, highest) that was recorded in it, SI.
        starts: channel -> what it read where recordings begin, the median of them, SI.
        at_rest: whether the machine was at rest there under what it was commanded.
    """

    piston: str
    bypass: str
    extremes: Mapping[str, tuple[float, float]]
    starts: Mapping[str, float] = field(default_factory=dict)
    at_rest: bool = True

    @property
    def setup(self) -> tuple[Piston, Bypass]:
        """The setup as a trial has it."""
        return Piston(self.piston), Bypass(self.bypass)

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        extremes = {name: list(ends) for name, ends in self.extremes.items()}
        return {
            "piston": self.piston,
            "bypass": self.bypass,
            "extremes": extremes,
            "starts": dict(self.starts),
            "at_rest": self.at_rest,
        }

    @staticmethod
    def from_dict(content: Mapping[str, Any]) -> CoveredSetup:
        """Return what `to_dict` gave."""
        extremes = {
            name: (float(low), float(high)) for name, (low, high) in content["extremes"].items()
        }
        starts = {name: float(value) for name, value in (content.get("starts") or {}).items()}
        at_rest = bool(content.get("at_rest", True))
        return CoveredSetup(content["piston"], content["bypass"], extremes, starts, at_rest)


@dataclass(frozen=True)
class Covered:
    """Where the training recordings have been: what a next experiment adds to.

    Attributes:
        rate: samples a second, the lowest of the recordings'. seconds: of all of them.
        inputs: channel -> (low, high, mean), SI.
        noise: channel -> standard deviation, SI. unexplained: channel -> root mean square of what
            is left over the windows of the fit beyond the noise, SI.
        input_noise: channel -> standard deviation of the noise of an input that was measured, SI.
        setups: each with the extremes of every channel in it, SI.
        dataset: the dataset.yaml that names them; "" where it is not a file.
    """

    rate: float
    seconds: float
    inputs: Mapping[str, tuple[float, float, float]]
    noise: Mapping[str, float]
    unexplained: Mapping[str, float]
    setups: tuple[CoveredSetup, ...]
    dataset: str = ""
    input_noise: Mapping[str, float] = field(default_factory=dict)

    @property
    def is_explained(self) -> bool:
        """Whether what is left unexplained is less than the noise, in every channel."""
        return all(left <= self.noise.get(name, 0.0) for name, left in self.unexplained.items())

    def sensor_noise(self, channel: str) -> float:
        """Return the standard deviation of what a channel's sensor adds, SI; 0 where unknown."""
        return self.noise.get(channel, self.input_noise.get(channel, 0.0))

    def error(self, channel: str) -> float:
        """Return what a channel was left with in the fit, noise and unexplained together, SI."""
        return math.hypot(self.noise.get(channel, 0.0), self.unexplained.get(channel, 0.0))

    def setup(self, piston: str, bypass: str) -> CoveredSetup | None:
        """Return what was recorded in a setup, if anything was."""
        return next(
            (item for item in self.setups if (item.piston, item.bypass) == (piston, bypass)), None
        )

    def beyond(
        self, setup: CoveredSetup, extremes: Mapping[str, tuple[float, float]]
    ) -> Iterator[Beyond]:
        """Yield the channels that go further than they were recorded.

        By more than a tenth of the recorded range, and more than noise does: within that a model
        is not asked for anything new.

        Args:
            setup: that was recorded. extremes: channel -> (lowest, highest), SI.
        """
        for name, (low, high) in setup.extremes.items():
            if name not in extremes:
                continue
            lowest, highest = extremes[name]
            reached = lowest if low - lowest > highest - high else highest
            outside = max(low - lowest, highest - high)
            span = high - low
            if outside > self.margin(name, (low, high)):
                yield Beyond(name, reached, low, high, outside / max(span, 1e-300))

    def margin(self, name: str, ends: tuple[float, float]) -> float:
        """Return how far beyond its recorded ends a channel counts as recorded, SI."""
        return max(_MARGIN * (ends[1] - ends[0]), _NOISES * self.noise.get(name, 0.0))

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "rate": finite_or_none(self.rate),
            "seconds": self.seconds,
            "inputs": {name: list(ends) for name, ends in self.inputs.items()},
            "noise": {name: finite_or_none(value) for name, value in self.noise.items()},
            "unexplained": {name: finite_or_none(v) for name, v in self.unexplained.items()},
            "input_noise": {name: finite_or_none(v) for name, v in self.input_noise.items()},
            "setups": [item.to_dict() for item in self.setups],
            "dataset": self.dataset,
        }

    @staticmethod
    def from_dict(content: Mapping[str, Any]) -> Covered:
        """Return what `to_dict` gave; what is not there or could not be computed is left out."""
        inputs, noise = content.get("inputs") or {}, content.get("noise") or {}
        left, shaken = content.get("unexplained") or {}, content.get("input_noise") or {}
        return Covered(
            _number(content.get("rate")),
            float(content.get("seconds") or 0.0),
            {name: (float(a), float(b), float(c)) for name, (a, b, c) in inputs.items()},
            _known(noise),
            _known(left),
            tuple(CoveredSetup.from_dict(item) for item in content.get("setups") or ()),
            str(content.get("dataset", "")),
            _known(shaken),
        )


def _known(values: Mapping[str, float | None]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items() if value is not None}


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)

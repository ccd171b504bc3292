"""Experiments that a rig could be asked for: signals of the suite's language, in each setup.

Each is a shape between -1 and 1 with its own frequency or time scale; `Experiment.trial`
puts it into the command's range.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from eha_bench.core.trial import Trial
from eha_bench.experiment.commanded import Commanded
from eha_bench.experiment.permitted import Limit, SetUp
from eha_bench.suites import load_suite

_SLOWEST = 0.2
"""Lowest frequency that is tried, Hz."""
_QUIET = 0.05
"""Time at rest before a signal, s."""
_PATTERNS = {
    "steps": (1.0, -1.0, 0.5, -0.5, 0.0),
    "staircase": (0.25, 0.5, 0.75, 1.0, 0.75, 0.5, 0.25, 0.0, -0.25, -0.5, -0.75, -1.0, -0.5, 0.0),
    "up": (0.2, 0.4, 0.6, 0.8, 1.0, 0.6, 0.2),
    "down": (-0.2, -0.4, -0.6, -0.8, -1.0, -0.6, -0.2),
}


@dataclass(frozen=True)
class Experiment:
    """One experiment.

    Attributes:
        kind: of signal: steps, ramp, sine, chirp, multisine or prbs. setup: of the rig.
        pattern: of steps. scale: frequency, Hz, or of steps 1 / hold.
        size: of the command's range, 0 to 1. offset: as a share of the range, -1 to 1.
        seconds: length.
    """

    kind: str
    setup: SetUp
    scale: float
    size: float = 1.0
    offset: float = 0.0
    seconds: float = 4.0
    pattern: str = ""

    def at_size(self, size: float) -> Experiment:
        """Return the same at another size."""
        return replace(self, size=size)

    def lasting(self, seconds: float) -> Experiment:
        """Return the same at another length, s."""
        return replace(self, seconds=seconds)

    def signal(self, command: Limit, unit: str) -> dict[str, Any]:
        """Return the suite's words for the signal.

        Args:
            command: range, SI. unit: behind every level; "" for none.
        """
        reach = min(abs(command.low), abs(command.high)) if command.low < 0.0 < command.high else (
            0.5 * (command.high - command.low)
        )  # fmt: skip
        middle = 0.0 if command.low < 0.0 < command.high else 0.5 * (command.low + command.high)
        amplitude = reach * self.size * (1.0 - abs(self.offset))
        offset = middle + reach * self.size * self.offset

        def level(value: float) -> Any:
            number = float(f"{value:.5g}")
            return f"{number:g} {unit}" if unit else number

        def hertz(value: float) -> str:
            return f"{value:.4g} Hz"

        at = {"at": f"{_QUIET:g} s"}
        if self.kind == "steps":
            pattern = _PATTERNS[self.pattern]
            hold = 1.0 / self.scale
            count = max(1, int(np.ceil((self.seconds - _QUIET) / hold)))
            levels = [level(offset + amplitude * pattern[k % len(pattern)]) for k in range(count)]
            rest = level(middle)
            return {"kind": "steps", "initial": rest, "levels": levels, "hold": f"{hold:.4g} s",
                    **at}  # fmt: skip
        if self.kind == "ramp":
            return {"kind": "ramp", "initial": level(offset - amplitude if self.offset else middle),
                    "final": level(offset + amplitude), "over": f"{1.0 / self.scale:.4g} s",
                    **at}  # fmt: skip
        if self.kind == "sine":
            return {"kind": "sine", "amplitude": level(amplitude), "offset": level(offset),
                    "frequency": hertz(self.scale), **at}  # fmt: skip
        if self.kind == "chirp":
            return {"kind": "chirp", "amplitude": level(amplitude), "offset": level(offset),
                    "f_start": hertz(0.1 * self.scale), "f_stop": hertz(self.scale),
                    "duration": f"{self.seconds - _QUIET:.4g} s", **at}  # fmt: skip
        if self.kind == "multisine":
            return {"kind": "multisine", "amplitude": level(amplitude), "offset": level(offset),
                    "period": f"{max(10.0 / self.scale, 0.2):.4g} s", "phases": "schroeder",
                    "f_min": hertz(min(0.1 * self.scale, 5.0)), "f_max": hertz(self.scale),
                    "periods": max(1, int(np.ceil(self.seconds * self.scale / 10.0))),
                    **at}  # fmt: skip
        return {"kind": "prbs", "low": level(offset - amplitude), "high": level(offset + amplitude),
                "bit": f"{0.5 / self.scale:.4g} s", "order": 9, "initial": level(offset),
                "periods": max(1, int(np.ceil(self.seconds * 2.0 * self.scale / 511.0))),
                **at}  # fmt: skip

    def trial(self, name: str, plan: ExperimentSettings) -> dict[str, Any]:
        """Return the trial as a suite has it."""
        piston, bypass = self.setup
        setup: dict[str, Any] = {"piston": piston.value, "bypass": bypass.value}
        if begins := plan.initial.get(self.setup):
            setup["initial"] = dict(begins)
        return {
            "id": name,
            "mode": plan.commanded.mode,
            "setup": setup,
            "duration": f"{self.seconds:.4g} s",
            "signal": self.signal(plan.command[self.setup], plan.commanded.unit),
            "safety": dict(plan.safety[self.setup]),
        }


@dataclass(frozen=True)
class ExperimentSettings:
    """What all trials of a proposal have in common.

    Attributes:
        commanded: what they give. command: setup -> its range, SI. rate: samples a second.
        safety: setup -> channel -> limit as a suite writes it.
        initial: setup -> position -> where its trials begin, SI; not in it: at 0.
    """

    commanded: Commanded
    command: Mapping[SetUp, Limit]
    rate: float
    safety: Mapping[SetUp, Mapping[str, Any]]
    initial: Mapping[SetUp, Mapping[str, float]] = field(default_factory=dict)

    def trials(self, candidates: list[Experiment], names: list[str]) -> tuple[Trial, ...]:
        """Return candidates as a suite's loader reads them."""
        return load_suite(self.suite(candidates, names)).trials

    def suite(self, candidates: list[Experiment], names: list[str]) -> dict[str, Any]:
        """Return a suite of candidates."""
        trials = [item.trial(name, self) for item, name in zip(candidates, names, strict=True)]
        return {
            "name": "next",
            "description": "The experiment that separates what a diagnosis has left open.",
            "defaults": {"sample_rate": f"{self.rate:g} Hz"},
            "trials": trials,
        }


def candidates(plan: ExperimentSettings, seconds: float) -> Iterator[Experiment]:
    """Yield experiments of every kind in every setup, from slow to fast.

    A part whose position is imposed is asked for nothing that jumps.

    Args:
        plan: permitted. seconds: length of each.
    """
    highest = plan.rate / 10.0
    jumps = not plan.commanded.is_imposed_position
    for setup in plan.command:
        for pattern in _PATTERNS if jumps else ():
            for hold in (0.1, 0.3, 0.8):
                if 1.0 / hold < highest and 2.0 * hold < seconds:
                    yield Experiment("steps", setup, 1.0 / hold, seconds=seconds, pattern=pattern)
        yield Experiment("ramp", setup, 1.0 / (0.8 * seconds), seconds=seconds)
        for frequency in (0.5, 1.5, 5.0, 15.0, 40.0):
            if frequency < highest and frequency * seconds > 1.0:
                yield Experiment("sine", setup, frequency, seconds=seconds)
        for frequency in (5.0, 50.0):
            if frequency < highest:
                yield Experiment("chirp", setup, frequency, seconds=seconds)
                yield Experiment("multisine", setup, frequency, seconds=seconds)
        for frequency in (2.0, 10.0, 50.0):
            if jumps and frequency < highest:
                yield Experiment("prbs", setup, frequency, seconds=seconds)


def neighbour_of(
    item: Experiment, rng: np.random.Generator, plan: ExperimentSettings
) -> Experiment:
    """Return a neighbour: another time scale, another offset."""
    scale = float(np.clip(item.scale * np.exp(0.5 * rng.standard_normal()), _SLOWEST,
                          plan.rate / 10.0))  # fmt: skip
    offset = float(np.clip(item.offset + 0.3 * rng.standard_normal(), -0.8, 0.8))
    if rng.random() < 0.5:
        offset = item.offset
    return replace(item, scale=scale, offset=offset, size=1.0)

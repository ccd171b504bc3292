"""Cases of `benchmarks.next_experiment`: what was hidden, what was named before and after."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eha_bench.core.arrays import FloatArray
from eha_bench.core.trial import Trial


@dataclass(frozen=True)
class Truth:
    """What is hidden: its name, and what it follows."""

    name: str
    variables: tuple[str, ...]


@dataclass(frozen=True)
class Ended:
    """How a diagnosis ended: its causes, one after the other where it cannot distinguish them."""

    verdict: str
    causes: tuple[str, ...]

    def right(self, truth: Truth) -> bool:
        """Whether one cause is left: the hidden one, or a curve of what that follows."""
        if len(self.causes) != 1:
            return False
        curves = {f"learned of {name}" for name in truth.variables}
        return self.causes[0] == truth.name or self.causes[0] in curves

    def wrong(self, truth: Truth) -> bool:
        """Whether one cause is named, and the hidden one is not in it."""
        named = self.verdict == "effect" and len(self.causes) == 1
        return named and truth.name not in self.causes[0].split("+")

    @staticmethod
    def read(content: Mapping[str, Any]) -> Ended:
        """Read one that was kept."""
        return Ended(content["verdict"], tuple(content["causes"]))


@dataclass(frozen=True)
class Case:
    """One machine, before and after its experiment; probabilities are NaN where none was made.

    Attributes:
        others: way of planning -> what an experiment planned that way led to.
        others_stated: way of planning -> what is stated of that experiment.
    """

    plant: str
    truth: Truth
    number: int
    before: Ended
    ending: str
    stated: float
    stated_wrong: float
    bench_seconds: float
    first_seconds: float
    planned_in: float
    ended: Ended
    breached: str
    others: dict[str, Ended]
    others_stated: dict[str, float] = field(default_factory=dict)

    @property
    def ambiguous(self) -> bool:
        """Whether the first recording left more than one candidate."""
        return len(self.before.causes) > 1

    @property
    def covered(self) -> bool:
        """Whether the hidden cause is one of the rivals: what is stated supposes it."""
        return any(Ended("effect", (cause,)).right(self.truth) for cause in self.before.causes)

    @property
    def right(self) -> bool:
        """Whether one cause is left, and it is the hidden one."""
        return self.ended.right(self.truth)

    @property
    def wrong(self) -> bool:
        """Whether one cause is named, and it is another one."""
        return self.ended.wrong(self.truth)

    @property
    def outcomes(self) -> list[tuple[float, bool]]:
        """What was stated of each experiment that was run, and whether it led to the right name.

        Stated is what happens if one of the rivals is right, so there are none of other machines.
        """
        if self.ending != "proposed" or not self.covered:
            return []
        others = [(self.others_stated[way], ended.right(self.truth))
                  for way, ended in self.others.items() if way in self.others_stated]  # fmt: skip
        return [(self.stated, self.right), *others]

    @staticmethod
    def read(path: Path) -> Case:
        """Read a case that was kept."""
        content = json.loads(path.read_text())
        truth = Truth(content["truth"]["name"], tuple(content["truth"]["variables"]))
        own = {"truth": truth, "before": Ended.read(content["before"]),
               "ended": Ended.read(content["ended"])}  # fmt: skip
        others = {name: Ended.read(item) for name, item in content["others"].items()}
        return Case(**{**content, **own, "others": others})


def broken(trial: Trial, read: dict[str, FloatArray], limits: Trial) -> str:
    """Return the first safety limit that a recording breaks; "" for none.

    Args:
        trial: that was run. read: channel -> what its sensor read. limits: a trial that has them.
    """
    for limit in limits.safety:
        if limit.channel in read:
            values = read[limit.channel]
            ends = float(values.min()), float(values.max())
            if not all(limit.bounds.holds(end) for end in ends):
                return f"{limit.channel} in {trial.id}: {ends[0]:.6g} to {ends[1]:.6g}"
    return ""

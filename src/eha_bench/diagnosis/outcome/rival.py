"""A rival: one explanation of the data, with its model and the covariance of what was fitted."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from eha_bench.core.finite import finite_or_none
from eha_bench.diagnosis.fit.uncertainty import Covariance
from eha_bench.plants.model import Model


class Standing(StrEnum):
    """What the data say of a rival.

    `equivalent`: they cannot tell it from what was found. `runner_up`: they can, and it was next.
    """

    FOUND = "found"
    EQUIVALENT = "equivalent"
    RUNNER_UP = "runner_up"


@dataclass(frozen=True)
class Rival:
    """One explanation of the data.

    Attributes:
        cause: its effects, joined by `+`; `none` for none; a learned curve with what it follows.
        effects: ids of what the model has beyond the declared one.
        form: what differs from the first rival of this cause, in words; "" for the first.
        standing: found, equivalent or runner-up.
        behind: by how much its cost lies above that of what was found, in squares of a standard
            deviation of the noise.
        model: all of it, as fitted.
        covariance: of what was fitted, finite (`fit.uncertainty.posterior`).
    """

    cause: str
    effects: tuple[str, ...]
    standing: Standing
    behind: float
    model: Model
    covariance: Covariance
    form: str = ""

    @property
    def id(self) -> str:
        """Its cause, and the form where that is not the first one."""
        return f"{self.cause} ({self.form})" if self.form else self.cause

    @property
    def file(self) -> str:
        """Where its model.yaml stands, relative to diagnosis.json."""
        return f"rivals/{re.sub(r'[^A-Za-z0-9_+.-]+', '_', self.id).strip('_')}.yaml"

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "id": self.id,
            "cause": self.cause,
            "effects": list(self.effects),
            "standing": self.standing.value,
            "behind": finite_or_none(self.behind),
            "model": self.file,
            "covariance": self.covariance.to_dict(),
        }


@dataclass(frozen=True)
class Covered:
    """Where the training recordings have been: what a next experiment adds to.

    Attributes:
        rate: samples a second, the lowest of the recordings'. seconds: of all of them.
        inputs: channel -> (low, high, mean), SI.
        noise: channel -> standard deviation, SI. unexplained: channel -> root mean square of what
            is left over the windows of the fit beyond the noise, SI.
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

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "rate": self.rate,
            "seconds": self.seconds,
            "inputs": {name: list(ends) for name, ends in self.inputs.items()},
            "noise": {name: finite_or_none(value) for name, value in self.noise.items()},
            "unexplained": {name: finite_or_none(v) for name, v in self.unexplained.items()},
            "setups": [item.to_dict() for item in self.setups],
            "dataset": self.dataset,
        }


@dataclass(frozen=True)
class CoveredSetup:
    """One setup of the rig, and channel -> (lowest, highest) that was recorded in it, SI."""

    piston: str
    bypass: str
    extremes: Mapping[str, tuple[float, float]]

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        extremes = {name: list(ends) for name, ends in self.extremes.items()}
        return {"piston": self.piston, "bypass": self.bypass, "extremes": extremes}

"""A rival: one explanation of the data, with its model and the covariance of what was fitted."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from eha_bench.core.finite import finite_or_none
from eha_bench.diagnosis.fit.uncertainty import Covariance
from eha_bench.plants.model import Model

NO_EFFECT = "none"
"""Cause of a rival without any effect."""
RIVALS_FOLDER = "rivals"
"""Where the models of rivals are, beside diagnosis.json."""


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
        cause: its effects, joined by `+`, or `NO_EFFECT`; a learned curve with what it follows.
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
        return f"{RIVALS_FOLDER}/{re.sub(r'[^A-Za-z0-9_+.-]+', '_', self.id).strip('_')}.yaml"

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

"""What a search makes as large as it can: one number of a candidate's margins over the draws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from eha_bench.core.arrays import FloatArray

_LOST = -1.0
"""What a limit counts that is not scored, as of a step that never settles."""
_TAIL = 0.1
"""Share of the draws that the conditional value at risk is a mean of."""
_PLENTY = 1e6
"""A margin that no limit has."""
_NEAR = 0.25
"""Margin at which more of it is worth half as much."""


def least(margins: FloatArray) -> FloatArray:
    """Return the least margin of each draw, (draws,), of (draws, limits).

    What is not scored is worse than what is scored and fails, and the worse the more of it.
    """
    missing = ~np.isfinite(margins)
    known = np.where(missing, 0.0, np.maximum(margins, 10.0 * _LOST))
    return np.asarray(
        np.where(missing.any(axis=1), _LOST * (10.0 + missing.sum(axis=1)), known.min(axis=1))
        + np.where(missing.any(axis=1), 0.01 * np.minimum(known, 0.0).mean(axis=1), 0.0)
    )


class Aim(ABC):
    """What is made as large as possible."""

    @abstractmethod
    def of(self, margins: FloatArray) -> float:
        """Return the worth of a candidate by its margins, (draws, limits)."""

    def most(self, margins: FloatArray, draws: int) -> float:
        """Return what the worth can still become where only some of the draws are known."""
        rest = np.full((draws - len(margins), margins.shape[1]), _PLENTY)
        return self.of(np.concatenate([margins, rest]))


class PassProbability(Aim):
    """P(pass), and among equals the mean of the worst quarter of the least margins."""

    def of(self, margins: FloatArray) -> float:
        """Return the share of draws that pass, with less than one draw's worth for the margin."""
        found = np.sort(least(margins))
        tail = float(found[: max(1, found.size // 4)].mean())
        return float(np.mean(found >= 0.0)) + 0.49 / found.size * float(np.tanh(tail / _NEAR))


class Worst(Aim):
    """The least margin of the worst draw."""

    def of(self, margins: FloatArray) -> float:
        """Return it."""
        return float(least(margins).min())


class Tail(Aim):
    """Conditional value at risk: the mean least margin of the worst tenth of the draws."""

    def of(self, margins: FloatArray) -> float:
        """Return it."""
        found = np.sort(least(margins))
        return float(found[: max(1, round(_TAIL * found.size))].mean())


@dataclass(frozen=True)
class LeastMarginOf(Aim):
    """The least margin of some of the limits, whatever becomes of the others."""

    places: tuple[int, ...]

    def of(self, margins: FloatArray) -> float:
        """Return it."""
        return float(least(margins[:, list(self.places)]).min())


class Robust(StrEnum):
    """Other aims than P(pass), by the word of `--robust`."""

    WORST = "worst"
    CVAR = "cvar"

    @property
    def aim(self) -> Aim:
        """What is aimed at."""
        return Worst() if self is Robust.WORST else Tail()

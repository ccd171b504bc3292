"""Probabilities from a count of draws, with their intervals.

The interval is Jeffreys': the 2.5 and 97.5 % points of Beta(k + 1/2, n - k + 1/2), 0 and 1 where
no draw passes or all do (Brown, Cai, DasGupta, Stat. Sci. 16 (2001) 101,
doi:10.1214/ss/1009213286).
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Chance:
    """The probability of an event that happened in `kept` of `draws` draws."""

    kept: int
    draws: int

    @property
    def value(self) -> float:
        """The share of the draws."""
        return self.kept / self.draws

    @property
    def low(self) -> float:
        """Lower end of the 95 % interval."""
        return 0.0 if self.kept == 0 else self._at(0.025)

    @property
    def high(self) -> float:
        """Upper end of the 95 % interval."""
        return 1.0 if self.kept == self.draws else self._at(0.975)

    def _at(self, share: float) -> float:
        from scipy.special import betaincinv

        return float(betaincinv(self.kept + 0.5, self.draws - self.kept + 0.5, share))

    def to_dict(self) -> dict[str, float | int]:
        """Return it as it stands in JSON."""
        return {
            "value": self.value, "low": self.low, "high": self.high,
            "kept": self.kept, "draws": self.draws,
        }  # fmt: skip

    def __str__(self) -> str:
        """`0.965 (0.93 ... 0.98)`."""
        return f"{self.value:.3f} ({self.low:.3f} ... {self.high:.3f})"

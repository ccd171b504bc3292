"""The result that relative limits refer to: `<= 105 % of baseline`."""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from eha_bench.core.errors import InputError, Place
from eha_bench.core.limit import Bounds

if TYPE_CHECKING:
    from eha_bench.core.result import Result


@dataclass(frozen=True)
class BaselineResult:
    """An earlier result.json (or the folder that holds it); read when a limit first needs it.

    Attributes:
        path: where it lies; None where the suite names none.
        place: of the suite's key, for messages.
    """

    path: Path | None
    place: Place

    @cached_property
    def _result(self) -> Result:
        if self.path is None:
            raise InputError(
                "a limit relative to the baseline, but the suite has none",
                where=self.place,
                hint="give the suite 'baseline: path/to/result.json'",
            )
        from eha_bench.core.result import Result  # most suites have no baseline

        return Result.read(self.path / "result.json" if self.path.is_dir() else self.path)

    def value(self, trial: str, metric: str, channel: str, where: Place) -> float:
        """Return the median over the baseline's repeats, SI.

        Raises:
            InputError: there is no baseline, or it did not score this metric of this trial.
        """
        found = [
            score.value
            for run in self._result.trials
            if run.id == trial
            for score in run.scores
            if (score.metric, score.channel) == (metric, channel) and math.isfinite(score.value)
        ]
        if not found:
            raise InputError(
                f"the baseline {self.path} has no {metric} of trial '{trial}'",
                where=where,
                hint="score it there as well, or give the limit in figures",
            )
        return statistics.median(found)


def scaled_bounds(shares: Bounds, value: float) -> Bounds:
    """Return bounds on a value from bounds on its ratio to the baseline's `value`."""
    ends = sorted((shares.low * value, shares.high * value)) if value != 0.0 else [0.0, 0.0]
    return Bounds(ends[0], ends[1])

"""What a suite may say, and hardly means: limits without a unit that nothing can fail."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Final

from eha_bench.core.limit import AcceptanceLimit
from eha_bench.core.trial import Trial
from eha_bench.suites.suite import Suite

_UNIT: Final = re.compile(r"[^\W\d_]|%")
_WORDS: Final = re.compile(r" with 95 % confidence|, \w+ of the repeats")
_NUMBERS: Final = re.compile(r"\d(?:[eE][-+]?\d+)?")
_SHARES: Final = frozenset({"overshoot", "undershoot", "tracking_nrmse", "distortion"})
"""Metrics that are shares of a step, a reference or a sine."""
_MUCH: Final = 3.0
"""Share from which a limit is rather one in per cent."""


def remarks(suite: Suite) -> list[str]:
    """Return what is allowed in a suite and may not be meant, one sentence each."""
    found = (text for trial in suite.trials for text in _of_trial(trial))
    return list(dict.fromkeys(found))


def _of_trial(trial: Trial) -> Iterator[str]:
    for limit in trial.limits:
        if not math.isfinite(limit.bounds.high) or _has_unit(limit):
            continue
        high = limit.bounds.high
        written = f"trial '{trial.id}': {limit.metric}: '{limit.text}'"
        if limit.unit == "s" and high > trial.duration:
            yield (
                f"{written} is {high:g} s, and the trial lasts {trial.duration:g} s; "
                f"write the unit, as in '{high:g} ms'"
            )
        elif limit.metric in _SHARES and high >= _MUCH:
            yield f"{written} is {100 * high:g} %; write the unit, as in '{high:g} %'"


def _has_unit(limit: AcceptanceLimit) -> bool:
    """Whether a limit's numbers are written with a unit."""
    return bool(_UNIT.search(_NUMBERS.sub("", _WORDS.sub("", limit.text))))

"""P(pass): how likely a suite's limits are kept over what is not known of the machine.

Every draw is a machine that the recordings may have come from, run through all trials that have a
limit, each with its own noise. A draw passes where all limits are kept.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray
from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import InputError, Place
from eha_bench.core.finite import finite_or_none
from eha_bench.core.interruption import Interruption
from eha_bench.core.progress import Progress, silent
from eha_bench.core.result import Status
from eha_bench.core.workers import IN_PROCESS, Workers
from eha_bench.posterior.posterior import Draw, Posterior
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.chance import Chance
from eha_bench.sweeps.conditions import ANY, Conditions
from eha_bench.sweeps.evaluation import Evaluated, LimitName, PointResult, limits_of
from eha_bench.sweeps.extrapolation import Extrapolation, UnrecordedSetup, beyond_recordings
from eha_bench.sweeps.remainder import with_remainder
from eha_bench.sweeps.sweep import time_left

SUMMARY: Final = "probability.json"
SCHEMA_VERSION: Final = 1
_FEWEST: Final = 12
"""Fewest draws for a statement on each unknown."""


@dataclass(frozen=True)
class ResponseBand:
    """What a trial's controlled channel does over the draws.

    Attributes:
        trial, channel, unit: whose it is. time: (n,) s. reference: (n,).
        low, middle, high: (n,) the 2.5, 50 and 97.5 % points of the draws.
    """

    trial: str
    channel: str
    unit: str
    time: FloatArray
    reference: FloatArray
    low: FloatArray
    middle: FloatArray
    high: FloatArray


@dataclass(frozen=True)
class UncertainParameter:
    """What one unknown costs.

    Attributes:
        key: of what was drawn. share: of the least margin's variance that follows it (the square of
            the rank correlation). lower, upper: P(pass) in the lowest and highest third of it.
    """

    key: str
    share: float
    lower: Chance
    upper: Chance


@dataclass(frozen=True)
class Probability:
    """The probability to pass.

    Attributes:
        limits: of the suite. draws: that were run. results: of each. bands: by trial.
        beyond: where they go further than the recordings did that the model was fitted to.
        notes: what the draws leave out.
    """

    limits: tuple[LimitName, ...]
    draws: tuple[Draw, ...]
    results: tuple[PointResult, ...]
    bands: tuple[ResponseBand, ...] = ()
    beyond: tuple[Extrapolation | UnrecordedSetup, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def suite(self) -> Chance:
        """That all limits are kept."""
        return Chance(sum(item.passed for item in self.results), len(self.results))

    @property
    def margins(self) -> FloatArray:
        """Margins of every draw, (draws, limits); NaN where not scored."""
        return np.array([item.margins for item in self.results], dtype=np.float64)

    def of(self, place: int) -> Chance:
        """Return the chance that one limit is kept, by its place."""
        return Chance(int(np.sum(self.margins[:, place] >= 0.0)), len(self.results))

    @property
    def unknowns(self) -> tuple[UncertainParameter, ...]:
        """Unknown parameters, the dearest first; nothing below a dozen draws."""
        if len(self.results) < _FEWEST:
            return ()
        least = np.array([_worst(item) for item in self.results])
        passed = np.array([item.passed for item in self.results])
        keys = dict.fromkeys(key for draw in self.draws for key in draw.values)
        found = []
        for key in keys:
            has = np.array([key in draw.values for draw in self.draws])
            if has.sum() < _FEWEST:
                continue
            values = np.array([draw.values[key] for draw in self.draws if key in draw.values])
            found.append(_unknown(key, values, least[has], passed[has]))
        return tuple(sorted(found, key=lambda item: -item.share))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of probability.json."""
        return {
            "schema_version": SCHEMA_VERSION,
            "suite": self.suite.to_dict(),
            "limits": [
                {
                    "key": limit.key,
                    "trial": limit.trial,
                    "metric": limit.metric,
                    "channel": limit.channel,
                    "limit": limit.text,
                    "p_pass": self.of(place).to_dict(),
                    "margin": [
                        finite_or_none(value) for value in _quantiles(self.margins[:, place])
                    ],
                }
                for place, limit in enumerate(self.limits)
            ],
            "unknowns": [
                {
                    "key": item.key,
                    "share": item.share,
                    "p_pass_low_third": item.lower.to_dict(),
                    "p_pass_high_third": item.upper.to_dict(),
                }
                for item in self.unknowns
            ],
            "beyond": [item.to_dict() for item in self.beyond],
            "notes": list(self.notes),
        }

    def write(self, folder: Path) -> None:
        """Write probability.json into a folder."""
        text = json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)
        write_text(folder / SUMMARY, text + "\n")


def _quantiles(values: FloatArray) -> list[float]:
    scored = values[np.isfinite(values)]
    if not scored.size:
        return [math.nan] * 3
    return [float(value) for value in np.quantile(scored, (0.025, 0.5, 0.975))]


def _worst(item: PointResult) -> float:
    """Return the least margin; what is not scored counts as lost altogether."""
    return item.margin if math.isfinite(item.margin) else -math.inf


def _unknown(
    key: str, values: FloatArray, least: FloatArray, passed: BoolArray
) -> UncertainParameter:
    from scipy.stats import rankdata

    ranks = [rankdata(item) for item in (values, least)]
    moves = all(np.ptp(rank) > 0.0 for rank in ranks)
    share = float(np.corrcoef(ranks[0], ranks[1])[0, 1] ** 2) if moves else 0.0
    order = np.argsort(values, kind="stable")
    third = max(1, values.size // 3)
    ends = (order[:third], order[-third:])
    lower, upper = (Chance(int(passed[end].sum()), int(end.size)) for end in ends)
    return UncertainParameter(key, share, lower, upper)


def judged_only(case: Case) -> Case:
    """Return a case with the trials alone that have a limit.

    Raises:
        InputError: none has.
    """
    trials = tuple(trial for trial in case.suite.trials if trial.limits)
    if not trials:
        raise InputError(
            "the suite has no acceptance limit, so nothing can pass",
            where=Place(file=str(case.suite.path)),
            hint="give a trial an 'accept' block",
        )
    return replace(case, suite=replace(case.suite, trials=trials))


@dataclass(frozen=True)
class _AtDraw:
    """Runs a case on the machine of a draw; picklable."""

    case: Case
    bands: bool

    def __call__(self, draw: Draw) -> Evaluated:
        case = replace(self.case, simulator=self.case.simulator.varied(model=draw.model))
        return Evaluated.of(case, draw.number, curves=self.bands)


def probability(
    case: Case,
    posterior: Posterior,
    draws: int,
    *,
    seed: int = 0,
    conditions: Conditions = ANY,
    bands: bool = True,
    workers: Workers = IN_PROCESS,
    progress: Progress = silent,
) -> Probability:
    """Return how likely a case's limits are kept.

    Ctrl-C keeps the draws that were done.

    Args:
        case: suite, model and controllers. posterior: of that model. draws: how many.
        seed: of the draws. conditions: that they are run in.
        bands: whether what the channels do is kept, too.
        workers: where draws are run. progress: called after every draw.

    Raises:
        InputError: the suite has no limit.
    """
    case = judged_only(case)
    case = replace(case, simulator=with_remainder(case.simulator, posterior.remainder))
    chosen = conditions.met_by(posterior.draws(draws, seed), seed)
    found: dict[int, Evaluated] = {}
    began, passed = time.monotonic(), 0
    try:
        with (
            Interruption() as interrupted,
            closing(workers.outcomes(_AtDraw(case, bands), chosen)) as outcomes,
        ):
            for number, outcome in enumerate(outcomes, 1):
                item = outcome.get()
                found[outcome.index] = item
                passed += item.result.passed
                left = (time.monotonic() - began) / number * (len(chosen) - number)
                progress_text = f"{passed} of {number} draws pass; {time_left(left)} left"
                progress(number, len(chosen), progress_text)
                if interrupted():
                    break
    except KeyboardInterrupt:
        pass  # asked for twice: what is done stands
    done = sorted(found)
    notes = list(posterior.notes)
    if len(done) < len(chosen):
        notes.append(f"interrupted after {len(done)} of {len(chosen)} draws")
    faults = sum(found[place].result.status is Status.FAULT for place in done)
    if faults:
        notes.append(f"{faults} draws were stopped by a fault or a safety limit, and count as lost")
    if not done:
        raise KeyboardInterrupt
    ended = [found[place] for place in done]
    beyond = beyond_recordings(case.suite.trials, ended, posterior)
    return Probability(
        limits_of(case.suite),
        tuple(chosen[place] for place in done),
        tuple(item.result for item in ended),
        _bands(case, ended) if bands else (),
        beyond,
        (*notes, *(item.note for item in beyond)),
    )


def _bands(case: Case, found: Sequence[Evaluated]) -> tuple[ResponseBand, ...]:
    bands = []
    for trial in case.suite.trials:
        curves = [item.curves[trial.id] for item in found if trial.id in item.curves]
        if not curves:
            continue
        size = min(curve.values.size for curve in curves)
        values = np.stack([curve.values[:size] for curve in curves])
        low, middle, high = np.quantile(values, (0.025, 0.5, 0.975), axis=0)
        first = curves[0]
        bands.append(
            ResponseBand(
                trial.id, trial.channel, first.unit, first.time[:size], first.reference[:size],
                low, middle, high,
            )
        )  # fmt: skip
    return tuple(bands)

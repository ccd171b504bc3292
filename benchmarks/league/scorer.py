"""The one scorer: an answer held against what was hidden, and an entrant's rates over all cases."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from benchmarks.blind import rate
from benchmarks.league.answer import UNKNOWN, Answer
from benchmarks.league.question import OPENING, FloatArray, Question
from fixtures.rig.sensors import COLUMNS, FLOOR

NOISE = dict(zip(COLUMNS, FLOOR.tolist(), strict=True))
"""What no model can explain of each channel: noise and quantisation of the rig's sensors, SI."""
FEW = 3
"""How many of the likeliest causes are looked at for `among the first three`."""


@dataclass(frozen=True)
class Mark:
    """How one answer did.

    Attributes:
        case, kind: of the case: single, two, none or foreign.
        truth, claimed: ids of what was hidden and of what was claimed.
        among_few: something that was hidden is among the likeliest three.
        equation_right: what was claimed first acts in a balance in which something was hidden.
        error: of the prediction, in noise floors: geometric mean over runs and channels of the root
            mean square after the opening; infinite where a run could not be simulated.
        seconds: what the entrant took. failure: last line of what went wrong, or "".
    """

    case: str
    kind: str
    truth: tuple[str, ...]
    claimed: tuple[str, ...]
    among_few: bool = False
    equation_right: bool = False
    error: float = math.inf
    seconds: float = math.nan
    failure: str = ""

    @property
    def first_right(self) -> bool:
        """What is claimed first was hidden."""
        return bool(self.claimed) and self.claimed[0] in self.truth

    @property
    def accuses(self) -> bool:
        """An effect is claimed that was not hidden; `unknown` accuses none."""
        return bool(set(self.claimed) - {*self.truth, UNKNOWN})

    @property
    def right(self) -> bool:
        """Nothing can be held against the answer, whatever the case."""
        if self.failure:
            return False
        if self.kind == "none":
            return not self.claimed
        if self.kind == "foreign":
            return set(self.claimed) == {UNKNOWN} and self.equation_right
        return set(self.claimed) == set(self.truth)


def failed(truth: Mapping[str, Any], seconds: float, failure: str) -> Mark:
    """Return the mark of an entrant that gave no answer."""
    ids = tuple(item["id"] for item in truth["undeclared"])
    return Mark(str(truth["case"]), str(truth["kind"]), ids, (), seconds=seconds, failure=failure)


def marked(
    question: Question,
    answer: Answer,
    truth: Mapping[str, Any],
    measured: Mapping[str, Mapping[str, FloatArray]],
    seconds: float,
) -> Mark:
    """Hold an answer against the truth of its case.

    Args:
        question: what was asked. answer: what was handed back, checked.
        truth: of the case, as `fixtures.rig` writes it.
        measured: run -> channel -> (n,) SI, of the held-out runs.
        seconds: what the entrant took.
    """
    hidden = truth["undeclared"]
    ids = tuple(item["id"] for item in hidden)
    balances = {name for item in hidden for name in (item["equation"], *item["also"])}
    likeliest = [cause.id for cause in (*answer.claimed, *answer.others)][:FEW]
    return Mark(
        str(truth["case"]),
        str(truth["kind"]),
        ids,
        tuple(cause.id for cause in answer.claimed),
        bool(set(likeliest) & set(ids)),
        bool(answer.claimed) and answer.claimed[0].equation in balances,
        prediction_error(question, answer, measured),
        seconds,
    )


def prediction_error(
    question: Question, answer: Answer, measured: Mapping[str, Mapping[str, FloatArray]]
) -> float:
    """Return the error of a prediction in noise floors, as `Mark.error` says."""
    logarithms = []
    for run in question.held_out:
        after = run.time > OPENING
        for channel in question.channels:
            error = answer.prediction[run.name][channel] - measured[run.name][channel]
            with np.errstate(over="ignore", invalid="ignore"):
                size = float(np.sqrt(np.mean(np.square(error[after])))) / NOISE[channel]
            if not math.isfinite(size):
                return math.inf
            logarithms.append(math.log(max(size, 1e-12)))
    return math.exp(float(np.mean(logarithms)))


def summary(marks: Sequence[Mark]) -> dict[str, Any]:
    """Return an entrant's rates, errors, times and confusions, ready for JSON."""
    kinds = {
        kind: [mark for mark in marks if mark.kind == kind]
        for kind in ("single", "two", "none", "foreign")
    }
    hidden = [mark for mark in marks if mark.kind in ("single", "two")]
    confusions = Counter(
        (" + ".join(mark.truth) or "nothing", _verdict(mark)) for mark in marks if not mark.right
    )
    errors = sorted(mark.error for mark in marks)
    seconds = sorted(mark.seconds for mark in marks)
    return {
        "cases": len(marks),
        "rates": {
            "right cause first": rate([mark.first_right for mark in hidden]),
            "among the first three": rate([mark.among_few for mark in hidden]),
            "right, and nothing else": rate([mark.right for mark in kinds["single"]]),
            "right balance": rate([mark.equation_right for mark in hidden]),
            "two: both, and nothing else": rate([mark.right for mark in kinds["two"]]),
            "nothing missing: says so": rate([mark.right for mark in kinds["none"]]),
            "outside the list: unknown, right balance": rate(
                [mark.right for mark in kinds["foreign"]]
            ),
            "accuses what is not there": rate([mark.accuses for mark in marks]),
            "prediction within twice the noise": rate([mark.error <= 2.0 for mark in marks]),
            "gave no answer": rate([bool(mark.failure) for mark in marks]),
        },
        "error": {"median": _median(errors), "worst": errors[-1] if errors else math.nan},
        "seconds": {"median": _median(seconds), "worst": seconds[-1] if seconds else math.nan},
        "confusions": [
            {"truth": truth, "said": said, "count": count}
            for (truth, said), count in confusions.most_common()
        ],
        "failures": {mark.case: mark.failure for mark in marks if mark.failure},
    }


def _verdict(mark: Mark) -> str:
    if mark.failure:
        return "no answer"
    found = " + ".join(mark.claimed) or "nothing"
    if mark.kind == "foreign" and mark.claimed == (UNKNOWN,):
        return f"{found}, in another balance"
    return found


def _median(values: Sequence[float]) -> float:
    return statistics.median(values) if values else math.nan

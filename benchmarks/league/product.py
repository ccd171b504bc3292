"""Entrant `eha-bench`: `eha-bench diagnose` on the training runs, and what it revised."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from benchmarks.league.answer import UNKNOWN, Answer, Cause
from benchmarks.league.question import Question
from benchmarks.league.simulation import predicted

import eha_bench
from eha_bench.plants.model import load_model


def enter(question: Question) -> Answer:
    """Diagnose; claim the named effects, or `unknown`; rank the other candidates behind."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        eha_bench.diagnose(question.dataset, out=out)
        found = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
        model = load_model(out / "revised.yaml")
    claimed = tuple(Cause(item["id"], item["equation"]) for item in found.get("effects") or ())
    if found["verdict"] == "unknown":
        claimed = (*claimed, Cause(UNKNOWN, (found.get("unknown") or {}).get("equation") or ""))
    named = {cause.id for cause in claimed}
    others = dict.fromkeys(
        name for name in _rivals(found) if name in question.effects and name not in named
    )
    return Answer(claimed, tuple(map(Cause, others)), predicted(question, model))


def _rivals(found: Mapping[str, Any]) -> Iterator[str]:
    """Yield what the data cannot tell from what was named, then all candidates, the best first."""
    for group in found.get("equivalent") or ():
        yield from group
    yield from (line["id"] for line in found.get("ranking") or ())

"""`python -m benchmarks.league`: every entrant on the same cases, by the same scorer.

Records cases with the independent rig from a seed, hands each entrant the training runs, and holds
what comes back against what was hidden. Answers are kept, so an interrupted league goes on where it
stopped; `--page` writes the tables into docs/league.md. How to enter: docs/league.md.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.league.answer import read_answer
from benchmarks.league.entrants import ENTRANTS, entrant
from benchmarks.league.page import tables, write_page
from benchmarks.league.question import ask
from benchmarks.league.scorer import Mark, failed, marked, summary
from benchmarks.table import Row, write_rows
from fixtures.rig.case import Conditions, record_case
from fixtures.rig.listed import LISTED
from fixtures.rig.plans import make_plans
from ruamel.yaml import YAML

from eha_bench.core.workers import workers_from

EFFECTS = tuple(sorted({effect.id for effect in LISTED}))
"""Causes that may be named: all that the rig hides and expects to be told."""
TOOK = "took.json"


def arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.league", description=__doc__)
    parser.add_argument("--cases", type=int, default=8, help="with one hidden effect")
    parser.add_argument("--two", type=int, default=0, help="with two")
    parser.add_argument("--none", type=int, default=2, help="with nothing hidden")
    parser.add_argument("--foreign", type=int, default=2, help="with one outside the list")
    parser.add_argument("--effects", nargs="+", default=[], metavar="ID", help="only these")
    parser.add_argument("--strength", nargs="+", default=[], metavar="LEVEL", help="only these")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--duration", type=float, default=4.0, metavar="S", help="of each run")
    parser.add_argument("--budget", type=float, default=1.0, help="how hard entrants may try")
    parser.add_argument("--entrant", nargs="+", default=list(ENTRANTS), metavar="NAME",
                        help=f"{', '.join(ENTRANTS)}, or module:function")  # fmt: skip
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results/league"))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="two cases, a small budget: a minute")
    parser.add_argument("--json", type=Path, help="write the figures here")
    parser.add_argument("--page", type=Path, help="put the tables into this page")
    return parser


def play(case: Path, name: str, out: Path, budget: float) -> None:
    """Let an entrant answer one case; the answer, or what went wrong, is kept in `out`."""
    if (out / TOOK).exists():
        return
    out.mkdir(parents=True, exist_ok=True)
    question, _ = ask(case, out / "question", EFFECTS, budget)
    began, failure = time.perf_counter(), ""
    try:
        entrant(name)(question).checked(question).write(out)
    except Exception:  # a crash is a result here, and is counted
        failure = traceback.format_exc().strip().splitlines()[-1]
    took = {"seconds": time.perf_counter() - began, "failure": failure}
    part = out / "took.part"
    part.write_text(json.dumps(took), encoding="utf-8")
    part.rename(out / TOOK)


def score(case: Path, truth: Mapping[str, Any], out: Path, budget: float) -> Mark:
    """Hold a kept answer against the truth of its case."""
    took = json.loads((out / TOOK).read_text(encoding="utf-8"))
    if took["failure"]:
        return failed(truth, took["seconds"], took["failure"])
    question, measured = ask(case, out / "question", EFFECTS, budget)
    answer = read_answer(out).checked(question)
    return marked(question, answer, truth, measured, took["seconds"])


def _play(task: tuple[Path, str, Path, float]) -> None:
    play(*task)


def run(given: argparse.Namespace) -> dict[str, Any]:
    """Record, ask, score; return the figures of all entrants, ready for JSON."""
    for name in given.entrant:
        entrant(name)  # a name that is none is said before anything is recorded
    conditions = Conditions(duration=given.duration)
    plans = make_plans(
        given.seed, given.cases, given.two, given.none, given.foreign, given.effects, given.strength
    )
    data, answers = given.out / "data", given.out / "answers"
    workers = workers_from(str(given.jobs))
    missing = [p for p in plans if not (data / "truth" / f"{p.name}.yaml").exists()]
    workers.map(partial(record_case, out=data, conditions=conditions), missing)
    cases = [data / "cases" / plan.name for plan in plans]
    tasks = [
        (case, name, answers / _folder(name) / case.name, given.budget)
        for name in given.entrant
        for case in cases
    ]
    for count, outcome in enumerate(workers.outcomes(_play, tasks), start=1):
        if outcome.error is not None:
            raise outcome.error
        print(f"\r{count}/{len(tasks)} answers ", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    yaml = YAML(typ="safe")
    found = {}
    for name in given.entrant:
        marks = [
            score(
                case, yaml.load(data / "truth" / f"{case.name}.yaml"),
                answers / _folder(name) / case.name, given.budget,
            )
            for case in cases
        ]  # fmt: skip
        found[name] = summary(marks) | {"marks": [vars(mark) for mark in marks]}
    return {"cases": len(cases), "seed": given.seed, "entrants": found}


def _folder(name: str) -> str:
    return name.replace(":", ".").replace("/", "_")


def rows(results: Mapping[str, Any]) -> Sequence[Row]:
    """Return the figures for the table of all benchmarks."""
    found = []
    for name, item in results["entrants"].items():
        for row in ("right cause first", "accuses what is not there"):
            rate = item["rates"][row]
            if rate["n"]:
                note = f"{rate['n']} cases"
                found.append(Row(f"{name}: {row}", 100 * rate["rate"], "%", note=note))
        median = item["error"]["median"]
        found.append(Row(f"{name}: error of predictions, noise floors", median))
    return found


def main() -> int:
    given = arguments().parse_args()
    if given.quick:
        given.cases, given.two, given.none, given.foreign = 1, 0, 1, 0
        given.strength, given.budget = ["strong"], 0.02
        given.out = given.out / "quick"
    try:
        results = run(given)
    except ValueError as error:
        sys.exit(str(error))
    print(tables(results))
    for name, item in results["entrants"].items():
        for case, failure in item["failures"].items():
            print(f"{name}, {case}: {failure}")
    if given.json:
        write_rows(given.json, rows(results))
        full = given.out / "league.json"
        full.write_text(json.dumps(_finite(results), indent=1), encoding="utf-8")
    if given.page:
        write_page(results, given.page)
    return 0


def _finite(content: Any) -> Any:
    """Return the same with null for numbers that JSON does not have."""
    if isinstance(content, Mapping):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


if __name__ == "__main__":
    sys.exit(main())

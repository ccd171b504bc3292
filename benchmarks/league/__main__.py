"""`python -m benchmarks.league`: every entrant on the same cases, by the same scorer.

Records cases with the independent rig from a seed, hands each entrant the training runs, and holds
what comes back against what was hidden. Answers are kept by set of cases, so an interrupted league
goes on where it stopped; `--page` writes the tables into docs/league.md. How to enter:
docs/league.md.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import secrets
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.league.answer import Answer, read_answer
from benchmarks.league.entrants import ENTRANTS, entrant, fingerprint
from benchmarks.league.page import each, tables, write_page
from benchmarks.league.question import Question, ask
from benchmarks.league.scorer import Mark, failed, marked, summary
from benchmarks.table import Row, write_rows
from fixtures.rig.case import Conditions, Plan, record_case
from fixtures.rig.hidden import LEVELS
from fixtures.rig.listed import LISTED
from fixtures.rig.plans import make_plans
from ruamel.yaml import YAML

from eha_bench.core.error_text import error_text
from eha_bench.core.workers import workers_from

EFFECTS = tuple(sorted({effect.id for effect in LISTED}))
"""Causes that may be named: all that the rig hides and expects to be told."""
TOOK = "took.json"


def arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.league", description=__doc__)
    add = parser.add_argument
    add("--cases", type=int, default=8, help="cases with one hidden effect (%(default)s)")
    add("--two", type=int, default=0, help="cases with two (%(default)s)")
    add("--none", type=int, default=2, help="cases with nothing hidden (%(default)s)")
    add("--foreign", type=int, default=2, help="cases with one outside the list (%(default)s)")
    add("--effects", nargs="+", default=[], metavar="ID", help="hide only these")
    add("--strength", nargs="+", default=[], metavar="LEVEL",
        help=f"hide them only so strong: {', '.join(LEVELS)}")  # fmt: skip
    add(
        "--seed",
        type=_seed,
        default=1,
        help="'new' draws one (%(default)s)",
    )
    add("--duration", type=float, default=4.0, metavar="S", help="of each run, s (%(default)s)")
    add("--budget", type=float, default=1.0, help="how hard entrants may try (%(default)s)")
    add("--entrant", nargs="+", default=list(ENTRANTS), metavar="NAME",
        help=f"any of {', '.join(ENTRANTS)}, or module:function (all of these)")  # fmt: skip
    add("--again", action="store_true", help="ask again where an answer is kept")
    add(
        "--out",
        type=Path,
        default=Path("benchmarks/results/league"),
        help="folder of cases and answers",
    )
    add("--jobs", type=int, default=1, help="processes (%(default)s)")
    add("--quick", action="store_true", help="two short cases and a small budget, a minute")
    add("--each", action="store_true", help="show every case; --quick does")
    add("--json", type=Path, help="write the figures here")
    add("--page", type=Path, help="put the tables into this page")
    return parser


def _seed(text: str) -> int:
    return secrets.randbelow(10**6) if text == "new" else int(text)


def set_folder(out: Path, plans: Sequence[Plan[Any]], conditions: Conditions, seed: int) -> Path:
    """Return the folder of a set of cases: no other set has it, so no answer meets a wrong case."""
    cases = [
        (plan.name, plan.kind, [effect.id for effect in plan.hidden], plan.levels, plan.seed)
        for plan in plans
    ]
    digest = hashlib.sha256(repr((cases, conditions.duration)).encode()).hexdigest()
    return out / f"seed-{seed}-{digest[:8]}"


def play(case: Path, name: str, out: Path, budget: float, again: bool = False) -> None:
    """Let an entrant answer one case; the answer, or what went wrong, is kept in `out`.

    An answer that is kept stays, unless it was given with another budget or by another version of
    the entrant's file, or `again` is asked for.
    """
    asked = {"budget": budget, "code": fingerprint(name)}
    if not again and (out / TOOK).exists():
        kept = json.loads((out / TOOK).read_text(encoding="utf-8"))
        if kept.items() >= asked.items():
            return
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    question, _ = ask(case, out / "question", EFFECTS, budget)
    began, failure = time.perf_counter(), ""
    try:
        answer = entrant(name)(question)
    except Exception as error:  # a crash is a result here, and is counted
        failure = error_text(error)
    else:
        failure = _kept(answer, question, out)
    took = {"seconds": time.perf_counter() - began, "failure": failure, **asked}
    part = out / "took.part"
    part.write_text(json.dumps(took), encoding="utf-8")
    part.rename(out / TOOK)


def _kept(answer: Any, question: Question, out: Path) -> str:
    """Write an answer; return why it does not fit its question, or ""."""
    if not isinstance(answer, Answer):
        return f"an entrant returns an Answer, this one a {type(answer).__name__}"
    try:
        answer.checked(question).write(out)
    except ValueError as error:
        return str(error)
    return ""


def score(case: Path, truth: Mapping[str, Any], out: Path, budget: float) -> Mark:
    """Hold a kept answer against the truth of its case."""
    took = json.loads((out / TOOK).read_text(encoding="utf-8"))
    if took["failure"]:
        return failed(truth, took["seconds"], took["failure"])
    question, measured = ask(case, out / "question", EFFECTS, budget)
    answer = read_answer(out).checked(question)
    return marked(question, answer, truth, measured, took["seconds"])


def _play(task: tuple[Path, str, Path, float, bool]) -> None:
    play(*task)


def run(given: argparse.Namespace) -> dict[str, Any]:
    """Record, ask, score; return the figures of all entrants, ready for JSON."""
    for name in given.entrant:
        entrant(name)  # a name that is none is said before anything is recorded
    conditions = Conditions(duration=given.duration)
    plans = make_plans(
        given.seed, given.cases, given.two, given.none, given.foreign, given.effects,
        given.strength, drawn=True,
    )  # fmt: skip
    out = set_folder(given.out, plans, conditions, given.seed)
    print(f"seed {given.seed}: {len(plans)} cases, kept in {out}", file=sys.stderr)
    data, answers = out / "data", out / "answers"
    workers = workers_from(str(given.jobs))
    missing = [p for p in plans if not (data / "truth" / f"{p.name}.yaml").exists()]
    workers.map(partial(record_case, out=data, conditions=conditions), missing)
    cases = [data / "cases" / plan.name for plan in plans]
    tasks = [
        (case, name, answers / _folder(name) / case.name, given.budget, given.again)
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
        given.strength, given.budget, given.duration = ["strong"], 0.02, 1.0
        given.each = True
    try:
        results = run(given)
    except ValueError as error:
        sys.exit(str(error))
    print(tables(results))
    if given.each:
        print(f"\n{each(results)}")
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

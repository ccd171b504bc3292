"""``python -m benchmarks.next_experiment``: how often the next experiment leads to the right name.

A machine with a hidden effect (`benchmarks.experiment_rigs`: equations of its own) makes one short
recording. Where its diagnosis leaves candidates that cannot be distinguished,
`eha_bench.next_experiment` is asked for the experiment that would tell them, within limits; the
machine runs it, and both recordings are diagnosed. Beside it the machine runs experiments of the
same length that were planned in other ways (`--others`): by chance, and D-optimal. Counted: right
single names, wrong ones, what was stated beside what happened, broken limits, bench seconds. With
`--proposals` each ambiguous case is asked again and again within other limits, and what is proposed
is run as well with a second effect in the machine (`benchmarks.safe_proposals`).

A case that was done is kept in its folder, so an interrupted benchmark goes on where it stopped.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.experiment_cases import Case, Ended, Truth, broken
from benchmarks.experiment_rigs import SAFETY, BlindRig, rigs_of
from benchmarks.other_experiments import OtherPlanners
from benchmarks.safe_proposals import Asked, asked_again
from benchmarks.table import Row, report_rows

from eha_bench.experiment.propose import ASKED
from eha_bench.suites import Suite, load_suite

BUDGET = 30.0
"""Bench time of a proposal that is asked for, s."""
GOALS = {"right single name": 0.9, "wrong name": 0.02}
CHANCE, D_OPTIMAL = "by chance", "D-optimal"


def performed(rig: BlindRig, folder: Path, suite: Suite, name: str) -> tuple[Path, str]:
    """Run a suite on the machine; return the dataset with it, and the limit that it broke."""
    rows, breached = [], ""
    limits = load_suite(folder / "safe.yaml").trials[0]
    for trial in suite.trials:
        row, read = rig.perform(trial, folder / f"{name}_{trial.id}")
        rows.append(row)
        breached = breached or broken(trial, read, limits)
    return rig.dataset(folder, f"{name}.yaml", rows), breached


def diagnosed(dataset: Path, folder: Path) -> Ended:
    """Diagnose, and return how that ended; what was diagnosed already is read."""
    import eha_bench

    kept = folder / "ended.json"
    if not kept.exists():
        found = eha_bench.diagnose(dataset, folder)
        left = [item.cause for item in found.rivals if item.standing != "runner_up"]
        ended = Ended(found.verdict.value, tuple(dict.fromkeys(left)))
        kept.write_text(json.dumps(asdict(ended)))
    return Ended.read(json.loads(kept.read_text()))


def run_case(
    plant: str,
    machine: Callable[[int], BlindRig],
    number: int,
    folder: Path,
    others: Sequence[str],
    budget: float,
    probability: float = ASKED,
) -> Case:
    """Record, diagnose, plan, run and diagnose again.

    Args:
        plant: name of the machine's plant. machine: what makes it. number: of the machine.
        folder: where all of it is kept. others: ways of planning beside.
        budget: most bench time, s. probability: of the right name, that is asked for. The first
            recording and its diagnosis are shared by all that is asked of a machine.
    """
    import eha_bench

    mark = "" if probability == ASKED else f"_{round(100 * probability)}"
    kept = folder / f"case{mark}.json"
    if kept.exists():
        return Case.read(kept)
    folder.mkdir(parents=True, exist_ok=True)
    rig = machine(number)
    dataset = rig.record_first(folder)
    (folder / "safe.yaml").write_text(rig.safety(plant))
    before = after = diagnosed(dataset, folder / "before")
    ending, stated, wrong, seconds, took, breached = "", np.nan, np.nan, 0.0, 0.0, ""
    beside: dict[str, Ended] = {}
    beside_stated: dict[str, float] = {}
    if len(before.causes) > 1:
        began = time.perf_counter()
        suite_file = folder / f"next{mark}.yaml"
        planned = eha_bench.next_experiment(
            folder / "before", suite_file, budget=budget, safety=folder / "safe.yaml",
            probability=probability,
        )  # fmt: skip
        took, ending = time.perf_counter() - began, planned.ending.value
        if planned.odds is not None:
            stated, wrong = planned.odds.right, planned.odds.wrong
        if ending == "proposed":
            seconds = planned.bench_seconds
            more, breached = performed(rig, folder, load_suite(suite_file), f"planned{mark}")
            after = diagnosed(more, folder / f"after{mark}")
            planners = OtherPlanners(folder / "before", folder / "safe.yaml", seconds, number)
            ways = {CHANCE: planners.by_chance, D_OPTIMAL: planners.d_optimal}
            for place, way in enumerate(others):
                other = ways[way]()
                if other is None:
                    beside[way] = before
                    continue
                beside_stated[way] = other.odds.right
                more, _ = performed(rig, folder, other.suite, f"other_{place}{mark}")
                beside[way] = diagnosed(more, folder / f"after_{place}{mark}")
    done = Case(
        plant, Truth(rig.truth, rig.variables), number, before, ending, float(stated),
        float(wrong), seconds, rig.first_seconds, took, after, breached, beside, beside_stated,
    )  # fmt: skip
    kept.write_text(json.dumps(asdict(done)))
    return done


def table(cases: Sequence[Case]) -> tuple[dict[str, Any], list[str]]:
    """Return figures and lines to print."""
    ambiguous = [case for case in cases if case.ambiguous]
    ran = [case for case in ambiguous if case.ending == "proposed"]
    count = max(1, len(ran))
    outcomes = [outcome for case in ran for outcome in case.outcomes]
    figures: dict[str, Any] = {
        "cases": len(cases),
        "ambiguous": len(ambiguous),
        "proposed": len(ran),
        "right single name": sum(case.right for case in ran) / count if ran else None,
        "wrong name": sum(case.wrong for case in ran) / count if ran else None,
        "hidden cause among the rivals": sum(case.covered for case in ran),
        "right single name, of these": (
            sum(case.right for case in ran if case.covered)
            / max(1, sum(case.covered for case in ran))
        ),
        "limits broken": sum(bool(case.breached) for case in ran),
        "bench seconds, median": float(np.median([c.bench_seconds for c in ran])) if ran else None,
        "planned in, s, median": float(np.median([c.planned_in for c in ran])) if ran else None,
        "stated and happened": [
            {"from": low / 10, "experiments": len(own),
             "stated": float(np.mean([stated for stated, _ in own])),
             "happened": sum(right for _, right in own) / len(own)}
            for low in range(10)
            if (own := [pair for pair in outcomes if low <= min(9.99, 10 * pair[0]) < low + 1])
        ],
    }  # fmt: skip
    for way in sorted({way for case in ran for way in case.others}):
        own = [case for case in ran if way in case.others]
        figures[way] = {
            "cases": len(own),
            "right single name": sum(c.others[way].right(c.truth) for c in own) / len(own),
            "wrong name": sum(c.others[way].wrong(c.truth) for c in own) / len(own),
            "the proposals of these": sum(c.right for c in own) / len(own),
        }
    lines = []
    for case in cases:
        verdict = "right" if case.right else "WRONG" if case.wrong else "open"
        told = "not asked"
        if case.ending:
            told = f"{case.stated:.0%} stated, {case.bench_seconds:.2g} s"
        lines.append(
            f"{case.plant}, {case.truth.name} ({case.number}): {' / '.join(case.before.causes)} -> "
            f"{case.ending or 'nothing to separate'} ({told}) -> "
            f"{' / '.join(case.ended.causes)} "
            + (verdict if case.ambiguous else "")
            + "".join(
                f"; {way} {'right' if item.right(case.truth) else '-'}"
                for way, item in case.others.items()
            )
            + (f" BROKE {case.breached}" if case.breached else "")
        )
    return figures, lines


def main() -> int:
    """Run the cases; 0 where the goals are met, 1 where one is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.next_experiment",
                                     description=__doc__)  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="one machine, short experiments")
    parser.add_argument("--plants", nargs="+", choices=sorted(SAFETY), default=sorted(SAFETY))
    parser.add_argument("--cases", type=int, default=3, help="machines an effect")
    parser.add_argument("--first", type=int, default=0, help="number of the first machine")
    parser.add_argument("--budget", type=float, default=BUDGET, help="bench time, s")
    parser.add_argument("--probability", type=float, nargs="+", default=[ASKED],
                        help="of the right name, that is asked for; each ambiguous machine is "
                        "asked with all of them")  # fmt: skip
    parser.add_argument("--effects", nargs="+", help="ids; all listed ones by default")
    parser.add_argument("--foreign", action="store_true", help="effects that no diagnosis knows")
    parser.add_argument("--others", nargs="*", choices=[CHANCE, D_OPTIMAL],
                        default=[CHANCE, D_OPTIMAL])  # fmt: skip
    parser.add_argument("--proposals", type=int, default=0, help="more of each ambiguous case")
    parser.add_argument("--out", type=Path, help="folder of cases; one given goes on with it")
    parser.add_argument("--minutes", type=float, default=np.inf, help="begin no case after these")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    plants, cases = given.plants, given.cases
    wanted = given.effects
    if given.quick:
        plants, cases, given.budget = ["geared_servo"], 1, 5.0
        wanted = wanted or ["asymmetric_friction"]
    out = given.out or Path(tempfile.mkdtemp())
    began = time.perf_counter()
    done: list[Case] = []
    again: list[Asked] = []
    for number in range(given.first, given.first + cases):
        for plant in plants:
            for key, machine in rigs_of(plant, foreign=given.foreign).items():
                if wanted and key.partition(".")[0] not in wanted:
                    continue
                if time.perf_counter() - began > 60.0 * given.minutes:
                    continue
                folder = out / f"{plant}-{key}-{number}"
                for asked in given.probability:
                    done.append(
                        run_case(plant, machine, number, folder, given.others, given.budget, asked)
                    )
                    print(table(done[-1:])[1][0], flush=True)
                    if not done[-1].ambiguous:
                        break
                if done[-1].ambiguous:
                    again += asked_again(done[-1], machine, folder, given.proposals)
    figures, _ = table(done)
    print(json.dumps(figures, indent=1))
    rows = rows_from(figures, again)
    return report_rows(given.json, rows)


def rows_from(figures: dict[str, Any], again: Sequence[Asked]) -> list[Row]:
    """Return the figures as rows of the table of all benchmarks."""
    ran = f"of {figures['proposed']} proposals for {figures['ambiguous']} ambiguous of "
    ran += f"{figures['cases']} machines"
    rows = []
    if figures["proposed"]:
        right, wrong = figures["right single name"], figures["wrong name"]
        rows = [
            Row("the one name left is right", 100.0 * right, "%", ">",
                100.0 * GOALS["right single name"], ran),
            Row("the one name left is wrong", 100.0 * wrong, "%", "<",
                100.0 * GOALS["wrong name"], ran),
            Row("bench time of a proposal, median", figures["bench seconds, median"], "s", "<",
                BUDGET),
            Row("time to find it, median", figures["planned in, s, median"], "s", "<", 60.0),
        ]  # fmt: skip
    rows += [
        Row(f"the one name left is right, {way}", 100.0 * figures[way]["right single name"], "%",
            note=f"of {figures[way]['cases']}, where the proposals reach "
            f"{figures[way]['the proposals of these']:.0%}")
        for way in (CHANCE, D_OPTIMAL) if way in figures
    ]  # fmt: skip
    first = figures["proposed"]
    rows.append(Row("limits broken by proposals", figures["limits broken"], "", "<", 0.0,
                    f"of {first}"))  # fmt: skip
    if again:
        more = [item for item in again if item.ending == "proposed"]
        note = f"of {len(more)} within other limits"
        rows += [
            Row("limits broken by further proposals", sum(bool(i.breached) for i in more), "", "<",
                0.0, note),
            Row("the same with a second effect that no rival holds",
                sum(bool(i.with_another) for i in more), "", "<", 0.0, note),
        ]  # fmt: skip
    return rows


if __name__ == "__main__":
    sys.exit(main())

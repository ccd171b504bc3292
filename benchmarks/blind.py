"""``python -m benchmarks.blind``: how often the diagnosis is right about the independent rig.

Records cases with `fixtures.rig` (or takes a folder of them), gives each data set
to `eha_bench.diagnose`, and holds its diagnosis.json against the truth that was
kept apart. Nothing of the truth is read before all verdicts are in. Prints rates
by kind, effect and strength, confusions and run times; `--json` writes them too.

A verdict is kept beside its case's number, so an interrupted benchmark goes on
where it stopped.
"""

import argparse
import json
import math
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from fixtures.rig.__main__ import parser, set_from
from fixtures.rig.hidden import LEVELS
from fixtures.rig.plans import recorded_otherwise
from ruamel.yaml import YAML

from eha_bench.core.workers import workers_from

GOALS = {
    "right effect first": 0.97,
    "right effect first, hardest": 0.85,
    "right equation": 0.98,
    "none: verdict none": 0.98,
    "foreign: unknown in the right equation": 0.90,
    "two: both named": 0.85,
}
"""What is aimed at, by the name of the rate."""
MOST_FALSE = 0.03
"""Share of cases that may accuse something that is not there."""


@dataclass(frozen=True)
class Outcome:
    """One case's truth and verdict, compared."""

    case: str
    kind: str
    truth: tuple[str, ...]
    strength: tuple[str, ...]
    verdict: str
    named: tuple[str, ...]
    equations_right: bool
    places_right: tuple[bool, ...]
    equivalent: bool
    false: tuple[str, ...]
    covered: tuple[bool, ...]
    holdout_ratio: float
    seconds: float
    failure: str

    @property
    def first_right(self) -> bool:
        """The strongest effect named is one that is there."""
        return bool(self.named) and self.named[0] in self.truth

    @property
    def all_right(self) -> bool:
        """All that is there is named, and nothing else."""
        return self.verdict == "effect" and set(self.named) == set(self.truth)


def diagnose_case(dataset: Path, out: Path, threads: int | None = None) -> None:
    """Run the diagnosis on one data set; what it took, or how it failed, is written beside it.

    `threads` that simulate: one where several cases run at once (default: as many as cores).
    """
    done = out / "took.json"
    if done.exists():
        return
    import eha_bench
    from eha_bench.diagnosis.fit import side_by_side

    if threads is not None:
        side_by_side.PROCESSORS = threads

    out.mkdir(parents=True, exist_ok=True)
    began, cpu = time.perf_counter(), time.process_time()
    failure = ""
    try:
        eha_bench.diagnose(dataset, out=out)
    except Exception:  # a crash is a result here, and is counted
        failure = traceback.format_exc()
    _write_took(out, time.perf_counter() - began, time.process_time() - cpu, failure)


def _write_took(out: Path, seconds: float, cpu: float, failure: str) -> None:
    out.mkdir(parents=True, exist_ok=True)
    took = {"seconds": seconds, "cpu_seconds": cpu, "failure": failure}
    part = out / "took.part"
    part.write_text(json.dumps(took))
    part.rename(out / "took.json")


def _diagnose(task: tuple[Path, Path, int | None]) -> None:
    diagnose_case(*task)


def compare(truth: Mapping[str, Any], out: Path) -> Outcome:
    """Hold one diagnosis.json against the truth of its case."""
    took = json.loads((out / "took.json").read_text())
    file = out / "diagnosis.json"
    found: dict[str, Any] = {}
    if not took["failure"] and file.exists():
        found = json.loads(file.read_text())
    hidden = truth["undeclared"]
    ids = tuple(item["id"] for item in hidden)
    effects = found.get("effects") or []
    named = tuple(item["id"] for item in effects)
    unknown = found.get("unknown") or {}
    right = {eq for item in hidden for eq in (item["equation"], *item["also"])}
    said = [item.get("equation") for item in effects[:1]] or [unknown.get("equation")]
    sets = [set(group) for group in found.get("equivalent") or []]
    return Outcome(
        case=str(truth["case"]),
        kind=str(truth["kind"]),
        truth=ids,
        strength=tuple(item["strength"] for item in hidden),
        verdict=str(found.get("verdict", "failed")) if found.get("complete", True) else "stopped",
        named=named,
        equations_right=bool(hidden) and all(eq in right for eq in said),
        places_right=tuple(_places_right(effects, hidden)),
        equivalent=any(group & set(ids) and group & set(named[:1]) for group in sets),
        false=tuple(name for name in named if name not in ids),
        covered=tuple(_covered(found, truth)),
        holdout_ratio=_holdout_ratio(found),
        seconds=float(took["seconds"]),
        failure=str(took["failure"]),
    )


def _places_right(
    effects: Sequence[Mapping[str, Any]], hidden: Sequence[Mapping[str, Any]]
) -> Iterable[bool]:
    """Whether a right effect is said to be where it is; nothing where a side names no place."""
    for item in hidden:
        for effect in effects:
            at, places = effect.get("at"), item.get("at")
            if effect["id"] == item["id"] and at and places:
                said = {at} if isinstance(at, str) else set(at)
                yield bool({place.partition(".")[0] for place in said} & set(places))


def _holdout_ratio(found: Mapping[str, Any]) -> float:
    """The worst channel's held-out error after, in units of its noise floor; NaN without."""
    ratios = [
        row["after"] / row["noise_floor"]
        for row in ((found.get("error") or {}).get("holdout") or {}).values()
        if row.get("after") is not None and row.get("noise_floor")
    ]
    return max(ratios, default=math.nan)


COMPARABLE = {
    "current_lag", "command_delay", "pressure_friction", "air_fraction", "turbulent_leakage",
    "external_leakage", "pressure_lag",
}  # fmt: skip
"""The rig's sizes that mean the same in any form of their effect; its interval should hold them."""


def _covered(found: Mapping[str, Any], truth: Mapping[str, Any]) -> Iterable[bool]:
    """Whether an effect's true size lies in the interval that is given for it."""
    by_id = {item["id"]: item for item in found.get("effects") or []}
    for item in truth["undeclared"]:
        sizes = [value for name, value in item["parameters"].items() if name in COMPARABLE]
        if item["id"] not in by_id or not sizes:
            continue
        intervals = [
            (p["low"], p["high"])
            for p in by_id[item["id"]]["parameters"].values()
            if p.get("low") is not None and p.get("high") is not None
        ]
        if intervals:
            # Names differ between rig and product; a size is unlike any other by its magnitude.
            yield any(low <= sizes[0] <= high for low, high in intervals)


def rate(flags: Sequence[bool]) -> dict[str, float]:
    """A share with its 95 % Wilson interval, doi:10.1080/01621459.1927.10502953."""
    n = len(flags)
    if not n:
        return {"n": 0, "rate": math.nan, "low": math.nan, "high": math.nan}
    p, z = sum(flags) / n, 1.96
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return {"n": n, "rate": p, "low": max(middle - half, 0.0), "high": min(middle + half, 1.0)}


def summarise(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """All rates, tables and confusions, ready for JSON."""
    kinds = {kind: [o for o in outcomes if o.kind == kind] for kind in _kinds(outcomes)}
    single = kinds.get("single", [])
    two, none, foreign = (kinds.get(kind, []) for kind in ("two", "none", "foreign"))
    rates = {
        "right effect first": rate([o.first_right for o in single]),
        "right effect first or equivalent": rate([o.first_right or o.equivalent for o in single]),
        "right effect and nothing else": rate([o.all_right for o in single]),
        "right equation": rate([o.equations_right for o in single]),
        "none: verdict none": rate([o.verdict == "none" for o in none]),
        "foreign: verdict unknown": rate([o.verdict == "unknown" for o in foreign]),
        "foreign: unknown in the right equation": rate(
            [o.verdict == "unknown" and o.equations_right for o in foreign]
        ),
        "two: both named": rate([set(o.truth) <= set(o.named) for o in two]),
        "two: one of them first": rate([o.first_right for o in two]),
        "accuses what is not there": rate([bool(o.false) for o in outcomes]),
        "accuses where nothing is missing": rate([bool(o.named) for o in none]),
        "right effect, at its place": rate([hit for o in outcomes for hit in o.places_right]),
        "crashed": rate([bool(o.failure) for o in outcomes]),
        "interval holds the true size": rate([hit for o in outcomes for hit in o.covered]),
        "held-out after within 1.3 of the floor, where right": rate(
            [o.holdout_ratio <= 1.3 for o in single if o.all_right]
        ),
    }
    for level in LEVELS:
        rates[f"right effect first, {level}"] = rate(
            [o.first_right for o in single if o.strength[0] == level]
        )
    by_effect = {
        name: {
            level: rate(
                [o.first_right for o in single if o.truth[0] == name and o.strength[0] == level]
            )
            for level in LEVELS
        }
        for name in sorted({o.truth[0] for o in single})
    }
    by_foreign = {
        name: rate(
            [o.verdict == "unknown" and o.equations_right for o in foreign if o.truth[0] == name]
        )
        for name in sorted({o.truth[0] for o in foreign})
    }
    confusions = Counter(
        (" + ".join(o.truth) or "nothing", o.verdict, " + ".join(o.named) or "-")
        for o in outcomes
        if not _right(o)
    )
    seconds = sorted(o.seconds for o in outcomes)
    return {
        "cases": len(outcomes),
        "rates": rates,
        "by_effect": by_effect,
        "by_foreign": by_foreign,
        "confusions": [
            {"truth": t, "verdict": v, "named": n, "count": c}
            for (t, v, n), c in confusions.most_common()
        ],
        "seconds": {
            "median": seconds[len(seconds) // 2] if seconds else math.nan,
            "p95": seconds[int(0.95 * (len(seconds) - 1))] if seconds else math.nan,
            "max": seconds[-1] if seconds else math.nan,
        },
        "failures": {o.case: o.failure.strip().splitlines()[-1] for o in outcomes if o.failure},
    }


def _kinds(outcomes: Sequence[Outcome]) -> list[str]:
    return sorted({o.kind for o in outcomes})


def _right(o: Outcome) -> bool:
    """Whether nothing is to be said against a verdict."""
    if o.kind == "none":
        return o.verdict == "none"
    if o.kind == "foreign":
        return o.verdict == "unknown" and o.equations_right
    return o.all_right


def show(summary: Mapping[str, Any]) -> str:
    """The summary as text."""
    lines = [f"{summary['cases']} cases"]
    for name, r in summary["rates"].items():
        if r["n"]:
            goal = f"  (goal {GOALS[name]:.0%})" if name in GOALS else ""
            goal = f"  (at most {MOST_FALSE:.0%})" if name.startswith("accuses") else goal
            interval = f"[{r['low']:.1%}, {r['high']:.1%}]"
            lines.append(f"  {name:<52} {r['rate']:6.1%} of {r['n']:<4} {interval}{goal}")
    if summary["by_effect"]:
        lines.append(f"right effect first {'':<13}" + "".join(f"{lv:>12}" for lv in LEVELS))
        for name, row in summary["by_effect"].items():
            cells = (
                f"{round(c['rate'] * c['n'])}/{c['n']}" if (c := row[lv])["n"] else "-"
                for lv in LEVELS
            )
            lines.append(f"  {name:<30}" + "".join(f"{cell:>12}" for cell in cells))
    if summary["by_foreign"]:
        lines.append("unknown, in the right equation")
        for name, r in summary["by_foreign"].items():
            lines.append(f"  {name:<30}{round(r['rate'] * r['n']):>8}/{r['n']}")
    if summary["confusions"]:
        lines.append("not right: truth -> verdict: named (times)")
        for c in summary["confusions"]:
            lines.append(f"  {c['truth']} -> {c['verdict']}: {c['named']} ({c['count']})")
    for case, reason in summary["failures"].items():
        lines.append(f"  crashed: {case}: {reason}")
    s = summary["seconds"]
    lines.append(
        f"seconds a case: median {s['median']:.1f}, p95 {s['p95']:.1f}, max {s['max']:.1f}"
    )
    return "\n".join(lines)


def arguments() -> argparse.ArgumentParser:
    """The rig's options, and the benchmark's own."""
    own = parser(Path("benchmarks/results/blind"))
    own.prog, own.description = "python -m benchmarks.blind", __doc__
    own.add_argument("--data", type=Path, help="cases recorded earlier: the rig's OUT folder")
    own.add_argument("--workers", default="", help="instead of --jobs: dask://host:port ...")
    own.add_argument("--json", type=Path, help="write the summary and every case's outcome here")
    return own


def main() -> None:
    """Record, diagnose, compare, print."""
    args = arguments().parse_args()
    data: Path = args.data or args.out
    workers = workers_from(args.workers or args.jobs)
    if args.data is None:
        try:
            plans, record = set_from(args)
        except ValueError as error:
            sys.exit(str(error))
        if strange := [p.name for p in plans if recorded_otherwise(p, data)]:
            sys.exit(
                f"{data} holds '{strange[0]}' of another set: give --out for a new one, "
                "or --data to diagnose what is there"
            )
        missing = [p for p in plans if not (data / "truth" / f"{p.name}.yaml").exists()]
        workers.map(partial(record, out=data), missing)
    cases = sorted(path.parent for path in (data / "cases").glob("*/dataset.yaml"))
    if not cases:
        sys.exit(f"no cases in {data}: ask for --cases, --two, --none or --foreign, or give --data")
    verdicts = args.out / "verdicts"
    began = time.perf_counter()
    threads = 1 if args.jobs > 1 else None
    tasks = [(case / "dataset.yaml", verdicts / case.name, threads) for case in cases]
    for count, outcome in enumerate(workers.outcomes(_diagnose, tasks), start=1):
        if outcome.error is not None:  # the case took its worker down
            _write_took(tasks[outcome.index][1], math.nan, math.nan, str(outcome.error))
        pace = (time.perf_counter() - began) / count
        left = pace * (len(cases) - count) / 60.0
        print(f"\r{count}/{len(cases)} cases, {left:.0f} min left ", end="", file=sys.stderr)
    print(file=sys.stderr)
    yaml = YAML(typ="safe")
    outcomes = [
        compare(yaml.load(data / "truth" / f"{c.name}.yaml"), verdicts / c.name) for c in cases
    ]
    summary = summarise(outcomes)
    print(show(summary))
    if args.json:
        args.json.parent.mkdir(parents=True, exist_ok=True)
        document = {**summary, "outcomes": [vars(o) for o in outcomes]}
        args.json.write_text(json.dumps(document, indent=1))


if __name__ == "__main__":
    main()

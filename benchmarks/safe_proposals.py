"""``python -m benchmarks.safe_proposals``: does any proposal break a limit when it is run?

The ambiguous cases that `benchmarks.next_experiment` kept are asked again for an experiment, many
times, each time with limits of their own (from half to a fifth more of the usual ones) and
other draws. The machine runs each of them as it is, and with a second effect in it that no rival
holds. A breach is a reading, with its noise, beyond a limit.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from benchmarks.experiment_rigs import BlindRig, rigs_of
from benchmarks.next_experiment import Case, broken
from benchmarks.table import Row, write_rows

from eha_bench.suites import load_suite

BUDGETS = (2.0, 5.0, 15.0, 30.0)


@dataclass(frozen=True)
class Asked:
    """One proposal and what it did.

    Attributes:
        used: largest share of the way to a limit that was foreseen, NaN where nothing was proposed.
        breached: limit that the machine broke, "" for none. with_another: the same with a second
            effect in the machine.
    """

    case: str
    seed: int
    room: float
    ending: str
    used: float
    breached: str
    with_another: str


def asked(case: Case, rig: BlindRig, other: BlindRig, folder: Path, seed: int) -> Asked:
    """Ask once, and run what is proposed on two machines."""
    import eha_bench

    rng = np.random.default_rng([seed, case.number])
    room = float(rng.uniform(0.5, 1.2))
    place = folder / "safe" / str(seed)
    place.mkdir(parents=True, exist_ok=True)
    (place / "safe.yaml").write_text(rig.safety(case.plant, room))
    planned = eha_bench.next_experiment(
        folder / "before", place / "next.yaml", safety=place / "safe.yaml", seed=seed,
        budget=float(rng.choice(BUDGETS)),
    )  # fmt: skip
    broke = {"own": "", "other": ""}
    if planned.trials:
        limits = load_suite(place / "safe.yaml").trials[0]
        for trial in load_suite(place / "next.yaml").trials:
            for name, machine in (("own", rig), ("other", other)):
                _, read = machine.perform(trial, place / f"{trial.id}_{name}")
                broke[name] = broke[name] or broken(trial, read, limits)
    used = max((room.used for trial in planned.trials for room in trial.rooms), default=np.nan)
    return Asked(
        folder.name, seed, room, planned.ending.value, float(used), broke["own"], broke["other"]
    )


def main() -> int:
    """Ask for proposals and print the table; 1 where a limit was broken."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.safe_proposals",
                                     description=__doc__)  # fmt: skip
    parser.add_argument("cases", type=Path, help="folder of benchmarks.next_experiment")
    parser.add_argument("--proposals", type=int, default=10, help="of each ambiguous case")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    done: list[Asked] = []
    for kept in sorted(given.cases.glob("*/case.json")):
        case = Case.read(kept)
        if not case.ambiguous:
            continue
        folder = kept.parent
        key = folder.name.removeprefix(f"{case.plant}-").rpartition("-")[0]
        known = rigs_of(case.plant, foreign=False) | rigs_of(case.plant, foreign=True)
        rig, other = known[key](case.number), known[key](case.number)
        other.also(case.number)
        for seed in range(1, given.proposals + 1):
            file = folder / "safe" / f"{seed}.json"
            if file.exists():
                done.append(Asked(**json.loads(file.read_text())))
                continue
            done.append(asked(case, rig, other, folder, seed))
            file.write_text(json.dumps(asdict(done[-1])))
            if done[-1].breached or done[-1].with_another:
                print(done[-1], flush=True)
    rows = rows_from(done)
    for row in rows:
        print(row)
    write_rows(given.json, rows)
    return int(any(row.verdict == "missed" for row in rows))


def rows_from(done: Sequence[Asked]) -> list[Row]:
    """Return the figures as rows of the table of all benchmarks."""
    ran = [item for item in done if item.ending == "proposed"]
    note = f"in {len(ran)} proposals of {len(done)} asked for"
    return [
        Row("limits broken by proposals", sum(bool(i.breached) for i in ran), "", "<", 0.0, note),
        Row("the same with a second effect that no rival holds",
            sum(bool(i.with_another) for i in ran), "", "<", 0.0, note),
    ]  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())

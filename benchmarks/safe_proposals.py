"""Does any proposal break a limit when it is run?

An ambiguous case is asked again for an experiment, many times, each time with limits of its own
(from half to a fifth more of the usual ones), another budget and other draws. The machine runs
each of them as it is, and with a second effect in it that no rival holds. A breach is a reading,
with its noise, beyond a limit.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from benchmarks.experiment_cases import Case, broken
from benchmarks.experiment_rigs import BlindRig

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


def asked_again(
    case: Case, machine: Callable[[int], BlindRig], folder: Path, proposals: int
) -> list[Asked]:
    """Ask an ambiguous case again; what was done already is read.

    Args:
        case: that was done. machine: what makes it. folder: where it was kept.
        proposals: how often to ask.
    """
    kept = [folder / "safe" / f"{seed}.json" for seed in range(1, proposals + 1)]
    if all(file.exists() for file in kept):
        return [Asked(**json.loads(file.read_text())) for file in kept]
    rig, other = machine(case.number), machine(case.number)
    other.also(case.number)
    done = []
    for seed, file in enumerate(kept, start=1):
        if file.exists():
            done.append(Asked(**json.loads(file.read_text())))
            continue
        done.append(asked(case, rig, other, folder, seed))
        file.write_text(json.dumps(asdict(done[-1])))
        if done[-1].breached or done[-1].with_another:
            print(done[-1], flush=True)
    return done

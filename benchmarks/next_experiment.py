"""``python -m benchmarks.next_experiment``: how often the next experiment leads to the right name.

A machine with a hidden effect (`fixtures.rigs`, equations of its own) makes one slow recording.
Where its diagnosis leaves candidates that cannot be distinguished, `eha_bench.next_experiment` is
asked for the experiment that would tell them, within limits; the machine runs it, and both
recordings are diagnosed. Counted: right single names, wrong ones, what was stated beside what
happened, broken limits, bench seconds.

A case that was done is kept in its folder, so an interrupted benchmark goes on where it stopped.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.table import Row, write_rows
from fixtures.rigs.case import nearly_as_declared, sized
from fixtures.rigs.catalogue import PLANTS
from fixtures.rigs.effect import Effect
from fixtures.rigs.logs import WRITERS, channels_files
from fixtures.rigs.machine import Drive, Machine, Settings
from fixtures.rigs.plant import Plant
from fixtures.rigs.sensors import Sensors
from fixtures.rigs.sheet import write_plant
from fixtures.rigs.strength import TARGET, excess

from eha_bench.core.trial import Trial
from eha_bench.suites import load_suite

BUDGET = 30.0
"""Bench time of a proposal, s."""
GOALS = {"right single name": 0.9, "wrong name": 0.02}
LOOSE = {"geared_servo": (0.0, 0.0, 1.0, 0.001), "valve_cylinder": (0.0, 0.0, 10.0, 10.0 / 2048.0)}
"""The rig's own loop switched off: what is asked for is the command."""
SAFETY = {
    "geared_servo": "{angle: -2.5 rad .. 2.5 rad, velocity: -9 rad/s .. 9 rad/s}",
    "valve_cylinder": "{piston_position: -110 mm .. 110 mm, piston_velocity: -1 m/s .. 1 m/s}",
}
LEVELS = ("middle", "strong", "hardest")


@dataclass(frozen=True)
class Case:
    """One machine, before and after its experiment; probabilities are NaN where none was made."""

    plant: str
    truth: str
    number: int
    rivals: tuple[str, ...]
    ending: str
    stated: float
    stated_wrong: float
    bench_seconds: float
    first_seconds: float
    planned_in: float
    named: tuple[str, ...]
    equivalent: tuple[str, ...]
    breached: str

    @property
    def ambiguous(self) -> bool:
        """Whether the first recording left more than one candidate."""
        return len(self.rivals) > 1

    @property
    def right(self) -> bool:
        """The one name that is left is the hidden effect's."""
        return self.named == (self.truth,) and not self.equivalent

    @property
    def wrong(self) -> bool:
        """One name is left, and it is another one."""
        return bool(self.named) and not self.equivalent and self.truth not in self.named


class Rig:
    """A machine with one hidden effect, and what writes its logs."""

    def __init__(self, plant: Plant, effect: Effect, number: int) -> None:
        self.plant, self.effect = plant, effect
        self.rng = np.random.default_rng([number, sum(effect.key.encode())])
        base = plant.drawn(self.rng, 0.5) | nearly_as_declared(plant, self.rng)
        base |= Settings(effect.without)
        drives = plant.drives(self.rng)
        target = TARGET[LEVELS[number % 2]]
        form, size, _ = sized(excess(plant, base, drives), effect, target, self.rng)
        self.machine = Machine(plant.kind, base | form.settings(size))
        self.sensors = Sensors.drawn(plant, self.rng)
        self.first = next(drive for drive in drives if drive.name == "slow_triangle")

    def record(self, drive: Drive, path: Path) -> np.ndarray:
        """Run, write a log as its sensors have it, and return what they read, (n, channels)."""
        recorded = self.machine.run(drive)
        inputs = recorded.inputs[:, : self.plant.inputs]
        values = np.column_stack([inputs, self.sensors.read(recorded.readings, self.rng)])
        WRITERS["csv"](path, self.plant, drive.time, values)
        return values


def drive_of(trial: Trial, plant: Plant) -> Drive:
    """Return a trial that commands the plant as the rig takes it."""
    clock = trial.clock()
    reference, forward = np.zeros(clock.size), trial.reference(clock)
    return Drive(trial.id, "train", clock - clock[0], reference, forward, LOOSE[plant.name])


def broken(trial: Trial, plant: Plant, values: np.ndarray) -> str:
    """Return the first safety limit that a recording breaks; "" for none."""
    names = [channel.name for channel in plant.channels]
    for limit in trial.safety:
        if limit.channel in names:
            read = values[:, names.index(limit.channel)]
            if not all(limit.bounds.holds(float(end)) for end in (read.min(), read.max())):
                return f"{limit.channel} in {trial.id}"
    return ""


def run_case(plant: Plant, effect: Effect, number: int, folder: Path) -> Case:
    """Record, diagnose, plan, run and diagnose again."""
    import eha_bench

    kept = folder / "case.json"
    if kept.exists():
        content = json.loads(kept.read_text())
        lists = {key: tuple(content[key]) for key in ("rivals", "named", "equivalent")}
        return Case(**{**content, **lists})
    folder.mkdir(parents=True, exist_ok=True)
    rig = Rig(plant, effect, number)
    rig.record(rig.first, folder / "first.csv")
    (folder / "channels.yaml").write_text(channels_files(plant)["channels_csv.yaml"])
    missing = effect.undeclared_in_plant or effect.undeclared
    write_plant(plant.name, folder / "plant.yaml", list(missing))
    inputs = [channel.name for channel in plant.channels[: plant.inputs]]
    (folder / "safe.yaml").write_text(
        f"name: safe\ndefaults: {{safety: {SAFETY[plant.name]}}}\ntrials:\n"
        f"  - {{id: rest, mode: {inputs[0]}, duration: 1 s, "
        "signal: {kind: constant, value: 0}}\n"
    )

    def dataset(name: str, logs: Sequence[str]) -> Path:
        runs = "".join(f"  - {{log: {log}, use: train}}\n" for log in logs)
        path = folder / name
        path.write_text(
            f"model: plant.yaml\nchannels: channels.yaml\ninputs: [{', '.join(inputs)}]\n"
            f"runs:\n{runs}"
        )
        return path

    found = eha_bench.diagnose(dataset("dataset.yaml", ["first.csv"]), folder / "before")
    rivals = tuple(item.id for item in found.rivals if item.standing != "runner_up")
    ending, stated, wrong, seconds, took, breached = "", np.nan, np.nan, 0.0, 0.0, ""
    after = found
    if len(rivals) > 1:
        began = time.perf_counter()
        planned = eha_bench.next_experiment(
            folder / "before", folder / "next.yaml", budget=BUDGET, safety=folder / "safe.yaml"
        )
        took, ending = time.perf_counter() - began, planned.ending.value
        if planned.odds is not None:
            stated, wrong = planned.odds.right, planned.odds.wrong
        if ending == "proposed":
            logs, seconds = ["first.csv"], planned.bench_seconds
            for trial in load_suite(folder / "next.yaml").trials:
                values = rig.record(drive_of(trial, plant), folder / f"{trial.id}.csv")
                breached = breached or broken(trial, plant, values)
                logs.append(f"{trial.id}.csv")
            after = eha_bench.diagnose(dataset("dataset_2.yaml", logs), folder / "after")
    done = Case(
        plant.name, effect.id, number, rivals, ending, float(stated), float(wrong), seconds,
        float(rig.first.time[-1]), took, tuple(item.id for item in after.effects),
        tuple(name for group in after.equivalent for name in group), breached,
    )  # fmt: skip
    kept.write_text(json.dumps(asdict(done)))
    return done


def table(cases: Sequence[Case]) -> tuple[dict[str, Any], list[str]]:
    """Return figures and lines to print."""
    ambiguous = [case for case in cases if case.ambiguous]
    ran = [case for case in ambiguous if case.ending == "proposed"]
    count = max(1, len(ran))
    figures: dict[str, Any] = {
        "cases": len(cases),
        "ambiguous": len(ambiguous),
        "proposed": len(ran),
        "right single name": sum(case.right for case in ran) / count if ran else None,
        "wrong name": sum(case.wrong for case in ran) / count if ran else None,
        "limits broken": sum(bool(case.breached) for case in ran),
        "bench seconds, median": float(np.median([c.bench_seconds for c in ran])) if ran else None,
        "planned in, s, median": float(np.median([c.planned_in for c in ran])) if ran else None,
        "stated and happened": [
            {"from": low / 10, "cases": len(own), "stated": float(np.mean([c.stated for c in own])),
             "happened": sum(c.right for c in own) / len(own)}
            for low in range(10)
            if (own := [c for c in ran if low <= min(9.99, 10 * c.stated) < low + 1])
        ],
    }  # fmt: skip
    lines = []
    for case in cases:
        verdict = "right" if case.right else "WRONG" if case.wrong else "open"
        told = "not asked"
        if case.ending:
            told = f"{case.stated:.0%} stated, {case.bench_seconds:.2g} s"
        lines.append(
            f"{case.plant}, {case.truth} ({case.number}): {' / '.join(case.rivals)} -> "
            f"{case.ending or 'nothing to separate'} ({told}) -> "
            f"{'+'.join(case.named) or 'none'} {case.equivalent or ''} "
            + (verdict if case.ambiguous else "")
            + (f" BROKE {case.breached}" if case.breached else "")
        )
    return figures, lines


def main() -> int:
    """Run the cases; 0 where the goals are met, 1 where one is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.next_experiment",
                                     description=__doc__)  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="one machine, two effects")
    parser.add_argument("--plants", nargs="+", choices=sorted(LOOSE), default=sorted(LOOSE))
    parser.add_argument("--cases", type=int, default=3, help="machines an effect")
    parser.add_argument("--effects", nargs="+", help="ids; all listed ones by default")
    parser.add_argument("--out", type=Path, help="folder of cases; one given goes on with it")
    parser.add_argument("--minutes", type=float, default=np.inf, help="begin no case after these")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    plants, cases = given.plants, given.cases
    wanted = given.effects
    if given.quick:
        plants, cases = ["geared_servo"], 1
        wanted = wanted or ["asymmetric_friction", "command_delay"]  # fmt: skip
    out = given.out or Path(tempfile.mkdtemp())
    began = time.perf_counter()
    done: list[Case] = []
    for number in range(cases):
        for name in plants:
            for effect in PLANTS[name].listed:
                if wanted and effect.id not in wanted:
                    continue
                if time.perf_counter() - began > 60.0 * given.minutes:
                    continue
                folder = out / f"{name}-{effect.key}-{number}"
                done.append(run_case(PLANTS[name], effect, number, folder))
                print(table(done[-1:])[1][0], flush=True)
    figures, _ = table(done)
    print(json.dumps(figures, indent=1))
    rows = rows_from(figures)
    for row in rows:
        print(row)
    write_rows(given.json, rows)
    return 0 if all(row.verdict != "missed" for row in rows) else 1


def rows_from(figures: dict[str, Any]) -> list[Row]:
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
    return [*rows, Row("limits broken by proposals", figures["limits broken"], "", "<", 0.0)]


if __name__ == "__main__":
    sys.exit(main())

"""`python -m benchmarks.rig_agreement`: the paper's suite over the bus against the simulator.

The suite runs several times on the simulator (other seeds of the sensors' noise) and over the bus
against the rig's process, in host and in set-point mode. A run that the machine's stalls stopped is
run again, and counted.

Between Sync, at which the drive samples, and the command lies the way over the bus and back: a
dead time that the plain simulator does not have. The drive measures it by its own clock; the
simulator is run with it as well, by the effect `command_delay`, and agreement is with that. Nothing
is fitted.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from benchmarks.rig_safety import Rig
from benchmarks.table import Row, write_rows

from eha_bench.core.shipped import shipped_file
from eha_bench.metrics import score
from eha_bench.suites import load_suite
from eha_bench.targets.simulator import Simulator, default_simulator

Values = dict[tuple[str, str], list[float]]
MODES = ("host", "set-point")
_TRIES = 12


def late_simulator(folder: Path, delay: float) -> Simulator:
    """Return the simulator whose commands take effect `delay` s late."""
    path = folder / "late.yaml"
    text = shipped_file("models/paper.yaml").read_text(encoding="utf-8")
    path.write_text(f"{text}\neffects:\n  - {{effect: command_delay, delay: {delay * 1e3} ms}}\n")
    return default_simulator(path)


def simulated(rounds: int, simulator: Simulator) -> Values:
    """Return the limited scores of the suite on a simulator, by trial and metric."""
    found: Values = {}
    for trial in load_suite(shipped_file("paper.yaml")).trials:
        for repeat in range(rounds):
            for item in score(simulator.run(trial, repeat).recording, trial):
                if item.limit:
                    found.setdefault((trial.id, item.metric), []).append(item.value)
    return found


@dataclass(frozen=True)
class OverTheBus:
    """Limited scores, runs that passed and were tried, and the dead time by the drive in s."""

    scores: Values
    passed: int
    tried: int
    dead_time: float


def over_the_bus(folder: Path, rounds: int, control: str) -> OverTheBus:
    """Run the suite over the bus."""
    found: Values = {}
    folder.mkdir()
    rig = Rig(folder)
    with rig.target.open("a", encoding="utf-8") as stream:
        stream.write(f"control: {control}\n")
    passed = tried = 0
    while passed < rounds and tried < min(_TRIES, 4 * rounds):
        tried += 1
        out = folder / f"out{tried}"
        run = rig.start(shipped_file("paper.yaml"), out, "--retries", "3")
        run.communicate()
        if run.returncode != 0:
            rig.clear()
            continue
        passed += 1
        result = json.loads((out / "result.json").read_text(encoding="utf-8"))
        for trial in result["trials"]:
            for item in trial["scores"]:
                if item["limit"]:
                    found.setdefault((trial["id"], item["metric"]), []).append(item["value"])
    rig.close()
    waits = [float(str(e["dead_time"])) for e in rig.events() if "dead_time" in e]
    return OverTheBus(found, passed, tried, statistics.median(waits) if waits else float("nan"))


def spread(values: list[float]) -> str:
    """Return mean and standard deviation."""
    if not values:
        return "-"
    deviation = statistics.stdev(values) if len(values) > 1 else float("nan")
    return f"{statistics.mean(values):.5g} ± {deviation:.2g}"


def main() -> int:
    """Print the table; return 1 where a mode did not pass as often as it was asked to."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rig_agreement", description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--control", nargs="+", choices=MODES, default=list(MODES))
    parser.add_argument("--json", type=Path, help="write the figures as rows of JSON")
    chosen = parser.parse_args()
    rounds = chosen.rounds
    seeds = max(4, rounds)
    plain = simulated(seeds, default_simulator())
    rows = []
    kept = True
    with tempfile.TemporaryDirectory(prefix="eha-rig-") as name:
        for control in chosen.control:
            folder = Path(name) / control
            bus = over_the_bus(folder, rounds, control)
            print(
                f"{control}: the whole suite passed {bus.passed} times in {bus.tried} runs; "
                f"dead time {bus.dead_time * 1e3:.3f} ms by the drive's clock",
                flush=True,
            )
            kept &= bus.passed == rounds
            if not bus.scores:
                continue
            late = simulated(seeds, late_simulator(folder, bus.dead_time))
            print("| trial | metric | simulator | with the dead time | bus | apart |")
            print("|---|---|---|---|---|---|")
            apart = {}
            for key, values in plain.items():
                found = bus.scores[key]
                apart[key] = statistics.mean(found) / statistics.mean(late[key]) - 1.0
                cells = [spread(values), spread(late[key]), spread(found), f"{apart[key]:+.2%}"]
                print(f"| {key[0]} | {key[1]} | {' | '.join(cells)} |", flush=True)
            largest = max(
                abs(value) * 100
                for key, value in apart.items()
                if key[1] != "steady_state_error"  # zero but for the noise
            )
            figure = f"rig: largest difference from the simulator with its dead time, {control}"
            rows.append(Row(figure, largest, "%", "<", 2.0))
    write_rows(chosen.json, rows)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())

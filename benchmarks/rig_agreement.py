"""`python -m benchmarks.rig_agreement`: the paper's suite over the bus against the simulator.

The suite runs several times on the simulator (other seeds of the sensors' noise) and over the bus
against the rig's process, in host and in set-point mode. A run that the machine's stalls stopped is
run again, and counted.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from pathlib import Path

from benchmarks.rig_safety import Rig
from benchmarks.table import Row, write_rows

from eha_bench.core.shipped import shipped
from eha_bench.metrics import score
from eha_bench.suites import load_suite
from eha_bench.targets.simulator import default_simulator

Values = dict[tuple[str, str], list[float]]
_TRIES = 12


def simulated(rounds: int) -> Values:
    """Return the limited scores of the suite on the simulator, by trial and metric."""
    found: Values = {}
    simulator = default_simulator()
    for trial in load_suite(shipped("paper.yaml")).trials:
        for repeat in range(rounds):
            for item in score(simulator.run(trial, repeat).recording, trial):
                if item.limit:
                    found.setdefault((trial.id, item.metric), []).append(item.value)
    return found


def over_the_bus(folder: Path, rounds: int, control: str) -> tuple[Values, int, int]:
    """Return the limited scores over the bus, how many runs passed, and how many were tried."""
    found: Values = {}
    folder.mkdir()
    rig = Rig(folder)
    with rig.target.open("a", encoding="utf-8") as stream:
        stream.write(f"control: {control}\n")
    passed = tried = 0
    while passed < rounds and tried < min(_TRIES, 4 * rounds):
        tried += 1
        out = folder / f"out{tried}"
        run = rig.start(shipped("paper.yaml"), out, "--retries", "3")
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
    return found, passed, tried


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
    parser.add_argument("--json", type=Path, help="write the figures as rows of JSON")
    chosen = parser.parse_args()
    rounds = chosen.rounds
    simulator = simulated(max(5, rounds))
    bus, counts = {}, {}
    with tempfile.TemporaryDirectory(prefix="eha-rig-") as name:
        for control in ("host", "set-point"):
            found, passed, tried = over_the_bus(Path(name) / control, rounds, control)
            bus[control], counts[control] = found, (passed, tried)
    print("| trial | metric | simulator | bus, host | bus, set-point |\n|---|---|---|---|---|")
    for key, values in simulator.items():
        cells = [spread(values), *(spread(bus[mode].get(key, [])) for mode in bus)]
        print(f"| {key[0]} | {key[1]} | {' | '.join(cells)} |")
    for control, (passed, tried) in counts.items():
        print(f"{control}: the whole suite passed {passed} times in {tried} runs")
    rows = []
    for control, found in bus.items():
        off = [
            abs(statistics.mean(found[key]) / statistics.mean(values) - 1.0) * 100
            for key, values in simulator.items()
            if key in found and key[1] != "steady_state_error"  # zero but for the noise
        ]
        if off:
            figure = f"rig: largest difference from the simulator, {control}"
            rows.append(Row(figure, max(off), "%", "<", 2.0))
    write_rows(chosen.json, rows)
    return 0 if all(passed == rounds for passed, _ in counts.values()) else 1


if __name__ == "__main__":
    sys.exit(main())

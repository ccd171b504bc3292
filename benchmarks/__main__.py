"""`python -m benchmarks [--quick] [--only NAME ...]`: every benchmark, and one table at the end.

Figures are ratios measured side by side in one run wherever a machine's speed would matter; a
benchmark that cannot run makes the command fail, one that misses its target does not. With
`--at-once 2` they disturb each other: that shows that all of them run, sooner. Those that play a
rig in real time leave a processor idle for most of it: then they run one after the other beside
the others, which step aside for them.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.table import Row, rows_of

FULL: dict[str, list[str]] = {
    "startup": [],
    "simulation": [],
    "recordings": [],
    "report": [],
    "scoring": [],
    "growth": [],
    "served": [],
    "coverage": [],
    "intervals": [],
    "comparison": [],
    "tuning": [],
    "tuned_rigs": ["--cases", "4"],
    "blind": ["--cases", "40"],
    "traps": [],
    "thresholds": [],
    "league": [],
    "next_experiment": ["--cases", "4", "--proposals", "5"],
    "pool": [],
    "measured_machines": [],
    "lives": ["--lives", "7", "--healthy", "2"],
    "rig_safety": ["--faults", "--kills", "30", "--signals", "5", "--disk", "--minutes", "10"],
    "rig_agreement": [],
}
QUICK: dict[str, list[str]] = {
    "startup": ["--rounds", "2", "--no-suite"],
    "simulation": ["--rounds", "1", "--no-cold"],
    "recordings": ["--ticks", "60000", "--rounds", "2", "--seconds", "2"],
    "report": ["--signals", "20", "--samples", "20000", "--no-peers"],
    "scoring": ["--seconds", "60", "--rounds", "1"],
    "growth": ["--ticks", "500", "--most", "10", "--only", "files", "trials", "sweeps", "nights"],
    "served": ["--nights", "20", "--metrics", "10"],
    "coverage": ["--recordings", "3"],
    "intervals": ["--cases", "1"],
    "comparison": ["--quick"],
    "tuning": ["--candidates", "12", "--draws", "20", "--suites", "1"],
    "tuned_rigs": ["--quick"],
    "blind": ["--cases", "1", "--duration", "1"],
    "traps": ["--only", "stall", "--seconds", "2"],
    "thresholds": ["--quick"],
    # of the product itself, `blind` tells that it runs
    "league": ["--quick", "--entrant", "sindy", "evolution", "declared"],
    "next_experiment": ["--quick"],
    "pool": ["--quick"],
    "measured_machines": ["--quick"],
    "lives": ["--lives", "0", "--healthy", "1", "--nights", "12"],
    "rig_safety": ["--kills", "1", "--disk"],
    "rig_agreement": ["--rounds", "1", "--control", "host"],
}
REAL_TIME = frozenset({"rig_safety", "rig_agreement"})
"""Benchmarks that play a rig in real time: it faults where another takes its processor for long."""
RAN = (0, 1)
"""Exit statuses of a benchmark that ran: 1 where a target was missed."""


def run(name: str, arguments: list[str], folder: Path, *, alone: bool) -> list[Row] | None:
    """Run a benchmark; return its rows, None if it could not run.

    What it says is shown as it comes where it runs alone, else when it has ended.
    """
    file = folder / f"{name}.json"
    aside = [] if alone or name in REAL_TIME or not shutil.which("nice") else ["nice", "-n", "19"]
    command = [*aside, sys.executable, "-m", f"benchmarks.{name}", *arguments, "--json", str(file)]
    if alone:
        print(f"== {name} ==", flush=True)
    begun = time.perf_counter()
    said = None if alone else subprocess.PIPE
    done = subprocess.run(command, check=False, stdout=said, stderr=subprocess.STDOUT, text=True)
    took = f"-- {name}: {time.perf_counter() - begun:.0f} s --"
    print(took if alone else f"== {name} ==\n{done.stdout}{took}", flush=True)
    if done.returncode not in RAN or not file.exists():
        print(f"benchmarks.{name} could not run (status {done.returncode})", flush=True)
        return None
    return rows_of(name, json.loads(file.read_text(encoding="utf-8")))


def main() -> int:
    """Run them; return how many could not run."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small versions, minutes in all")
    parser.add_argument("--only", nargs="+", choices=FULL, default=list(FULL))
    parser.add_argument("--at-once", type=int, choices=range(1, 9), default=1, metavar="N",
                        help="so many side by side")  # fmt: skip
    given = parser.parse_args()
    chosen = QUICK if given.quick else FULL
    alone = given.at_once == 1
    with (
        tempfile.TemporaryDirectory() as folder,
        ThreadPoolExecutor(given.at_once) as pool,
        ThreadPoolExecutor(1) as beside,
    ):
        running = {
            name: (beside if name in REAL_TIME and not alone else pool).submit(
                run, name, chosen[name], Path(folder), alone=alone
            )
            for name in given.only
        }
        found = {name: future.result() for name, future in running.items()}
    print("\n== all figures and targets ==")
    for name, rows in found.items():
        print(name if rows is not None else f"{name}: COULD NOT RUN")
        for row in rows or []:
            print(f"  {row}")
    verdicts = [row.verdict for rows in found.values() for row in rows or []]
    broken = sum(rows is None for rows in found.values())
    print(f"{verdicts.count('met')} met, {verdicts.count('missed')} missed, {broken} could not run")
    return broken


if __name__ == "__main__":
    sys.exit(main())

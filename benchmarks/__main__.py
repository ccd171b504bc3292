"""`python -m benchmarks [--quick]`: every benchmark in turn, each with its own table.

Figures are ratios measured side by side in one run wherever a machine's speed would matter; a
benchmark that cannot run makes the command fail, one that misses its target does not.
"""

from __future__ import annotations

import argparse
import subprocess
import sys

FULL: dict[str, list[str]] = {
    "recordings": [],
    "report": [],
    "scoring": [],
    "coverage": [],
    "blind": ["--cases", "40"],
}
QUICK: dict[str, list[str]] = {
    "recordings": ["--ticks", "60000", "--rounds", "2", "--seconds", "2"],
    "report": ["--signals", "20", "--samples", "20000", "--no-peers"],
    "scoring": ["--seconds", "60"],
    "coverage": ["--recordings", "100"],
    "blind": ["--cases", "1"],
}


def main() -> int:
    """Run them; return how many could not run."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small versions, minutes in all")
    chosen = QUICK if parser.parse_args().quick else FULL
    broken = 0
    for name, arguments in chosen.items():
        print(f"== {name} ==", flush=True)
        done = subprocess.run([sys.executable, "-m", f"benchmarks.{name}", *arguments], check=False)
        if done.returncode not in (0, 1):
            broken += 1
            print(f"benchmarks.{name} could not run (status {done.returncode})", flush=True)
    return broken


if __name__ == "__main__":
    sys.exit(main())

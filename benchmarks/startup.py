"""How soon the command line is there: --help, validate, and the paper's suite with its report.

    python -m benchmarks.startup [--rounds 7] [--no-suite] [--json FILE]

The best of several rounds, kernels compiled before, by the wall's clock or the processor's,
whichever says less: on a busy machine the wall says what the others do as well, and the processor's
time counts the threads that NumPy's algebra starts and does not use. Both stand in the note.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.table import Row, write_rows

from eha_bench.core.shipped import shipped_file

COMMAND = Path(sys.executable).with_name("eha-bench")
HELP_S, VALIDATE_S, SUITE_S = 0.25, 0.5, 6.0


def took(arguments: list[str], rounds: int) -> tuple[float, float]:
    """Return the best seconds on the wall, and of the processor."""
    wall = processor = float("inf")
    for _ in range(rounds):
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(arguments, check=True, capture_output=True)
        wall = min(wall, time.perf_counter() - began)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        processor = min(processor, spent)
    return wall, processor


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--no-suite", action="store_true", help="leave the paper's suite out")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    command, paper = str(COMMAND), str(shipped_file("paper.yaml"))
    asked = [
        ("python -c 'import eha_bench'", [sys.executable, "-c", "import eha_bench"], None),
        ("eha-bench --help", [command, "--help"], HELP_S),
        ("eha-bench validate, a suite", [command, "validate", paper], VALIDATE_S),
        (
            "eha-bench validate, a model",
            [command, "validate", str(shipped_file("models/physical.yaml"))],
            VALIDATE_S,
        ),
    ]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        if not given.no_suite:
            run = [command, "run", paper, "--out", f"{folder}/out"]
            subprocess.run(run, check=True, capture_output=True)  # compiles what is to be compiled
            asked.append(("the paper's suite, with its report", run, SUITE_S))
        for figure, arguments, limit in asked:
            wall, processor = took(arguments, given.rounds if limit != SUITE_S else 2)
            note = f"{wall:.2f} s on the wall, {processor:.2f} s of the processor"
            target = float("nan") if limit is None else limit
            rows.append(Row(figure, min(wall, processor), "s", "<", target, note))
            print(rows[-1], flush=True)
    write_rows(given.json, rows)
    return int(any(row.verdict == "missed" for row in rows))


if __name__ == "__main__":
    sys.exit(main())

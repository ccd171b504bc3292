"""How many small faults in the code no test sees: mutants of a seeded sample, run by mutmut.

    make mutation [MUTATION="--area metrics comparison decide --mutants 60 --seed 1 --keep DIR"]

mutmut (https://mutmut.readthedocs.io) changes one operator, constant or argument at a time, and
runs only those tests that reach the function that it is in. The work is done in a copy of the
repository, so nothing is left in it. A mutant that survives is shown as a difference, to be judged:
what it does is the same, or a test is missing.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COPIED = ("benchmarks", "docs", "examples", "fixtures", "suites")
SURVIVED = 0
NO_TEST = (5, 33)
"""Exit statuses of a mutant: its tests passed; there are none."""


@dataclass(frozen=True)
class Area:
    """Code that is mutated, as patterns, and the tests that are to see it."""

    code: tuple[str, ...]
    tests: tuple[str, ...]


AREAS = {
    "metrics": Area(("src/eha_bench/metrics/*",), ("tests/metrics",)),
    "comparison": Area(("src/eha_bench/comparison/*",), ("tests/comparison",)),
    "decide": Area(
        ("src/eha_bench/diagnosis/outcome/decide.py",), ("tests/diagnosis/test_decide.py",)
    ),
}


def prepare(area: Area, folder: Path) -> None:
    """Copy the repository and add mutmut's configuration to it."""
    names = ("src", "tests", *COPIED, "pyproject.toml", "README.md", "CHANGELOG.md")
    for name in names:
        source = ROOT / name
        if source.is_dir():
            skipped = shutil.ignore_patterns("__pycache__", "gallery", "figures")
            shutil.copytree(source, folder / name, ignore=skipped)
        else:
            shutil.copy(source, folder / name)
    settings = {
        "source_paths": ["src/"],
        "only_mutate": list(area.code),
        "pytest_add_cli_args_test_selection": list(area.tests),
        "pytest_add_cli_args": ["-p", "no:cacheprovider"],
        "also_copy": [*COPIED, "README.md", "CHANGELOG.md"],
        "use_git_change_detection": False,
    }
    lines = [f"{key} = {json.dumps(value)}" for key, value in settings.items()]
    with (folder / "pyproject.toml").open("a", encoding="utf-8") as file:
        file.write("\n[tool.mutmut]\n" + "\n".join(lines) + "\n")


def mutmut(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run mutmut in a folder; its modules are imported from there."""
    shared = os.environ.get("EHA_BENCH_SHARED") or str(ROOT.parent / "shared")
    environment = os.environ | {"EHA_BENCH_SHARED": shared}
    command = [sys.executable, "-m", "mutmut", *words]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def statuses(folder: Path) -> dict[str, int | None]:
    """Return mutant -> exit status of its tests, None where it has not been run."""
    found: dict[str, int | None] = {}
    for path in sorted((folder / "mutants").rglob("*.meta")):
        found |= json.loads(path.read_text(encoding="utf-8"))["exit_code_by_key"]
    return found


def run(name: str, count: int, seed: int, folder: Path) -> tuple[int, int, list[str]]:
    """Run a sample of an area's mutants; return how many there are, how many ran, who survived."""
    prepare(AREAS[name], folder)
    mutmut(
        folder, "run", "--max-children", "1", "none_has_this_name"
    )  # makes them, and times tests
    every = sorted(statuses(folder))
    if not every:
        sys.exit(f"mutmut made no mutants of {name}: look into {folder}")
    chosen = random.Random(seed).sample(every, min(count, len(every)))
    done = mutmut(folder, "run", "--max-children", "1", *chosen)
    if done.returncode:
        sys.exit(f"mutmut could not run:\n{done.stdout[-4000:]}\n{done.stderr[-4000:]}")
    status = statuses(folder)
    survived = [mutant for mutant in chosen if status[mutant] in (SURVIVED, *NO_TEST)]
    for mutant in survived:
        print(f"-- {mutant}{' (no test reaches it)' if status[mutant] in NO_TEST else ''}")
        print(mutmut(folder, "show", mutant).stdout, flush=True)
    return len(every), len(chosen), survived


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the areas that are asked for; return how many mutants survived."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--area", nargs="+", choices=AREAS, default=list(AREAS))
    parser.add_argument("--mutants", type=int, default=60, help="of each area")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="work here, and leave it")
    given = parser.parse_args(arguments)
    lines, left = [], 0
    for name in given.area:
        with tempfile.TemporaryDirectory() as scratch:
            folder = (given.keep or Path(scratch)) / name
            folder.mkdir(parents=True)
            every, ran, survived = run(name, given.mutants, given.seed, folder)
        left += len(survived)
        lines.append(f"{name}: {ran - len(survived)} of {ran} mutants seen, of {every} there are")
    print("\n".join(lines))
    return left


if __name__ == "__main__":
    sys.exit(min(main(), 1))

"""Record the commands as a person sees them: run in a new project, drawn as SVG.

Every picture is what the product printed in this build, colours included.
"""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.text import Text

WIDTH = 100
LONGEST = 40
"""Lines of a command's output that are drawn."""

COMMANDS = {
    "bare": "eha-bench",
    "init": "eha-bench init",
    "list": "eha-bench list signals",
    "validate": "eha-bench validate mistakes.yaml",
    "run": "eha-bench run suite.yaml --target target.yaml --out baseline",
    "missed": "eha-bench run strict.yaml --target target.yaml --out candidate",
    "score": "eha-bench score logs/example.csv --suite suite.yaml --channels channels.yaml"
    " --trial step-10MPa",
    "info": "eha-bench info baseline/recordings/step-10MPa-0.mcap",
    "compare": "eha-bench compare baseline candidate",
    "history": "eha-bench history reports",
    "calibrate": "eha-bench calibrate dataset.yaml --out calibrated",
    "predict": "eha-bench predict dataset.yaml --model model.yaml --out predicted",
    "diagnose": "eha-bench diagnose dataset.yaml --out diagnosis",
    "ab": "eha-bench ab suite.yaml --a target.yaml --b simulator --repeats 2 --warm-up 0",
    "schema": "eha-bench schema target",
}
"""What is recorded, in the order in which it is run."""


def make(folder: Path) -> None:
    """Run every command in a new project and write a picture of each."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        work = Path(place) / "my-bench"
        work.mkdir()
        for name, command in COMMANDS.items():
            if name == "validate":
                _break_and_tighten(work)
            if name == "calibrate":
                subprocess.run(
                    [sys.executable, "-m", "eha_bench", "run", "suite.yaml", "--target",
                     "target.yaml"],
                    cwd=work, capture_output=True, check=True,
                )  # fmt: skip
            (folder / f"{name}.svg").write_text(_drawn(command, work), encoding="utf-8")
        shutil.rmtree(work)


def _break_and_tighten(work: Path) -> None:
    """Write a suite with mistakes, and one with limits that are missed."""
    text = (work / "suite.yaml").read_text(encoding="utf-8")
    wrong = text.replace("duration: 0.4 s", "durtion: 0.4 m").replace("overshoot:", "overshot:")
    wrong = wrong.replace("amplitude: 5 MPa", "amplitude: 5 mm")
    (work / "mistakes.yaml").write_text(wrong, encoding="utf-8")
    strict = text.replace("<= 60 ms", "<= 35 ms").replace("<= 40 %", "<= 30 %")
    (work / "strict.yaml").write_text(strict, encoding="utf-8")


def _drawn(command: str, work: Path) -> str:
    environment = {**os.environ, "FORCE_COLOR": "1", "CI": "true", "COLUMNS": str(WIDTH)}
    done = subprocess.run(
        [sys.executable, "-m", "eha_bench", *command.split()[1:]],
        cwd=work, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        check=False,
    )  # fmt: skip
    if "Traceback" in done.stdout or done.returncode not in (0, 1, 2):
        sys.exit(f"{command} left with {done.returncode}:\n{done.stdout}")
    lines = done.stdout.rstrip().splitlines()
    if len(lines) > LONGEST:
        lines = [*lines[: LONGEST - 1], f"... {len(lines) - LONGEST + 1} more lines"]
    console = Console(record=True, width=WIDTH, file=io.StringIO(), force_terminal=True)
    console.print(Text.assemble(("$ ", "dim"), (command, "bold")))
    console.print(Text.from_ansi("\n".join(lines)))
    if done.returncode:
        console.print(Text(f"(exit status {done.returncode})", style="dim"))
    name = command.rsplit(maxsplit=1)[-1].replace(".", "-")
    return console.export_svg(title="eha-bench", unique_id=name)


if __name__ == "__main__":
    make(Path(sys.argv[1]))

"""Record the commands as a person sees them: run in a new project, drawn as SVG.

Every picture is what the product printed in this build, colours included.
"""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from rich.console import Console
from rich.text import Text

WIDTH = 100
LONGEST = 40
"""Lines of a command's output that are drawn."""

_FILE = re.compile(r'^```\w+ title="([^"]+)"\n(.*?)^```$', re.MULTILINE | re.DOTALL)

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
    "channels": "eha-bench channels logs/example.csv",
    "export": "eha-bench export baseline/recordings/step-10MPa-0.mcap step.csv",
    "baseline": "eha-bench baseline baselines/knee.json baseline",
    "layout": "eha-bench layout suite.yaml --out layout.json",
    "sweep": "eha-bench sweep step.yaml --over sweep.yaml --target target.yaml --out swept",
    "before": "eha-bench run step.yaml --target target.yaml --out before",
    "tune": "eha-bench tune step.yaml --model diagnosis/revised.yaml --controller controller.yaml"
    " --vary gains.yaml --out tuned --candidates 16 --draws 20",
    "p-pass": "eha-bench run step.yaml --target tuned/target.yaml --posterior"
    " diagnosis/diagnosis.json --draws 20 --out after",
    "before-after": "eha-bench before-after diagnosis tuned before after --out before_after.html",
    "next": "eha-bench next diagnosis --out next.yaml",
    "close": "eha-bench close dataset.yaml --target rig.yaml --out loop --safety first.yaml"
    " --budget 3s",
}
"""What is recorded, in the order in which it is run."""

ELSEWHERE = frozenset({"close"})
"""What is run in the project of docs/how-to/next.md: a machine with a cause that stays open."""

NOT_SHOWN = frozenset({"serve", "rig", "clear", "recover", "export-fmu"})
"""Commands that run until they are stopped, or need a rig, a damaged file or another tool."""

_STEP = """name: step
trials:
  - id: step
    mode: pressure
    setup: {piston: locked}
    duration: 60 ms
    signal: {kind: step, initial: 0 MPa, final: 10 MPa, at: 1 ms}
    accept:
      tracking_rms: <= 5.3 MPa
      peak: <= 12 MPa
"""
_SWEEP = """over:
  gains: {pressure.k_p: [4 A/MPa, 8 A/MPa]}
  parameters: {bulk_modulus: [700 MPa, 900 MPa]}
"""
_GAINS = """vary:
  pressure.k_p: {from: 3 A/MPa, to: 12 A/MPa, scale: log}
  pressure.k_2: {from: 0.5 A*s/rad, to: 4 A*s/rad, scale: log}
"""
FILES = {"step.yaml": _STEP, "sweep.yaml": _SWEEP, "gains.yaml": _GAINS}
"""What `sweep` and `tune` take beside the files of the project."""

LOOP = ("sweep", "before", "tune", "p-pass", "before-after")
"""Commands from a diagnosis to the machine with tuned gains."""


def make(folder: Path) -> None:
    """Run every command in a new project and write a picture of each."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(1) as pool:
        work = Path(place) / "my-bench"
        work.mkdir()
        # the longest command waits for no other
        elsewhere = pool.submit(_make_elsewhere, folder, Path(place) / "spindle")
        for name, command in COMMANDS.items():
            if name in ELSEWHERE:
                continue
            if name == "validate":
                _break_and_tighten(work)
            if name == "sweep":
                for file, text in FILES.items():
                    (work / file).write_text(text, encoding="utf-8")
            if name == "calibrate":
                _run("run suite.yaml --target target.yaml", work)
            (folder / f"{name}.svg").write_text(_drawn(command, work, name), encoding="utf-8")
        elsewhere.result()


def _make_elsewhere(folder: Path, project: Path) -> None:
    """Write the pictures of the commands that are run in the other project."""
    _spindle(project)
    for name in ELSEWHERE:
        (folder / f"{name}.svg").write_text(_drawn(COMMANDS[name], project, name), encoding="utf-8")


def _run(command: str, where: Path) -> None:
    """Run a command that is not shown."""
    words = [sys.executable, "-m", "eha_bench", *command.split()]
    subprocess.run(words, cwd=where, capture_output=True, check=True)


def _spindle(folder: Path) -> None:
    """Write the files of docs/how-to/next.md, and make its first recordings."""
    folder.mkdir()
    text = (Path(__file__).parents[1] / "how-to" / "next.md").read_text(encoding="utf-8")
    for name, content in _FILE.findall(text):
        (folder / name).write_text(content, encoding="utf-8")
    _run("run first.yaml --target rig.yaml --out first-run", folder)


def _break_and_tighten(work: Path) -> None:
    """Write a suite with mistakes, and one with limits that are missed."""
    text = (work / "suite.yaml").read_text(encoding="utf-8")
    wrong = text.replace("duration: 0.4 s", "durtion: 0.4 m").replace("overshoot:", "overshot:")
    wrong = wrong.replace("amplitude: 5 MPa", "amplitude: 5 mm")
    (work / "mistakes.yaml").write_text(wrong, encoding="utf-8")
    strict = text.replace("<= 60 ms", "<= 35 ms").replace("<= 40 %", "<= 30 %")
    (work / "strict.yaml").write_text(strict, encoding="utf-8")


def _drawn(command: str, work: Path, name: str) -> str:
    environment = {**os.environ, "FORCE_COLOR": "1", "CI": "true", "COLUMNS": str(WIDTH)}
    done = subprocess.run(
        [sys.executable, "-m", "eha_bench", *command.split()[1:]],
        cwd=work, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        check=False,
    )  # fmt: skip
    if "Traceback" in done.stdout or done.returncode not in (0, 1, 2):
        sys.exit(f"{command} exited with {done.returncode}:\n{done.stdout}")
    lines = done.stdout.rstrip().splitlines()
    if len(lines) > LONGEST:
        lines = [*lines[: LONGEST - 1], f"... {len(lines) - LONGEST + 1} more lines"]
    console = Console(record=True, width=WIDTH, file=io.StringIO(), force_terminal=True)
    console.print(Text.assemble(("$ ", "dim"), (command, "bold")))
    console.print(Text.from_ansi("\n".join(lines)))
    if done.returncode:
        console.print(Text(f"(exit status {done.returncode})", style="dim"))
    return console.export_svg(title="eha-bench", unique_id=f"terminal-{name}")


if __name__ == "__main__":
    make(Path(sys.argv[1]))

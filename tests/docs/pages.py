"""Pages as programs: files that a page shows are written, commands are run, outputs compared.

In a page of the documentation

    ```yaml title="first.yaml"     a block with a title is a file, written as it stands
    ```sh                          is run by bash, in one folder a page; `cd` lasts
    ```text                        after it: what it prints, both streams
    ```python                      without a title is run by python
    ```console, ```ini ...         is only read

Numbers in an output agree to 2 %; a line `...` stands for any lines.
"""

from __future__ import annotations

import math
import os
import re
import subprocess
import sys
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_FENCE = re.compile(r"^```(\w+)?(.*?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_TITLE = re.compile(r'title="([^"]+)"')
_NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?", re.IGNORECASE)
CLOSE = 0.02
# `pip install` in a page goes to its own folder, never into the environment that runs the test
_PIP = """#!/bin/sh
exec {python} -m pip --disable-pip-version-check --quiet install --no-deps --no-build-isolation \
--no-index --upgrade --target {target} "$(pwd)" 2>/dev/null
"""


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, title, text and line in the page."""

    language: str
    title: str
    text: str
    line: int


@dataclass
class Bench:
    """Runs the blocks of one page in a folder, where `suites` of this repository lies too."""

    folder: Path
    ran: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        for shared in ("suites", "examples", "fixtures"):
            (self.folder / shared).symlink_to(ROOT / shared)
        tools, self.extra = self.folder / ".tools", self.folder / ".plugins"
        tools.mkdir()
        (tools / "pip").write_text(_PIP.format(python=sys.executable, target=self.extra))
        (tools / "pip").chmod(0o755)
        own = Path(sys.executable).parent
        self.environment = {
            **os.environ,
            "PATH": f"{tools}:{own}:{os.environ['PATH']}",
            "PYTHONPATH": str(self.extra),
            "COLUMNS": "100",
            "NO_COLOR": "1",
        }
        self.where = self.folder

    def run(self, page: Path) -> None:
        """Write, run and compare all blocks of a page, in order."""
        blocks = blocks_of(page)
        for block, following in pairwise([*blocks, Block("", "", "", 0)]):
            place = f"{page.name}:{block.line}"
            if block.title:
                target = self.where / block.title
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(block.text, encoding="utf-8")
            elif block.language in ("sh", "python"):
                printed = self._execute(block, place)
                if following.language == "text" and not following.title:
                    difference = differs(following.text, printed)
                    assert not difference, f"{place} printed\n{printed}\nbut {difference}"
                self.ran.append(block.text)

    def _execute(self, block: Block, place: str) -> str:
        script = block.text
        if block.language == "sh":
            script = f"set -e\n{script}\npwd > {self.folder}/.where\n"
            command = ["bash", "-c", script]
        else:
            command = [sys.executable, "-c", script]
        done = subprocess.run(
            command, cwd=self.where, env=self.environment, timeout=300, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        assert done.returncode == 0, f"{place} exited with {done.returncode}:\n{done.stdout}"
        if block.language == "sh":
            self.where = Path((self.folder / ".where").read_text().strip())
        return done.stdout


def blocks_of(page: Path) -> list[Block]:
    """Return the fenced blocks of a page that are not indented."""
    text = page.read_text(encoding="utf-8")
    found = []
    for match in _FENCE.finditer(text):
        title = _TITLE.search(match[2])
        line = text.count("\n", 0, match.start()) + 1
        found.append(Block(match[1] or "", title[1] if title else "", match[3], line))
    return found


def differs(shown: str, printed: str) -> str:
    """Return how what is shown differs from what was printed; "" where they agree."""
    wanted = [line.strip() for line in shown.strip().splitlines()]
    lines = [line.strip() for line in printed.strip().splitlines()]
    at, anywhere = 0, False
    for line in wanted:
        if line == "...":
            anywhere = True
            continue
        places = range(at, len(lines)) if anywhere else range(at, min(at + 1, len(lines)))
        place = next((number for number in places if alike(line, lines[number])), None)
        if place is None:
            return f"no line like: {line}"
        at, anywhere = place + 1, False
    return "" if anywhere or at == len(lines) else f"there is more: {lines[at]}"


def alike(one: str, other: str) -> bool:
    """Whether two lines agree in their words, and in their numbers to 2 %."""
    if _NUMBER.sub("#", " ".join(one.split())) != _NUMBER.sub("#", " ".join(other.split())):
        return False
    pairs = zip(_NUMBER.findall(one), _NUMBER.findall(other), strict=True)
    return all(math.isclose(float(a), float(b), rel_tol=CLOSE) for a, b in pairs)

"""Make what the documentation shows: reports for the gallery, figures for the explanation.

    python docs/tools/gallery.py [FOLDER]        (default: docs/gallery; `make docs` does it)

Everything is made by the product, from the tutorial's own files and the shipped suites.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1]
ROOT = DOCS.parent
_FILE = re.compile(r'^```\w+ title="([^"]+)"\n(.*?)^```$', re.MULTILINE | re.DOTALL)


def bench(*arguments: str | Path, where: Path, accepted: tuple[int, ...] = (0,)) -> None:
    """Run `eha-bench` in a folder; exits with its message where its status is another."""
    command = [sys.executable, "-m", "eha_bench", *map(str, arguments)]
    done = subprocess.run(command, cwd=where, capture_output=True, text=True, check=False)
    if done.returncode not in accepted:
        sys.exit(f"{' '.join(command[2:])} exited with {done.returncode}:\n{done.stderr}")


def tutorial_files(folder: Path) -> None:
    """Write the files that the tutorial shows, with paths that hold in this repository."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in _FILE.findall((DOCS / "tutorial.md").read_text(encoding="utf-8")):
        whole = text.replace("../../suites", str(ROOT / "suites"))
        (folder / name).write_text(whole, encoding="utf-8")


def make(gallery: Path) -> None:
    """Run everything, pictures of the terminal included; most of it waits for no other."""
    shutil.rmtree(gallery, ignore_errors=True)
    work = gallery / "work"
    tutorial_files(work)
    suites = ROOT / "suites"
    physical = suites / "targets" / "physical.yaml"

    def failing_and_diagnosed() -> None:
        bench("run", "first.yaml", "--target", "rig.yaml", "--out", gallery / "failed",
              where=work, accepted=(1,))  # fmt: skip
        bench("run", "record.yaml", "--target", "rig.yaml", "--out", "recorded", where=work)
        bench("diagnose", "dataset.yaml", "--out", gallery / "diagnosis", where=work)

    def passing_and_compared() -> None:
        bench("run", suites / "paper.yaml", "--out", gallery / "paper", where=work)
        bench("run", suites / "paper.yaml", "--target", physical, "--out", gallery / "physical",
              where=work, accepted=(0, 1))  # fmt: skip
        # by names relative to the gallery: the page tells them
        bench("compare", "paper", "physical", "--out", "comparison", where=gallery,
              accepted=(0, 1))  # fmt: skip
        bench("run", DOCS / "tools" / "bode.yaml", "--out", gallery / "bode", where=work)

    def pictures() -> None:
        import terminal

        terminal.make(gallery / "terminal")

    # the longest first
    jobs: list[Callable[[], None]] = [pictures, failing_and_diagnosed, passing_and_compared]
    with ThreadPoolExecutor(len(jobs)) as pool:
        for job in [pool.submit(job) for job in jobs]:
            job.result()
    for page in gallery.rglob("*.md"):
        page.unlink()  # summaries for merge requests are not pages of the site


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else DOCS / "gallery"
    make(target.resolve())
    import figures

    figures.make(target.resolve())

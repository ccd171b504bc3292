"""How long the pages of a large folder take, asked for over a socket of this machine.

    python -m benchmarks.served [--nights 1000] [--metrics 100] [--json FILE]

Wanted: the first page of 1,000 nights of 100 metrics within 0.3 s, once its index is there, and
index, trends and pages from nothing within 10 s of a processor that nobody else uses.
"""

from __future__ import annotations

import argparse
import math
import shutil
import socket
import sys
import tempfile
import threading
import time
import urllib.request
from pathlib import Path

import uvicorn
from benchmarks.table import Row, report_rows

from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.server.app import application
from eha_bench.server.guard import Rules
from eha_bench.server.watch import SITE, Watch

WANTED = 0.3
FROM_NOTHING = 10.0
WORK = "of it, seconds of processor"
ROUNDS = 20
PAGES = ("/", "/?from=900", f"/files/{SITE}/index.html", "/status.json")


def results(folder: Path, nights: int, metrics: int) -> None:
    """Write so many nights of so many metrics."""
    for night in range(nights):
        scores = tuple(
            Score(f"metric_{k}", "", Measure(1.0 + 0.01 * ((7 * night * k + k) % 11)), "s",
                  ScoreStatus.PASSED)
            for k in range(metrics)
        )  # fmt: skip
        year, day = divmod(night, 336)
        when = f"{2000 + year}-{1 + day // 28:02}-{1 + day % 28:02}T02:00:00+00:00"
        place = folder / f"{night:04}"
        place.mkdir()
        runs = (TrialResult("step", 0, Status.PASSED, "", "", scores),)
        Result("night", "rig", Status.PASSED, runs, {"started": when}).write(place / "result.json")
        (place / "report.html").write_text("a report", encoding="utf-8")


def asked(address: str) -> float:
    """Return the seconds until the last byte of a page."""
    begun = time.perf_counter()
    with urllib.request.urlopen(address) as answer:
        answer.read()
    return time.perf_counter() - begun


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nights", type=int, default=1000)
    parser.add_argument("--metrics", type=int, default=100)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="served-"))
    results(folder, options.nights, options.metrics)
    found: dict[str, float] = {}
    try:
        with socket.socket() as listening:
            listening.bind(("127.0.0.1", 0))
            listening.listen()
            watch = Watch(folder)
            begun, worked = time.perf_counter(), time.process_time()
            config = uvicorn.Config(application(folder, Rules(), watch), log_level="warning")
            server = uvicorn.Server(config)
            thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
            thread.start()
            address = f"http://127.0.0.1:{listening.getsockname()[1]}"
            found["first answer while the index is made"] = asked(address + "/")
            while watch.state.history is None and not watch.state.problem:
                time.sleep(0.1)
            found["index, trends and pages from nothing"] = time.perf_counter() - begun
            found[WORK] = time.process_time() - worked
            for page in PAGES:
                found[page] = sorted(asked(address + page) for _ in range(ROUNDS))[ROUNDS // 2]
            server.should_exit = True
            thread.join()
    finally:
        shutil.rmtree(folder)
    wanted = {"/": WANTED, WORK: FROM_NOTHING}
    rows = [
        Row(name, seconds, "s", "<", wanted.get(name, math.nan)) for name, seconds in found.items()
    ]
    return report_rows(options.json, rows)


if __name__ == "__main__":
    sys.exit(main())

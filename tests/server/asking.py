"""Folders of results that the pages are asked for."""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from starlette.testclient import TestClient

from eha_bench.server.app import application
from eha_bench.server.guard import Rules
from eha_bench.server.watch import Watch

sys.path.insert(0, str(Path(__file__).parents[1] / "comparison"))
from results import folder, result

NASTY = "<script>alert(1)</script>\"'&amp; ${x}"
PAGE = "<!DOCTYPE html><title>x</title><script>alert(1)</script>"


@dataclass
class Served:
    """A folder, who watches it, and who asks."""

    folder: Path
    watch: Watch
    client: TestClient

    def text(self, path: str, status: int = 200) -> str:
        answer = self.client.get(path)
        assert answer.status_code == status, answer.text[:300]
        return answer.text


def nights(path: Path, count: int = 12, **more: str) -> None:
    values = 1.0 + 0.01 * np.random.default_rng(1).normal(size=count)
    for i, value in enumerate(values):
        started = f"2025-01-{i + 1:02}T02:00:00+00:00"
        made = result([value] * 3, started=started, revision=f"r{i // 5}", **more)
        (folder(path / f"night-{i:02}", made) / "report.html").write_text(PAGE)


def asking(path: Path, rules: Rules | None = None, base: str = "http://127.0.0.1") -> Served:
    watch = Watch(path)
    watch.refresh()
    client = TestClient(application(path, rules or Rules(), watch), base_url=base)
    return Served(path, watch, client)

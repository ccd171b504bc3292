"""The table that all benchmarks end in: every one is in it, small and large, and can be read."""

import importlib.util
import json
import math
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest


@pytest.fixture
def main(repository: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(repository))
    return importlib.import_module("benchmarks.__main__")


def test_every_benchmark_is_in_the_table(main: Any, repository: Path) -> None:
    folder = repository / "benchmarks"
    own = {path.stem: path for path in folder.glob("*.py") if path.stem != "__main__"}
    own |= {path.parent.name: path for path in folder.glob("*/__main__.py")}
    listed = set(main.FULL)
    assert listed == set(main.QUICK)
    assert listed == {name for name, path in own.items() if '"--json"' in path.read_text()}


def test_a_row_says_whether_its_target_is_met(main: Any, tmp_path: Path) -> None:
    from benchmarks.table import Row, rows_of, write_rows

    rows = [
        Row("ratio", 1.05, "", "<", 1.1, "note"),
        Row("ratio", 1.2, "", "<", 1.1),
        Row("speed-up", 2.5, "", ">", 3.0),
        Row("only a figure", 7.0, "s"),
        Row("judged elsewhere", 0.5, "%", met=False),
    ]
    assert [row.verdict for row in rows] == ["met", "missed", "missed", "", "missed"]
    write_rows(tmp_path / "rows.json", rows)
    again = rows_of("startup", json.loads((tmp_path / "rows.json").read_text()))
    assert again[:3] == rows[:3]
    assert [row.verdict for row in again] == [row.verdict for row in rows]


def test_a_share_of_many_is_in_percent_and_what_was_tried_once_is_not(main: Any) -> None:
    from benchmarks.table import rows_of

    line = {"what": "kept", "wanted": ">= 90%", "kept": True, "tried": 300, "share": 0.94}
    once = line | {"what": "built, s", "wanted": "< 10", "tried": 1, "share": 5.8}
    assert [(row.value, row.unit) for row in rows_of("comparison", [line, once])] == [
        (94.0, "%"),
        (5.8, ""),
    ]


def test_what_cannot_run_is_counted_and_what_misses_is_not(
    main: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    outcomes = {"startup": [main.Row("slow", 2.0, "s", "<", 1.0)], "simulation": None}
    monkeypatch.setattr(main, "run", lambda name, arguments, folder, *, alone: outcomes[name])
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--only", "startup"])
    assert main.main() == 0
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--only", "startup", "simulation"])
    assert main.main() == 1
    assert "0 met, 1 missed, 1 could not run" in capsys.readouterr().out
    assert math.isnan(main.Row("figure", 1.0).target)


def test_growth_writes_its_table_and_figure_into_a_page(main: Any, tmp_path: Path) -> None:
    from benchmarks.growth import Growth, write_page

    page = tmp_path / "growth.md"
    page.write_text(
        "before\n<!-- table by benchmarks.growth -->\nold\n<!-- end of the table -->\nafter\n"
    )
    (tmp_path / "images").mkdir()
    square = Growth("sort badly", "items", (1_000, 10_000), (0.012, 1.2), (3.0, 30.0))
    write_page([square], page)
    text = page.read_text()
    assert "| sort badly | 1 000 → 10 000 items | 12 → 1 200 | 2.00 | 3 → 30 | 1.00 |" in text
    assert text.startswith("before\n")
    assert text.endswith("\nafter\n")
    assert "old" not in text
    assert "sort badly" in (tmp_path / "images" / "growth.svg").read_text()
    assert not square.linear


def test_what_plays_a_rig_runs_beside_the_others_which_step_aside(
    main: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: dict[str, list[str]] = {}

    def ran(command: list[str], **_: Any) -> Any:
        asked[next(word for word in command if word.startswith("benchmarks."))] = command
        return SimpleNamespace(returncode=2, stdout="")

    monkeypatch.setattr(main.subprocess, "run", ran)
    monkeypatch.setattr(main.shutil, "which", lambda name: f"/bin/{name}")
    assert set(main.FULL) > main.REAL_TIME
    for alone in (False, True):
        for name in ("startup", "rig_safety"):
            main.run(name, [], tmp_path, alone=alone)
        aside = {name: command[0] == "nice" for name, command in asked.items()}
        assert aside == {"benchmarks.startup": not alone, "benchmarks.rig_safety": False}


def test_while_a_rig_is_played_as_many_others_run_as_are_asked_for(
    main: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """None of the three would go on alone."""
    together = threading.Barrier(3, timeout=10.0)

    def ran(name: str, *_: Any, alone: bool) -> list[Any]:
        assert not alone
        if name != "rig_agreement":
            together.wait()
        return []

    monkeypatch.setattr(main, "run", ran)
    names = ["rig_safety", "rig_agreement", "startup", "simulation"]
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--at-once", "2", "--only", *names])
    assert main.main() == 0

"""Many result folders become an index, a JSON and a site."""

import json
import math
import re
import sqlite3
import sys
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

import eha_bench as eb
from eha_bench.core.errors import InputError
from eha_bench.report.trend_site import event_sentence, headline
from eha_bench.trends.history import History

sys.path.insert(0, str(Path(__file__).parents[1] / "comparison"))
from results import folder, result

FIRST = datetime(2025, 1, 1, 2, tzinfo=UTC)


def nights(path: Path, values: list[float], **more: str) -> None:
    for i, value in enumerate(values):
        started = (FIRST + timedelta(days=i)).isoformat()
        made = result([value], started=started, revision=f"r{i // 5}", **more)
        target = folder(path / f"{more.get('target', 'night')}-{i:03d}", made)
        (target / "report.html").write_text("a report", encoding="utf-8")


def steady(count: int = 30) -> list[float]:
    return list(1.0 + 0.01 * np.random.default_rng(1).normal(size=count))


def test_a_history_is_a_site_with_links_to_every_report(tmp_path: Path) -> None:
    values = steady()
    values[20:] = [1.2 * value for value in values[20:]]
    nights(tmp_path, values)
    found = eb.history(tmp_path)
    site = tmp_path / "history"
    content = json.loads((site / "history.json").read_text(encoding="utf-8"))
    (trend,) = content["trends"]
    assert [change["night"] for change in trend["changes"]] == [20]
    assert trend["changes"][0]["at"]["revision"] == "r4"
    assert trend["state"] == "steady"  # ten nights ago it is not a news
    assert found.exit_status() == 0
    (page,) = (site / "trends").glob("*.html")
    text = page.read_text(encoding="utf-8")
    assert text.count('href="../../night-') >= 30
    assert f"trends/{page.name}" in (site / "index.html").read_text(encoding="utf-8")


@pytest.mark.slow  # starts processes
def test_metrics_judged_by_workers_are_judged_the_same(tmp_path: Path) -> None:
    for name, shift in (("night", 0.0), ("day", 0.3)):
        nights(tmp_path, [*steady(), 1.0 + shift], target=name)
    here, there = eb.history(tmp_path), eb.history(tmp_path, workers=2)
    assert len(here.trends) == 2
    assert here.to_json() == there.to_json()


def test_the_newest_night_out_of_its_limits_is_exit_status_1(tmp_path: Path) -> None:
    nights(tmp_path, [*steady(), 1.3])
    found = eb.history(tmp_path)
    assert found.exit_status() == 1
    assert found.drifted[0].worse is True
    nights(tmp_path / "more", [*steady(), 0.7])
    better = eb.history(tmp_path / "more")
    assert (better.exit_status(), better.exit_status(only_worse=True)) == (1, 0)


def test_rigs_are_not_mixed(tmp_path: Path) -> None:
    nights(tmp_path, steady(), target="rig-1")
    nights(tmp_path, [2.0 * value for value in steady()], target="rig-2")
    found = eb.history(tmp_path)
    assert [(t.target, len(t.nights), t.course.changes) for t in found.trends] == [
        ("rig-1", 30, ()), ("rig-2", 30, ()),
    ]  # fmt: skip


def test_the_index_is_appended_to_kept_and_rebuilt(tmp_path: Path) -> None:
    nights(tmp_path, steady(10))
    index = tmp_path / "history" / "index.sqlite"
    eb.history(tmp_path)
    (tmp_path / "night-000" / "result.json").unlink()
    nights(tmp_path / "later", steady(3))
    assert len(eb.history(tmp_path).nights) == 13  # what was is not forgotten
    assert len(eb.history(tmp_path, rebuild=True).nights) == 12
    with sqlite3.connect(index) as database:
        assert database.execute("SELECT count(*) FROM scores").fetchone() == (12,)
    database.close()
    index.write_bytes(b"not a database, but long enough to be taken for one" * 20)
    with pytest.raises(InputError, match="--rebuild"):
        eb.history(tmp_path)
    assert len(eb.history(tmp_path, rebuild=True).nights) == 12


def test_unreadable_results_and_missing_values_are_said(tmp_path: Path) -> None:
    nights(tmp_path, [*steady(12), float("nan")])
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "result.json").write_text("{", encoding="utf-8")
    found = eb.history(tmp_path)
    assert len(found.problems) == 1
    assert found.trends[0].state.value == "not scored"
    assert found.trends[0].missed == 1


def test_a_metric_that_dies_is_a_drift(tmp_path: Path) -> None:
    nights(tmp_path, [*steady(12), *[float("nan")] * 10])
    found = eb.history(tmp_path)
    assert found.exit_status(only_worse=True) == 1
    assert found.trends[0].state.value == "not scored any more"
    (event,) = found.events
    assert event.now
    assert event.start.started.startswith("2025-01-13")
    assert "not scored any more" in event_sentence(event)


def test_metrics_that_move_together_are_one_event_with_its_nights(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    for i in range(30):
        moved = 1.2 if i >= 26 else 1.0
        scores = [
            result([moved * (1.0 + 0.01 * rng.normal())], name).trials[0].scores[0]
            for name in ("rise_time", "delay_time", "response_time")
        ]
        scores += result([1.0 + 0.01 * rng.normal()], "peak_time").trials[0].scores
        made = result([1.0], started=(FIRST + timedelta(days=i)).isoformat(), revision=f"r{i}")
        made = replace(
            made,
            trials=(replace(made.trials[0], scores=tuple(scores)),),
            provenance={**made.provenance, "oil_temperature": "318.15" if i < 26 else "333.15"},
        )
        folder(tmp_path / f"night-{i:03d}", made)
    found = eb.history(tmp_path)
    (event,) = found.events
    assert {trend.metric for trend in event.trends} == {"rise_time", "delay_time", "response_time"}
    said = event_sentence(event)
    assert "and 2 more metrics" in said
    assert "r25 → r26" in said
    assert "45.0 → 60.0 °C" in said
    content = json.loads(found.to_json())
    (told,) = content["events"]
    assert (told["now"], len(told["metrics"])) == (True, 3)
    assert (told["before"]["revision"], told["since"]["oil_temperature"]) == ("r25", 333.15)
    page = (tmp_path / "history" / "index.html").read_text(encoding="utf-8")
    assert "and 2 more" in page
    assert page.count('class="heat"') == 4


def test_nights_are_in_the_order_of_their_recordings(tmp_path: Path) -> None:
    for i, value in enumerate((3.0, 1.0, 2.0)):
        made = result([value], started=(FIRST + timedelta(days=i)).isoformat())
        recorded = (FIRST - timedelta(days=int(10 - value))).isoformat()
        made = replace(made, provenance={**made.provenance, "recorded": recorded})
        folder(tmp_path / f"{i}", made)
    assert eb.history(tmp_path).trends[0].values.tolist() == [1.0, 2.0, 3.0]


def test_a_limit_beyond_the_plot_is_told_and_not_drawn(tmp_path: Path) -> None:
    nights(tmp_path, steady(20), limit="-12.5 s .. 900 s")
    eb.history(tmp_path)
    (page,) = (tmp_path / "history" / "trends").glob("*.html")
    text = page.read_text(encoding="utf-8")
    assert "↑ accepted ≤ 900\xa0s<" in text
    assert "↓ accepted ≥ −12.5\xa0s<" in text
    assert 'stroke-dasharray="8 3 2 3"' not in text


def test_limits_are_drawn_and_steps_are_upright(tmp_path: Path) -> None:
    values = steady(40)
    values[20:] = [1.2 * value for value in values[20:]]
    nights(tmp_path, values, limit="<= 1.4 s")
    found = eb.history(tmp_path)
    assert found.trends[0].bounds == (-math.inf, 1.4)
    (page,) = (tmp_path / "history" / "trends").glob("*.html")
    text = page.read_text(encoding="utf-8")
    assert "accepted ≤" in text
    ((change,),) = [trend.course.changes for trend in found.trends]
    path = re.search(r'<path d="(M[^"]+)" fill="none" stroke="var\(--blue\)" stroke-w', text)
    assert path is not None
    points = [part.split() for part in re.split("[ML]", path[1])[1:]]
    assert len(points) == 4
    assert points[1][0] == points[2][0]  # up, not across
    assert change.start == 20


def test_an_index_of_the_first_version_keeps_its_runs(tmp_path: Path) -> None:
    nights(tmp_path, steady(9))
    eb.history(tmp_path)
    with closing(sqlite3.connect(tmp_path / "history" / "index.sqlite")) as database, database:
        database.executescript(
            "ALTER TABLE runs DROP COLUMN oil_temperature;"
            "ALTER TABLE scores DROP COLUMN spread;"
            "ALTER TABLE scores DROP COLUMN open; PRAGMA user_version = 1;"
        )
    (tmp_path / "night-003" / "result.json").unlink()
    assert len(eb.history(tmp_path).nights) == 9


@pytest.mark.parametrize(
    ("newest", "side", "state"),
    [
        ([1.0], "above", "cut off by the sensor"),  # at least as high as ever is not 'steady'
        ([0.7] * 3, "above", "cut off by the sensor"),  # nor a fall
        ([1.3] * 3, "above", "stepped"),
        ([0.7] * 3, "", "stepped"),
    ],
)
def test_a_clipped_night_shows_only_what_it_can(
    tmp_path: Path, newest: list[float], side: str, state: str
) -> None:
    values = [*steady(), *newest]
    for i, value in enumerate(values):
        started = (FIRST + timedelta(days=i)).isoformat()
        more = {"clipped": "yes"} if side and i >= 30 else {}
        made = result([value], "overshoot", started=started, **more)
        folder(tmp_path / f"night-{i:03d}", made)
    found = eb.history(tmp_path)
    (trend,) = json.loads(found.to_json())["trends"]
    assert trend["state"] == state
    assert trend.get("open", []) == ([""] * 30 + [side] * len(newest) if side else [])
    assert found.exit_status() == int(state == "stepped")
    if state.startswith("cut off"):
        assert "the sensor's end cut off the newest value of it" in headline(found)
        page = (tmp_path / "history" / "index.html").read_text(encoding="utf-8")
        assert "cut off by the sensor" in page


def test_an_index_of_the_second_version_keeps_its_runs(tmp_path: Path) -> None:
    nights(tmp_path, steady(9))
    eb.history(tmp_path)
    with closing(sqlite3.connect(tmp_path / "history" / "index.sqlite")) as database, database:
        database.executescript("ALTER TABLE scores DROP COLUMN open; PRAGMA user_version = 2;")
    (tmp_path / "night-003" / "result.json").unlink()
    assert len(eb.history(tmp_path).nights) == 9


def test_an_empty_folder_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no result"):
        eb.history(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        eb.history(tmp_path / "nothing")


@pytest.mark.parametrize("runs", [1, 5, 7])
def test_of_too_few_runs_nothing_is_said(tmp_path: Path, runs: int) -> None:
    nights(tmp_path, [*steady(runs - 1), 1.5])
    found = eb.history(tmp_path)
    content = json.loads(found.to_json())
    assert found.exit_status() == 0
    assert content["status"] == "undecided"
    assert (content["too_few"], content["fewest_nights"]) == (1, 8)
    said = "too few runs to judge it (8 are needed)."
    assert headline(found).endswith(said)
    page = (tmp_path / "history" / "index.html").read_text(encoding="utf-8")
    assert said in page
    assert "Too few runs yet" in page
    assert "none drifted" not in page


def test_of_enough_runs_it_is_said_which_cannot_be_judged(tmp_path: Path) -> None:
    nights(tmp_path, [*steady(7), 1.5], target="old")
    nights(tmp_path, steady(3), target="new")
    found = eb.history(tmp_path)
    assert json.loads(found.to_json())["status"] == "drifted"
    assert headline(found) == (
        "11 runs, 2 metrics: 1 drifted (1 for the worse); "
        "too few runs to judge 1 of them (8 of the same suite and target are needed)."
    )


def test_what_drifted_adds_up() -> None:
    def drifted(*worse: bool | None) -> str:
        trends = [SimpleNamespace(worse=item) for item in worse]
        history = SimpleNamespace(
            drifted=trends, trends=trends, nights=[None] * 9, of=lambda _: [], causes=None
        )
        return headline(cast(History, history))

    assert drifted(True, False, None) == (
        "9 runs, 3 metrics: 3 drifted (1 for the worse, 1 for the better, 1 with no better side)."
    )
    assert drifted(None, None) == "9 runs, 2 metrics: 2 drifted."


def test_a_newest_run_without_values_is_not_steady(tmp_path: Path) -> None:
    nights(tmp_path, [*steady(12), float("nan")])
    found = eb.history(tmp_path)
    assert json.loads(found.to_json())["status"] == "undecided"
    assert headline(found) == "13 runs, 1 metric: the newest run has no value of it."


def test_a_result_that_became_unreadable_counts_no_more(tmp_path: Path) -> None:
    nights(tmp_path, steady(10))
    assert len(eb.history(tmp_path).nights) == 10
    file = tmp_path / "night-004" / "result.json"
    whole = file.read_text(encoding="utf-8")
    file.write_text("{", encoding="utf-8")
    found = eb.history(tmp_path)
    assert (len(found.nights), len(found.problems)) == (9, 1)
    file.write_text(whole, encoding="utf-8")
    assert len(eb.history(tmp_path).nights) == 10


def test_results_within_a_result_are_no_runs_of_their_own(tmp_path: Path) -> None:
    """An A/B run keeps the result of every trial below that of each side."""
    folder(tmp_path / "ab" / "a", result([1.0]))
    folder(tmp_path / "ab" / "a" / "000-step", result([1.0]))
    folder(tmp_path / "alone", result([1.0]))
    found = eb.history(tmp_path)
    assert sorted(night.path for night in found.nights) == [
        "ab/a/result.json", "alone/result.json",
    ]  # fmt: skip

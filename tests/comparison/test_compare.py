"""Verdicts, and what must not be compared silently."""

import json
import math
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eha_bench as eb
from eha_bench.bench.store import set_aside
from eha_bench.comparison.compare import compare_sides
from eha_bench.comparison.comparison import Compared, Comparison
from eha_bench.comparison.direction import direction_of
from eha_bench.comparison.sequential import shares
from eha_bench.comparison.side import Side, load_side
from eha_bench.comparison.verdict import ComparisonVerdict
from eha_bench.core.errors import InputError
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure
from eha_bench.report.comparison_markdown import comparison_markdown
from eha_bench.report.comparison_report import repeats_needed, write_comparison
from eha_bench.report.comparison_rows import row_of

sys.path.insert(0, str(Path(__file__).parent))
from results import folder, result, score

BASE = list(1.0 + 0.004 * np.random.default_rng(5).normal(size=8))


@pytest.fixture
def rng() -> np.random.Generator:
    """Draws of a test's own: those of others, and their order, change nothing in them."""
    return np.random.default_rng(7)


def side(content: Result) -> Side:
    return Side("made up", ((content, Path()),))


def compare(baseline: Result, candidate: Result, **options: bool) -> Comparison:
    return compare_sides(side(baseline), side(candidate), **options)


def only(found: Comparison) -> Compared:
    assert len(found.items) == 1
    return found.items[0]


@pytest.mark.parametrize(
    ("factor", "metric", "expected"),
    [
        (1.10, "rise_time", ComparisonVerdict.WORSE),
        (0.90, "rise_time", ComparisonVerdict.BETTER),
        (1.0, "rise_time", ComparisonVerdict.SAME),
        (1.10, "bandwidth_3db", ComparisonVerdict.BETTER),
        (1.10, "amplitude_ratio", ComparisonVerdict.WORSE),
        (1.10, "peak", ComparisonVerdict.CHANGED),
        (1.10, "metric_of_another_house", ComparisonVerdict.CHANGED),
    ],
)
def test_the_verdict_follows_the_metric(
    factor: float, metric: str, expected: ComparisonVerdict, rng: np.random.Generator
) -> None:
    other = [factor * value for value in 1.0 + 0.004 * rng.normal(size=8)]
    found = compare(result(BASE, metric), result(other, metric))
    assert only(found).verdict is expected
    assert found.exit_status == int(expected is ComparisonVerdict.WORSE)
    json.loads(found.to_json())


def test_a_limit_tells_the_direction_of_an_unknown_metric() -> None:
    worse = [1.1 * value for value in BASE]
    for limit, verdict in (
        ("<= 2 s", ComparisonVerdict.WORSE),
        (">= 0.5 s", ComparisonVerdict.BETTER),
    ):
        found = compare(result(BASE, "own", limit=limit), result(worse, "own", limit=limit))
        assert only(found).verdict is verdict


@pytest.mark.parametrize(
    ("limit", "aim"),
    [
        ("0.5 s .. 2 s", 1.25),
        ("1 s +- 0.2 s", 1.0),
        ("95 % .. 105 % of baseline (0.04 s)", math.nan),
        ("<= 2 s", math.nan),
        ("", math.nan),
    ],
)
def test_a_limit_on_both_sides_is_aimed_at_its_middle(limit: str, aim: float) -> None:
    assert direction_of("own", "s", limit).aim == pytest.approx(aim, nan_ok=True)


def test_the_suite_says_what_matters() -> None:
    slower = [1.05 * value for value in BASE]
    assert only(compare(result(BASE), result(slower))).verdict is ComparisonVerdict.WORSE
    found = compare(result(BASE, matters="10 %"), result(slower, matters="10 %"))
    assert only(found).verdict is ComparisonVerdict.SAME
    assert only(found).margin == pytest.approx(0.1 * np.mean(BASE))


def test_undecided_says_how_many_more_repeats(rng: np.random.Generator) -> None:
    noisy = list(1.0 + 0.3 * rng.normal(size=4))
    other = list(1.25 + 0.3 * rng.normal(size=4))
    item = only(compare(result(noisy, matters="2 %"), result(other, matters="2 %")))
    assert item.verdict is ComparisonVerdict.UNDECIDED
    assert item.more_repeats is None or item.more_repeats > 0


def test_one_run_on_each_side_decides_nothing() -> None:
    found = compare(result([0.0400]), result([0.0500]))
    item = only(found)
    assert item.verdict is ComparisonVerdict.UNDECIDED
    assert item.reason == "one run a side"
    assert found.exit_status == 0
    assert "one run a side" in comparison_markdown(found).lower()
    assert "one run a side" in row_of(item).note.lower()


@pytest.mark.parametrize("values", [[0.04], [0.04, 0.05], [3.0, 7.0, 1.0], [0.0] * 4, BASE])
def test_a_result_is_the_same_as_itself(values: list[float]) -> None:
    for matters in ("", "0 s"):
        item = only(compare(result(values, matters=matters), result(values, matters=matters)))
        assert item.verdict is ComparisonVerdict.SAME
        assert "identical" in item.method


@pytest.mark.parametrize(
    ("factor", "clipped", "expected"),
    [
        (0.9, "candidate", ComparisonVerdict.UNDECIDED),  # at least 0.9 may be more than 1
        (1.1, "candidate", ComparisonVerdict.WORSE),
        (1.0, "candidate", ComparisonVerdict.UNDECIDED),
        (0.9, "baseline", ComparisonVerdict.BETTER),
        (1.1, "baseline", ComparisonVerdict.UNDECIDED),
        (1.1, "both", ComparisonVerdict.UNDECIDED),
    ],
)
@pytest.mark.parametrize("scatter", [True, False])
def test_what_is_clipped_decides_only_what_it_can(
    factor: float, clipped: str, expected: ComparisonVerdict, scatter: bool
) -> None:
    base = BASE if scatter else [1.0] * 4
    options = [
        {"clipped": "yes"} if clipped in (name, "both") else {}
        for name in ("baseline", "candidate")
    ]
    found = compare(
        result(base, "overshoot", **options[0]),
        result([factor * value for value in reversed(base)], "overshoot", **options[1]),
    )
    item = only(found)
    assert item.verdict is expected
    assert "cut off by the sensor's end in the" in item.reason
    assert clipped == "both" or clipped in item.reason
    assert item.cut_off
    entry = json.loads(found.to_json())["metrics"][0]
    assert None in (entry["low"], entry["high"])
    said = "More repeats would be cut off as well"
    assert (said in row_of(item).note) == (expected is ComparisonVerdict.UNDECIDED)
    assert ("more repeats would" in repeats_needed(found)) == (
        expected is ComparisonVerdict.UNDECIDED
    )


def test_a_clipped_result_is_the_same_as_itself() -> None:
    both = [result(BASE, "overshoot", clipped="yes") for _ in range(2)]
    assert only(compare(*both)).verdict is ComparisonVerdict.SAME


def test_deterministic_repeats_are_named() -> None:
    for factor, verdict in ((1.1, ComparisonVerdict.WORSE), (1.001, ComparisonVerdict.SAME)):
        item = only(compare(result([0.04] * 3), result([factor * 0.04] * 3)))
        assert item.verdict is verdict
        assert "deterministic" in item.method
    # one metric that does not scatter among others that do is only rounded
    rounded = [replace(result([value] * 3), trials=()) for value in (1.0, 2.0)]
    sides = []
    for content, value in zip(rounded, (1.0, 2.0), strict=True):
        runs = tuple(
            TrialResult("step", i, Status.PASSED, "", "",
                        (replace(score("rise_time", value), measure=Measure(value)),
                         score("peak_time", 0.1 * value + 0.01 * i)))
            for i in range(3)
        )  # fmt: skip
        sides.append(replace(content, trials=runs))
    found = compare(*sides)
    assert {item.metric: item.verdict for item in found.items}[
        "rise_time"
    ] is ComparisonVerdict.UNDECIDED


def test_what_matters_does_not_grow_with_the_scatter(rng: np.random.Generator) -> None:
    for scatter in (0.001, 0.1):
        noisy = list(1.0 + scatter * rng.normal(size=6))
        item = only(compare(result(noisy), result(noisy[::-1])))
        assert item.margin == pytest.approx(0.02 * np.mean(noisy))
    near_zero = only(compare(
        result(BASE, "steady_state_error", unit="Pa"), result(BASE, "steady_state_error", unit="Pa")
    ))  # fmt: skip
    assert near_zero.margin == pytest.approx(50_000.0)


def test_a_difference_that_need_not_matter_is_not_worse() -> None:
    other = [1.021 * value for value in BASE]
    item = only(compare(result(BASE), result(other)))
    assert item.difference > item.margin > item.low
    assert item.verdict is ComparisonVerdict.UNDECIDED
    assert "may be smaller than what matters" in item.reason


def test_repeats_that_are_alike_are_said() -> None:
    rng = np.random.default_rng(4)
    walks = [list(10.0 + np.cumsum(rng.normal(size=20))) for _ in range(2)]
    item = only(compare(result(walks[0], matters="0 s"), result(walks[1], matters="0 s")))
    assert item.verdict is ComparisonVerdict.UNDECIDED
    assert "neighbouring repeats are correlated" in item.reason


def test_what_a_side_of_pairs_loses_is_worse() -> None:
    values = [*BASE, *BASE, *BASE[:4]]
    lost = [math.nan if i % 9 < 5 else value for i, value in enumerate(values)]
    found = compare_sides(side(result(values)), side(result(lost)), looks=shares(20))
    item = only(found)
    assert item.verdict is ComparisonVerdict.WORSE
    assert item.reason == "not scored any more (not scored: 12 of 20 in the candidate)"


def test_what_is_lost_is_worse() -> None:
    lost = result([math.nan] * 8, reason="not settled")
    found = only(compare(result(BASE), lost))
    assert found.verdict is ComparisonVerdict.WORSE
    assert "not settled" in found.reason
    single = only(compare(result(BASE[:1]), result([math.nan], reason="not settled")))
    assert single.verdict is ComparisonVerdict.UNDECIDED
    assert "not settled" in single.reason
    assert only(compare(lost, lost)).verdict is ComparisonVerdict.NOT_COMPARED


def test_other_targets_are_refused_unless_meant() -> None:
    rig = result(BASE, target="can:rig-1")
    with pytest.raises(InputError, match="not the same rig"):
        compare(result(BASE), rig)
    found = compare(result(BASE), rig, across_targets=True)
    assert any("Different targets" in caveat for caveat in found.caveats)
    assert only(found).verdict is ComparisonVerdict.SAME
    # models are what is compared, on one simulator
    compare(result(BASE), result(BASE, target="simulator:revised"))


def test_other_hosts_of_a_rig_are_said() -> None:
    found = compare(
        result(BASE, target="can", host="bench-1"), result(BASE, target="can", host="bench-2")
    )
    assert any("bench-2" in caveat for caveat in found.caveats)


def test_another_version_of_the_suite_is_compared_only_where_the_trial_is_the_same() -> None:
    old, new = result(BASE, suite_sha256="1"), result(BASE, suite_sha256="2")
    found = compare(old, new)
    assert only(found).verdict is ComparisonVerdict.NOT_COMPARED
    assert found.exit_status == 2
    assert any("versions of the suite" in caveat for caveat in found.caveats)
    same = compare(
        result(BASE, suite_sha256="1", definition="x"),
        result(BASE, suite_sha256="2", definition="x"),
    )
    assert only(same).verdict is ComparisonVerdict.SAME
    changed = compare(result(BASE, definition="x"), result(BASE, definition="y"))
    assert only(changed).verdict is ComparisonVerdict.NOT_COMPARED


def test_missing_trials_and_mixed_units_are_said() -> None:
    both = result(BASE)
    more = replace(both, trials=(*both.trials, *result(BASE, trial="sine").trials))
    found = compare(more, both)
    assert any("sine is missing in the candidate" in caveat for caveat in found.caveats)
    assert [item.verdict for item in found.items] == [
        ComparisonVerdict.SAME,
        ComparisonVerdict.NOT_COMPARED,
    ]
    mixed = compare(result(BASE), result(BASE, unit="ms"))
    assert only(mixed).verdict is ComparisonVerdict.NOT_COMPARED
    assert "'ms'" in only(mixed).reason


def test_runs_that_came_to_no_end_are_left_out() -> None:
    faulty = result(BASE)
    stopped = TrialResult("step", 9, Status.FAULT, "", "", (score("rise_time", 9.0),), reason="x")
    found = compare(result(BASE), replace(faulty, trials=(*faulty.trials, stopped)))
    assert only(found).verdict is ComparisonVerdict.SAME
    assert any("did not finish" in caveat for caveat in found.caveats)


def test_several_results_are_repeats(tmp_path: Path) -> None:
    for i in range(4):
        folder(tmp_path / "a" / str(i), result(BASE[2 * i : 2 * i + 2]))
    found = eb.compare(tmp_path / "a", tmp_path / "a", tmp_path / "out")
    assert only(found).baseline.runs == 8
    for name in ("comparison.html", "comparison.json", "comparison.md"):
        assert (tmp_path / "out" / name).stat().st_size > 100


def test_results_by_older_versions_and_odd_ones_are_read(tmp_path: Path) -> None:
    old = tmp_path / "result.json"
    runs = [
        {"id": "t", "status": "passed", "scores": [
            {"metric": "made_up", "value": value, "status": "passed"},
            {"metric": "empty", "value": None, "low": None, "status": "not_scored"},
        ]}
        for value in (1.0, 1.1, float("nan"))
    ]  # fmt: skip
    content = {"schema_version": 1, "suite": "s", "target": "t", "status": "passed", "trials": runs}
    old.write_text(json.dumps(content), encoding="utf-8")
    found = eb.compare(old, old, tmp_path / "out")
    assert {item.metric for item in found.items} == {"made_up", "empty"}


def test_a_run_that_was_set_aside_is_no_repeat_of_the_one_in_its_place(tmp_path: Path) -> None:
    night = folder(tmp_path / "night", result([1.0, 1.1]))
    old = set_aside(night)
    # as long as nothing has taken its place it is the only result there is
    assert [at for _, at in load_side(tmp_path).results] == [old]
    folder(night, result([2.0, 2.1, 2.2]))
    folder(tmp_path / "2026-11-22_18-00-00", result([2.3]))
    side = load_side(tmp_path)
    assert len(side.runs["step"]) == 4
    assert side.left_out == (old,)
    assert any(old.name in caveat for caveat in compare_sides(side, side).caveats)
    # named by itself it is what is meant
    assert len(load_side(old).runs["step"]) == 2


def test_there_must_be_a_result(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such result"):
        load_side(tmp_path / "nothing")
    with pytest.raises(InputError, match=r"holds no result\.json"):
        load_side(tmp_path)


def _written(trials: object) -> bytes:
    content = {"schema_version": 1, "suite": "s", "target": "t", "status": "passed"}
    return json.dumps(content | {"trials": trials}).encode()


def _scored(**measure: object) -> bytes:
    score = {"metric": "made_up", "status": "passed", **measure}
    return _written([{"id": "t", "status": "passed", "scores": [score]}])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"{", "not a result"),
        (b"[1, 2]", "schema version"),
        (b'{"schema_version": 99}', "schema version 99"),
        (b"\xff\xfe\x00\x01", "not a result"),
        (_written(3), "trials: not a list"),
        (_written(["x"]), r"trials\[0\]: an entry of a wrong type"),
        (_written([{"id": "t"}]), r"trials\[0\]: 'status' is missing"),
        (
            _written([{"id": "t", "status": "passed"}, {"id": "t", "status": "fine"}]),
            r"trials\[1\]: 'fine' is not a valid Status",
        ),
        (_scored(value="fast"), r"trials\[0\]: scores\[0\]: 'fast' is not a number"),
        (_scored(value=[1.0]), r"trials\[0\]: scores\[0\]: \[1\.0\] is not a number"),
        (_scored(), r"trials\[0\]: scores\[0\]: 'value' is missing"),
    ],
)
def test_a_damaged_side_is_an_error_that_names_it(
    content: bytes, said: str, tmp_path: Path
) -> None:
    good = folder(tmp_path / "good", result(BASE))
    damaged = tmp_path / "baseline.json"
    damaged.write_bytes(content)
    for sides in ((damaged, good), (good, damaged)):
        with pytest.raises(InputError, match=said) as caught:
            eb.compare(*sides)
        assert "baseline.json" in str(caught.value)
        assert "Error(" not in str(caught.value)


def test_names_in_a_result_are_text_on_the_page(tmp_path: Path) -> None:
    odd = result(BASE, "<script>alert(1)</script>", trial="<b>x</b>")
    folder(tmp_path / "a", odd)
    eb.compare(tmp_path / "a", tmp_path / "a", tmp_path / "out")
    page = (tmp_path / "out" / "comparison.html").read_text(encoding="utf-8")
    assert "<script>alert(1)" not in page
    assert "<b>x</b>" not in page


@pytest.mark.slow(15)
def test_no_difference_is_called_one_in_at_most_five_per_cent() -> None:
    rng = np.random.default_rng(11)
    for repeats in (3, 6):
        wrong = 0
        for _ in range(150):
            both = []
            for _ in range(2):
                runs = tuple(
                    TrialResult("t", i, Status.PASSED, "", "", tuple(
                        score(f"m{j}", 10.0 + value, limit="<= 1 s") for j, value in enumerate(row)
                    ))
                    for i, row in enumerate(rng.normal(size=(repeats, 15)))
                )  # fmt: skip
                both.append(Result("s", "t", Status.PASSED, runs))
            found = compare(*both)
            wrong += bool(found.of(ComparisonVerdict.WORSE, ComparisonVerdict.BETTER))
        # 150 at 5 %: 14 or more by chance once in 60
        assert wrong < 14


def test_rows_of_a_trial_and_an_aspect_stand_together(tmp_path: Path) -> None:
    item = Compared("a", "", "x", "s", verdict=ComparisonVerdict.WORSE, margin=1.0)
    items = tuple(
        replace(item, trial=trial, metric=metric, difference=size)
        for trial, metric, size in (
            ("a", "rise_time", 9.0), ("b", "overshoot", 8.0), ("a", "overshoot", 7.0),
            ("a", "peak_time", 6.0), ("b", "rise_time", 5.0), ("b", "settling_time", 4.0),
        )
    )  # fmt: skip
    empty = Side("s", ((result([1.0]), tmp_path),))
    page = write_comparison(tmp_path, Comparison(empty, empty, items)).read_text("utf-8")
    table = page.partition("What changed, by trial and aspect")[2].partition("</table>")[0]
    shown = re.findall(r'class="aspect">(\w[\w ]*)<|class="name">([^<]+)<', table)
    assert [aspect or name for aspect, name in shown] == [
        "Speed", "Rise time (10–90 %)", "Peak time", "Damping", "Overshoot",
        "Damping", "Overshoot", "Settling time (2 %)", "Speed", "Rise time (10–90 %)",
    ]  # fmt: skip


def test_two_sides_that_differ_in_nothing_else_need_no_caveat() -> None:
    origin = {"suite_sha256": "a", "host": "bench-1", "version": "1"}
    assert compare(result(BASE, **origin), result(BASE, **origin)).caveats == ()

"""Thresholds of a verdict: complete, each with its source, and the page says what the code has."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from pathlib import Path

import pytest
from benchmarks.thresholds import Nearest, concerned, moved, noted

from eha_bench.diagnosis.fit.evidence import Excess, Improvement
from eha_bench.diagnosis.fit.thresholds import DEFAULT, QUESTIONS, Thresholds

NAMES = [item.name for item in fields(Thresholds)]


def test_every_threshold_answers_one_question_and_has_a_source() -> None:
    assert sorted(NAMES) == sorted(name for names in QUESTIONS.values() for name in names)
    for item in fields(Thresholds):
        assert item.metadata["decides"]
        assert item.metadata["source"]


def test_the_page_has_the_values_of_the_code(repository: Path) -> None:
    page = (repository / "docs" / "thresholds.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| (\S+) \|", page, re.MULTILINE))
    assert rows == {name: f"{getattr(DEFAULT, name):g}" for name in NAMES}


@pytest.mark.parametrize(
    ("relative", "significance", "bursts", "unexplained", "look"),
    [
        (0.029, 50.0, 50.0, False, True),
        (0.031, 8.1, 0.0, True, True),
        (0.031, 7.9, 0.0, False, False),
        (0.99, 7.9, 0.0, False, False),  # few readings at twice the noise show less structure
        (1.01, 5.1, 0.0, True, True),
        (1.01, 4.9, 0.0, False, False),
        (0.21, 0.0, 8.1, True, False),
        (0.21, 0.0, 7.9, False, False),
        (0.019, 50.0, 0.0, False, False),
    ],
)
def test_when_something_is_missing(
    relative: float, significance: float, bursts: float, unexplained: bool, look: bool
) -> None:
    class Rest(Excess):
        @property
        def relative(self) -> float:
            return relative

    rest = Rest(1.0, 1000, significance, {}, bursts)
    assert DEFAULT.is_unexplained(rest) is unexplained
    assert DEFAULT.is_worth_a_look(rest) is look


def test_what_was_enough_stays_where_the_noise_is_told_otherwise() -> None:
    """A valve that opened in one of four runs: 98.4 % of the excess, then 79 %."""
    before = Improvement(8.1e4, 8.3e4, 0.984, 1.007, 5.7e-3, 1.0, 0.983)
    now = Improvement(9.0e4, 9.3e4, 0.79, 0.82, 7.1e-3, 1.0, 0.79)
    assert DEFAULT.allow(before)
    assert not DEFAULT.allow(now)
    assert DEFAULT.still_allow(now, before)
    assert not DEFAULT.still_allow(now, now), "it was never enough"
    assert not DEFAULT.still_allow(replace(now, p_value=0.2), before), "chance"
    assert not DEFAULT.still_allow(replace(now, share=0.4), before), "most is left"
    assert not DEFAULT.still_allow(replace(now, gain=20.0), before), "no gain"


def test_a_chance_gains_more_where_nothing_explains_what_is_left() -> None:
    assert DEFAULT.least_gain(Excess(-40.0, 1000, 0.0, {})) == 30.0
    left = Excess(5e4, 1000, 90.0, {})
    assert DEFAULT.least_gain(left) == pytest.approx(30.0 * (1.0 + left.relative))


def test_thresholds_note_what_they_are_compared_with() -> None:
    """They decide as plain numbers do, whether a figure is Python's or NumPy's."""
    import numpy as np

    watched, seen = noted()
    found = Improvement(60.0, 30.0, 0.5, np.float64(0.2), 1e-9, 1.0, 0.5)
    before = Excess(1e3, 1000, 90.0, {})
    assert watched.allow(found) is DEFAULT.allow(found) is True
    assert not watched.is_enough(found, before, 1)
    assert seen["gain"] == [2.0, 2.0]
    assert seen["share"] == [pytest.approx(0.8)]
    assert seen["p_value"] == [pytest.approx(1e-6)]
    assert not seen["explained"]


@pytest.mark.parametrize(
    ("relative", "p_value", "enough"),
    [(0.02, 9.5e-4, False), (0.02, 1e-4, True), (0.04, 9.5e-4, True)],
)
def test_the_luckiest_of_several_is_no_cause_where_noise_hides_what_is_missing(
    relative: float, p_value: float, enough: bool
) -> None:
    before = Excess(relative * 1e3, 1000, 90.0, {})
    assert before.relative == pytest.approx(relative, rel=0.2)
    found = Improvement(60.0, 60.0, 1.0, 1.0, p_value, 1.0, 1.0)
    assert DEFAULT.is_enough(found, before, 0) is enough


def test_a_recording_is_concerned_by_figures_between_a_threshold_and_its_multiple() -> None:
    found = {
        "A": {"share": Nearest(0.4, 1.9)},
        "B": {"share": Nearest(0.6, None), "gain": Nearest(None, 1.1)},
    }
    assert concerned(found, "share", moved("share", 0.5)) == ["B"]
    assert concerned(found, "share", moved("share", 2.0)) == ["A"]
    assert concerned(found, "gain", moved("gain", 2.0)) == ["B"]
    assert not concerned(found, "worse", moved("worse", 2.0))
    assert moved("worse", 2.0) == pytest.approx(1.1)
    assert moved("nearly_all", 0.5) == pytest.approx(0.9)

"""What the benchmark of next experiments counts as right, as wrong, and as left open."""

from __future__ import annotations

import pytest
from benchmarks.next_experiment import Case, rows_from, table


def case(
    named: tuple[str, ...], equivalent: tuple[str, ...] = (), *, stated: float = 0.96,
    rivals: tuple[str, ...] = ("current_lag", "command_delay"), breached: str = "",
) -> Case:  # fmt: skip
    ending = "proposed" if len(rivals) > 1 else ""
    return Case("servo", "current_lag", 0, rivals, ending, stated, 0.0, 2.0, 14.0, 5.0, named,
                equivalent, breached)  # fmt: skip


def test_a_single_right_name_is_right_and_a_single_other_one_is_wrong():
    assert case(("current_lag",)).right
    assert not case(("current_lag",), ("current_lag", "command_delay")).right
    assert case(("command_delay",)).wrong
    assert not case(("command_delay",), ("current_lag", "command_delay")).wrong
    assert not case(()).wrong


def test_figures_are_of_proposals_only():
    cases = [
        case(("current_lag",)),
        case(("command_delay",), stated=0.91),
        case((), ("current_lag", "command_delay"), stated=0.55, breached="angle in part_1"),
        case(("current_lag",), rivals=("current_lag",)),
    ]
    figures, lines = table(cases)
    assert (figures["cases"], figures["ambiguous"], figures["proposed"]) == (4, 3, 3)
    assert figures["right single name"] == pytest.approx(1 / 3)
    assert figures["wrong name"] == pytest.approx(1 / 3)
    assert figures["limits broken"] == 1
    bins = {item["from"]: item for item in figures["stated and happened"]}
    assert bins[0.9]["cases"] == 2
    assert bins[0.9]["happened"] == 0.5
    assert bins[0.5]["happened"] == 0.0
    assert "BROKE" in lines[2]
    verdicts = {row.figure: row.verdict for row in rows_from(figures)}
    assert verdicts["the one name left is right"] == "missed"
    assert verdicts["limits broken by proposals"] == "missed"
    assert verdicts["bench time of a proposal, median"] == "met"

"""What the benchmark of next experiments counts as right, as wrong, and as left open."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from benchmarks.experiment_cases import Case, Ended, Truth, broken
from benchmarks.experiment_rigs import KNEE, SAFETY, rigs_of, scaled
from benchmarks.next_experiment import rows_from, table
from benchmarks.safe_proposals import Asked

from eha_bench.suites import load_suite

LAG = Truth("current_lag", ("current",))
BOTH = ("current_lag", "command_delay")


def case(
    *causes: str,
    verdict: str = "effect",
    stated: float = 0.96,
    before: tuple[str, ...] = BOTH,
    breached: str = "",
    others: dict[str, Ended] | None = None,
    others_stated: dict[str, float] | None = None,
) -> Case:
    ending = "proposed" if len(before) > 1 else ""
    return Case(
        "servo", LAG, 0, Ended("effect", before), ending, stated, 0.0, 2.0, 14.0, 5.0,
        Ended(verdict, causes), breached, others or {}, others_stated or {},
    )  # fmt: skip


def test_a_single_right_name_is_right_and_a_single_other_one_is_wrong():
    assert case("current_lag").right
    assert not case(*BOTH).right
    assert case("command_delay").wrong
    assert case("command_delay+current_deadband").wrong
    assert not case(*BOTH).wrong
    assert not case("none", verdict="none").wrong


def test_a_curve_of_what_the_hidden_effect_follows_is_right_and_no_other():
    assert case("learned of current", verdict="unknown").right
    assert not case("learned of motor_speed", verdict="unknown").right
    assert not case("learned of motor_speed", verdict="unknown").wrong


def test_figures_are_of_proposals_only():
    by_chance = {"by chance": Ended("effect", BOTH)}
    cases = [
        case("current_lag", others=by_chance, others_stated={"by chance": 0.22}),
        case("command_delay", stated=0.91),
        case(*BOTH, stated=0.55, breached="angle in part_1"),
        case("current_lag", before=("current_lag",)),
        case("command_delay", before=("command_delay", "current_deadband"), stated=0.99),
    ]
    figures, lines = table(cases)
    assert (figures["cases"], figures["ambiguous"], figures["proposed"]) == (5, 4, 4)
    assert figures["right single name"] == pytest.approx(1 / 4)
    assert figures["wrong name"] == pytest.approx(2 / 4)
    # where the hidden cause is no rival, nothing was stated of it
    assert figures["hidden cause among the rivals"] == 3
    assert figures["right single name, of these"] == pytest.approx(1 / 3)
    bins = {item["from"]: item for item in figures["stated and happened"]}
    assert bins[0.9]["experiments"] == 2
    assert bins[0.9]["happened"] == 0.5
    assert bins[0.5]["happened"] == 0.0
    # experiments planned in other ways count as well
    assert (bins[0.2]["stated"], bins[0.2]["happened"]) == (0.22, 0.0)
    assert figures["by chance"] == {
        "cases": 1, "right single name": 0.0, "wrong name": 0.0, "the proposals of these": 1.0,
    }  # fmt: skip
    assert "BROKE" in lines[2]
    again = [Asked("a", 1, 1.0, "proposed", 0.9, "", "angle in part_1"),
             Asked("a", 2, 0.5, "none_permitted", np.nan, "", "")]  # fmt: skip
    verdicts = {row.figure: row.verdict for row in rows_from(figures, again)}
    assert verdicts["the one name left is right"] == "missed"
    assert verdicts["limits broken by proposals"] == "missed"
    assert verdicts["limits broken by further proposals"] == "met"
    assert verdicts["the same with a second effect that no rival holds"] == "missed"
    assert verdicts["bench time of a proposal, median"] == "met"


def test_a_kept_case_is_read_as_it_was(tmp_path: Path):
    by_chance = {"by chance": Ended("effect", BOTH)}
    one = case("current_lag", others=by_chance, others_stated={"by chance": 0.3})
    file = tmp_path / "case.json"
    file.write_text(json.dumps(asdict(one)))
    assert Case.read(file) == one


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["geared_servo", KNEE])
def test_a_machine_runs_a_trial_and_a_limit_that_it_breaks_is_told(plant: str, tmp_path: Path):
    machine = rigs_of(plant, foreign=False)["current_lag"]
    rig = machine(0)
    rig.record_first(tmp_path)
    (tmp_path / "safe.yaml").write_text(rig.safety(plant))
    limits = load_suite(tmp_path / "safe.yaml").trials[0]
    big, piston = ("0.6", "free") if rig.mode == "duty" else ("30 A", "locked")
    suite = load_suite({"name": "try", "trials": [
        {"id": "big", "mode": rig.mode, "duration": "1 s", "setup": {"piston": piston},
         "signal": {"kind": "constant", "value": big}}]})  # fmt: skip
    row, read = rig.perform(suite.trials[0], tmp_path / "big")
    assert (tmp_path / row.split("log: ")[1].split(",")[0]).exists()
    assert broken(suite.trials[0], read, limits)
    quiet = {name: np.zeros_like(values) for name, values in read.items()}
    assert broken(suite.trials[0], quiet, limits) == ""
    before = {name: values.copy() for name, values in read.items()}
    rig.also(1)
    _, with_another = rig.perform(suite.trials[0], tmp_path / "again")
    assert any(np.abs(with_another[name] - before[name]).max() > 0.0 for name in before)


def test_limits_are_scaled_with_their_units():
    assert scaled("{angle: -2.5 rad .. 2.5 rad, p: <= 12 MPa}", 0.5) == (
        "{angle: -1.25 rad .. 1.25 rad, p: <= 6 MPa}"
    )
    assert set(SAFETY) == {KNEE, "geared_servo", "valve_cylinder", "single_rod_eha"}

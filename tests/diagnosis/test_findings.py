"""What a finished search found: effects with intervals, the ranking, and the sentences."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from known_search import LinearProblem, add, assumed, model, search_of, shape

from eha_bench.diagnosis.fit.evidence import NOT_COMPARED
from eha_bench.diagnosis.fit.own_parameters import LateClock, Places, RunParameter
from eha_bench.diagnosis.fit.uncertainty import Estimate
from eha_bench.diagnosis.outcome.decide import Decision
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis, Verdict
from eha_bench.diagnosis.outcome.findings import (
    _value_notes,
    assemble,
    lateness_estimates,
    lateness_notes,
    own_estimates,
)
from eha_bench.diagnosis.search.state import RankedCandidate, Refit, Search
from eha_bench.plants.model import load_model

MASS, FRICTION, LAG = "mass", "coulomb_friction", "current_lag"
TRUTH = {MASS: 97.0, "coulomb_friction.friction_force": 7.0, "current_lag.time_constant": 0.004}


def finished_search(*added: str, **truth: float) -> Search:
    """A search over readings in which the true effects show, with some of them added."""
    slopes = {MASS: shape(0.0), "coulomb_friction.friction_force": 4.0 * shape(1.0),
              "current_lag.time_constant": 3e3 * shape(2.0)}  # fmt: skip
    problem: Any = LinearProblem(slopes, TRUTH | truth)
    search = search_of(problem, MASS)
    for name in added:
        add(search, name)
    return search


def found(search: Search, verdict: Verdict = Verdict.EFFECT, *notes: str) -> Diagnosis:
    dataset: Any = SimpleNamespace(model=model(), misread=())
    base: Any = SimpleNamespace(
        keys=(MASS,), nuisance=(), notes=("of the gate",), starts=1, agreed=1, measured=()
    )
    return assemble(dataset, base, search, Decision(verdict, search.fit, notes, None))


def test_effects_stand_with_intervals_around_the_truth_the_strongest_first() -> None:
    search = finished_search(FRICTION, LAG)
    search.accepted.reverse()
    result = found(search)
    assert result.verdict is Verdict.EFFECT
    assert [item.id for item in result.effects] == [FRICTION, LAG]
    for item, name in zip(result.effects, ("friction_force", "time_constant"), strict=True):
        value = item.parameters[name]
        truth = TRUTH[f"{item.id}.{name}"]
        assert value.low < truth < value.high
        assert value.high - value.low < 0.1 * truth
        assert item.p_value < 1e-3
    assert [item.equation for item in result.effects] == ["force", "actuation"]
    mass = result.calibrated[MASS]
    assert mass.low < 97.0 < mass.high
    assert mass.unit == "kg"


def test_the_revised_model_holds_what_was_found_and_the_recalibrated_one_does_not() -> None:
    search = finished_search(FRICTION, LAG)
    result = found(search)
    assert {item.id for item in result.revised.effects} == {FRICTION, LAG}
    assert result.revised.parameters[MASS] == pytest.approx(97.0, rel=0.01)
    assert result.recalibrated.effects == ()
    at = model().plant.layout.index[MASS]
    assert result.recalibrated.parameters[MASS] == search.base.vector[at]


def test_no_verdict_names_no_effect() -> None:
    result = found(finished_search(FRICTION, LAG), Verdict.NONE)
    assert result.effects == ()


def test_notes_are_those_of_the_gate_then_of_the_decision() -> None:
    search = finished_search(FRICTION, LAG)
    search.accepted.append(assumed("voltage_limit"))
    notes = found(search, Verdict.EFFECT, "of the decision").notes
    assert notes[0] == "of the gate"
    assert notes[1] == "voltage_limit is only assumed in the model; the data ask for 1000 V"
    assert notes[2] == "of the decision"


def test_a_number_that_several_parts_were_declared_with_is_asked_for_once(repository: Path) -> None:
    """Each of two areas had a sentence of its own, with the same number."""
    closed = load_model({"model": str(repository / "suites/plants/single_rod_eha.yaml")})
    layout, areas = closed.plant.layout, ("cylinder.area_a", "cylinder.area_b")
    places = [layout.index[key] for key in areas]
    declared = replace(closed, parameters=dict.fromkeys(areas, 8e-4))
    fit: Any = SimpleNamespace(vector=declared.vector())
    fit.vector[places] = 8.5e-4
    (note,) = _value_notes(declared, fit, [areas])
    said = "CAUTION: cylinder.area_a and cylinder.area_b are declared as 0.0008 m^2, and not calib"
    assert note.startswith(said)
    assert "the data ask for 0.00085 m^2 of both, which explains as much" in note
    assert note.endswith("correct them, or list them under `calibrate`")
    fit.vector[places[1]] = 8.6e-4
    assert (
        "the data ask for 0.00085 and 0.00086 m^2, which" in _value_notes(declared, fit, [areas])[0]
    )
    assert len(_value_notes(declared, fit, [areas[:1], areas[1:]])) == 2


def test_what_is_smaller_than_its_log_tells_is_noted_unless_it_was_added_after_all() -> None:
    search = finished_search(FRICTION, LAG)
    search.too_small |= {LAG: "it was too short", "backlash": "its gap is within the noise"}
    said = [note for note in found(search).notes if "not taken for an effect" in note]
    (note,) = said
    assert note.startswith("backlash was not taken for an effect")
    assert note.endswith("it fits best: its gap is within the noise")
    alone = finished_search(FRICTION)
    alone.ranking = [RankedCandidate(name, 0.5, 1e-6, 1.0, 1.0, True) for name in (FRICTION, LAG)]
    alone.too_small[LAG] = "it was too short"
    added, small = found(alone).ranking
    assert added.reason == "added"
    assert small.reason.endswith("; it was too short")


@pytest.mark.parametrize(("share", "is_said"), [(0.999, True), (0.9, False)])
def test_another_number_that_explains_as_much_is_said(share: float, is_said: bool) -> None:
    """A ratio of two areas is told, and not which of them is wrong."""
    search = finished_search(FRICTION, LAG)
    gain = replace(NOT_COMPARED, share=1.0, share_out=share)
    right, other, effect = assumed("voltage_limit"), assumed("force_constant"), search.looks[0][0]
    trials = [Refit(item.start, search.fit, gain) for item in (right, other)]
    search.accepted.append(right)
    search.looks.append([*trials, replace(effect, comparison=gain)])
    value = search.fit.vector[other.start.strength_at]
    said = [note for note in found(search).notes if note.startswith("another number")]
    expected = (
        "another number explains about as much as voltage_limit: "
        f"force_constant of {value:.4g} N/V; check them against the drawing"
    )
    assert said == ([expected] if is_said else [])


def test_look_alikes_stand_beside_what_was_added_with_what_separates_them() -> None:
    search = finished_search(FRICTION, LAG)
    search.accepted[0] = replace(search.accepted[0], equivalent=("presliding_friction",))
    result = found(search)
    assert result.equivalent == ((FRICTION, "presliding_friction"),)
    assert set(result.separate) == {FRICTION, "presliding_friction"}


def line(candidate: str, score: float, *, refitted: bool, p_value: float = 0.2) -> RankedCandidate:
    return RankedCandidate(candidate, score, p_value, 4.0e4, score, refitted)


def test_the_ranking_is_what_was_added_then_refitted_then_the_rest() -> None:
    search = finished_search(FRICTION)
    shares = replace(NOT_COMPARED, share=0.9, share_out=0.8, p_value=1e-9)
    search.accepted = [
        replace(search.accepted[0], comparison=shares, equivalent=("presliding_friction",))
    ]
    search.ranking = [
        line("current_deadband", 0.0, refitted=True),
        line("viscosity_drift", 0.4, refitted=False),
        line("torque_saturation", 0.001, refitted=False),
        line(LAG, 0.3, refitted=True),
        line("presliding_friction", 0.79, refitted=True, p_value=1e-9),
        line(FRICTION, 0.5, refitted=True),
    ]
    ranking = found(search).ranking
    assert [(item.id, item.score) for item in ranking] == [
        # the score that it was added for, not the one of the first look
        (FRICTION, 0.8),
        ("presliding_friction", 0.79),
        (LAG, 0.3),
        ("current_deadband", 0.0),
        ("viscosity_drift", 0.4),
        ("torque_saturation", 0.001),
    ]
    assert [item.reason for item in ranking] == [
        "added",
        "fits as well as the effect that was added",
        "refitted, it explains 30.0 % of the excess error on runs left out, where the best "
        "explains 80.0 %; by chance with a probability of 0.2, and 0.001 is asked for: it shows in "
        "few stretches, and longer or more runs would tell",
        "refitted with all parameters, it is no better on runs left out of the fit",
        "one simulation predicts that it explains 40.0 % of the excess error; others promise more, "
        "so it was not refitted",
        "its simulated response does not resemble the residual",
    ]
    assert all(item.error_after == pytest.approx(np.sqrt(4.0e4 / 1200)) for item in ranking)
    assert ranking[0].p_value == 1e-9


def test_where_nothing_was_refitted_no_other_promises_more() -> None:
    search = finished_search(FRICTION)
    search.accepted = []
    search.ranking = [line(LAG, 0.012, refitted=False)]
    assert [item.reason for item in found(search, Verdict.NONE).ranking] == [
        "one simulation predicts that it explains 1.2 % of the excess error; nothing was refitted"
    ]


def test_a_run_s_own_estimates_are_sorted_by_run() -> None:
    layout = model().plant.layout
    places = Places(layout, (RunParameter(MASS, "first", 67), RunParameter(MASS, "second", 68)))
    values = {"mass in first": Estimate(90.0, 89.0, 91.0, ""), MASS: Estimate(1.0, 1.0, 1.0, "kg")}
    assert own_estimates(places, values) == {"first": {MASS: Estimate(90.0, 89.0, 91.0, "kg")}}


def test_late_stamps_are_no_effect_but_a_property_of_the_log() -> None:
    places = Places(model().plant.layout, (), (LateClock("drive", 67), LateClock("block", 68)))
    late = lateness_estimates(places, {"lateness of drive": Estimate(1.2e-3, 1.05e-3, 1.35e-3, "")})
    assert late == {"drive": Estimate(1.2e-3, 1.05e-3, 1.35e-3, "s")}
    assert lateness_notes(places, late) == [
        "the stamps of 'drive' are 1.20 ms late (1.05 to 1.35 ms) against those of the inputs: a "
        "property of the log, not an effect"
    ]
    assert lateness_notes(places, {}) == []
    (note,) = lateness_notes(places, {"block": Estimate(-2e-3, -2e-3, 2e-3, "s")})
    assert note.startswith("CAUTION: the stamps of 'block' are 2 ms early, the most that")


def test_stamps_that_are_read_earlier_are_late_by_that_as_well() -> None:
    """All channels of the clock are named, and what a fit finds is beyond what it is read by."""
    layout = model().plant.layout
    clock = LateClock("p_a", 67, ("p_a", "p_b"), read_earlier=-12e-3)
    places = Places(layout, (), (clock,))
    late = lateness_estimates(places, {"lateness of p_a": Estimate(1e-3, 0.98e-3, 1.02e-3, "")})
    assert late["p_a"].value == pytest.approx(-11e-3)
    assert places.beyond_reading({"p_a": -11e-3}) == {"p_a": pytest.approx(1e-3)}
    assert lateness_notes(places, late) == [
        "the stamps of 'p_a' and 'p_b' are 11.000 ms early (10.980 to 11.020 ms) against those of "
        "the inputs: a property of the log, not an effect; they are read that much later here: "
        "give all topics stamps from one clock"
    ]

"""Whole runs distinguish what windows do not, where a model holds over them."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from benchmarks.experiment_rigs import rigs_of
from benchmarks.next_experiment import performed

from eha_bench.api import diagnose
from eha_bench.suites import load_suite

sys.path.insert(0, str(Path(__file__).parent))

from known_search import LinearProblem, add, search_of, shape, strength

from eha_bench.diagnosis.search import whole_runs
from eha_bench.diagnosis.search.whole_runs import compare_over, compare_over_whole_runs

EFFECT, OTHER = "coulomb_friction", "current_lag"
FORCE, TIME = "coulomb_friction.friction_force", "current_lag.time_constant"


def problem(alike: float, missing: str = FORCE, other: float = 0.0, **more: Any) -> Any:
    """Readings in which both effects do nearly the same; `other` acts as well, and is neither."""
    waves = {FORCE: shape(1.0), TIME: alike * shape(1.0) + (1.0 - alike) * shape(3.0)}
    sizes = {FORCE: 7.0, TIME: 2e-3}
    slopes = {key: 7.0 / sizes[key] * wave for key, wave in waves.items()}
    slopes |= {"viscous_friction": 0.1 * shape(0.0), "mass": other * shape(5.0)}
    truth = {missing: sizes[missing]} | ({"mass": 2.0} if other else {})
    return LinearProblem(slopes, truth, **more)


def tied_search(missing: str = FORCE) -> Any:
    """A search that found an effect, which windows do not distinguish from the other."""
    search = search_of(problem(1.0, missing), "viscous_friction")
    add(search, EFFECT, OTHER)
    search.accepted = [replace(search.accepted[0], equivalent=(OTHER,))]
    return search


def test_what_whole_runs_speak_against_is_no_equivalent() -> None:
    search = tied_search()
    compare_over(search, problem(0.8))
    (item,) = search.accepted
    assert (item.start.candidate, item.equivalent) == (EFFECT, ())


def test_what_whole_runs_speak_for_takes_the_place() -> None:
    search = tied_search(TIME)
    assert search.accepted[0].start.candidate == EFFECT
    cost = search.fit.cost
    compare_over(search, problem(0.8, TIME))
    (item,) = search.accepted
    assert (item.start.candidate, item.equivalent) == (OTHER, ())
    assert item.comparison.share > 0.95
    assert strength(search, search.fit, OTHER) == pytest.approx(2e-3, rel=0.05)
    assert strength(search, search.fit, EFFECT) == 0.0
    assert search.fit.cost == pytest.approx(cost, rel=0.01)


def test_what_describes_the_same_with_more_takes_no_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may stand beside what it yields to."""
    search = tied_search(TIME)
    monkeypatch.setattr(whole_runs, "yields_to", lambda _, name, __: {OTHER: EFFECT}.get(name, ""))
    compare_over(search, problem(0.8, TIME))
    (item,) = search.accepted
    assert (item.start.candidate, item.equivalent) == (EFFECT, (OTHER,))


def test_a_tie_stays_where_whole_runs_do_not_distinguish_either() -> None:
    search = tied_search()
    compare_over(search, problem(1.0))
    assert search.accepted[0].equivalent == (OTHER,)


def test_what_only_windows_speak_against_is_equivalent() -> None:
    """Their start states take part of what is missing; whole runs have none to take it."""
    search = tied_search()
    search.accepted = [replace(search.accepted[0], equivalent=())]
    compare_over(search, problem(1.0))
    assert search.accepted[0].equivalent == (OTHER,)


def test_a_tie_stays_where_no_model_holds_over_whole_runs() -> None:
    """Then a gain says how the forms are wrong, not which cause is there."""
    search = tied_search()
    compare_over(search, problem(0.8, other=3.0))
    assert search.accepted[0].equivalent == (OTHER,)


def test_noise_that_is_louder_than_it_was_taken_for_distinguishes_less() -> None:
    search = tied_search()
    near = 0.97
    compare_over(search, problem(near, level=4.0))
    assert search.accepted[0].equivalent == (OTHER,)
    compare_over(search, problem(near))
    assert search.accepted[0].equivalent == ()


def test_runs_that_are_not_cut_are_not_compared_again() -> None:
    search = tied_search()
    # nothing of these windows could be cut: they stand for whole runs
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "eha_bench.diagnosis.search.whole_runs.cut_windows", lambda *_: [object()]
        )  # fmt: skip
        compare_over_whole_runs(search)
    assert search.accepted[0].equivalent == (OTHER,)


@pytest.mark.slow
def test_a_weight_and_lopsided_friction_part_over_a_run(tmp_path: Path) -> None:
    """Over windows of 0.4 s both explain everything, and the wrong one a little more."""
    rig = rigs_of("geared_servo", foreign=False)["gravity_load"](840)
    rig.record_first(tmp_path)
    limits = tmp_path / "safe.yaml"
    limits.write_text(rig.safety("geared_servo"))
    steps = tmp_path / "steps.yaml"
    levels = ", ".join(["0.685, -0.685, 0.343, -0.343, 0"] * 3)
    steps.write_text(
        "name: steps\ntrials:\n  - {id: steps, mode: duty, duration: 6.4 s, "
        f"signal: {{kind: steps, levels: [{levels}], hold: 0.454 s, at: 0.05 s}}}}\n"
    )
    dataset, _ = performed(rig, tmp_path, load_suite(steps), "both")
    found = diagnose(dataset, tmp_path / "found")
    assert [item.id for item in found.effects] == ["gravity_load"]
    assert {item.cause for item in found.rivals if item.standing != "runner_up"} == {"gravity_load"}

"""The league: what entrants see, and what the one scorer makes of their answers."""

import importlib
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest


@pytest.fixture(scope="module")
def league(pytestconfig: pytest.Config) -> Any:
    """The modules of benchmarks/league."""
    sys.path.insert(0, str(pytestconfig.rootpath))
    try:
        import benchmarks.league.__main__ as found

        yield found
    finally:
        sys.path.remove(str(pytestconfig.rootpath))


@pytest.fixture(scope="module")
def recorded(league: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """A short case with an offset of a pressure sensor, and its truth."""
    out = tmp_path_factory.mktemp("league")
    (plan,) = league.make_plans(7, 1, effects=["pressure_sensor_offset"], strengths=["strong"])
    league.record_case(plan, out, league.Conditions(duration=0.3))
    truth = league.YAML(typ="safe").load(out / "truth" / f"{plan.name}.yaml")
    return out / "cases" / plan.name, truth


@pytest.fixture(scope="module")
def asked(league: Any, recorded: tuple[Path, Any]) -> tuple[Any, Any]:
    """The question of that case, and what its held-out runs measured."""
    case, _ = recorded
    question, measured = league.ask(case, case.parent.parent / "question", league.EFFECTS)
    return question, measured


def test_an_entrant_sees_nothing_of_what_it_predicts(
    recorded: tuple[Path, Any], asked: tuple[Any, Any]
) -> None:
    question, measured = asked
    hidden = {f"{run.name}.mcap" for run in question.held_out}
    there = {path.name for path in question.dataset.parent.iterdir()}
    assert len(hidden) == 4
    assert not hidden & there
    assert hidden < {path.name for path in recorded[0].iterdir()}
    text = question.dataset.read_text()
    assert not any(name in text for name in hidden)
    assert len(question.training) == 6
    for run in question.held_out:
        later = run.time > 0.02
        assert np.isfinite(run.command).all()
        for channel in question.channels:
            assert np.isnan(run.measured[channel][later]).all()
            assert np.isfinite(run.measured[channel][~later]).all()
            assert np.isfinite(measured[run.name][channel]).all()


def answer(asked: tuple[Any, Any], *causes: Any, error: float = 0.0, others: Any = ()) -> Any:
    """An answer that predicts what was measured, off by so many noise floors."""
    from benchmarks.league.answer import Answer, Cause
    from benchmarks.league.scorer import NOISE

    question, measured = asked
    prediction = {
        run.name: {
            name: measured[run.name][name] + error * NOISE[name] for name in question.channels
        }
        for run in question.held_out
    }
    named = tuple(Cause(*item) for item in causes)
    return Answer(named, tuple(Cause(*item) for item in others), prediction).checked(question)


OFFSET = ("pressure_sensor_offset", "measurement")
LEAK = ("external_leakage", "flow")


def mark(asked: tuple[Any, Any], given: Any, truth: Any) -> Any:
    from benchmarks.league.scorer import marked

    return marked(asked[0], given, truth, asked[1], 1.0)


def test_one_hidden_effect(asked: tuple[Any, Any], recorded: tuple[Path, Any]) -> None:
    truth = recorded[1]
    right = mark(asked, answer(asked, OFFSET, error=3.0), truth)
    assert (right.first_right, right.right, right.equation_right) == (True, True, True)
    assert right.error == pytest.approx(3.0)
    second = mark(asked, answer(asked, LEAK, OFFSET), truth)
    assert (second.first_right, second.right, second.accuses) == (False, False, True)
    assert second.among_few
    none = mark(asked, answer(asked, others=[LEAK, OFFSET]), truth)
    assert (none.first_right, none.accuses, none.among_few) == (False, False, True)
    unknown = mark(asked, answer(asked, ("unknown", "measurement")), truth)
    assert (unknown.right, unknown.accuses, unknown.equation_right) == (False, False, True)


def test_nothing_hidden_and_what_is_outside_the_list(
    asked: tuple[Any, Any], recorded: tuple[Path, Any]
) -> None:
    nothing = {"case": "c", "kind": "none", "undeclared": []}
    assert mark(asked, answer(asked), nothing).right
    assert not mark(asked, answer(asked, LEAK), nothing).right
    strange = {
        "case": "c", "kind": "foreign",
        "undeclared": [{"id": "churning", "equation": "torque", "also": ["actuation"]}],
    }  # fmt: skip
    assert mark(asked, answer(asked, ("unknown", "actuation")), strange).right
    assert not mark(asked, answer(asked, ("unknown", "flow")), strange).right
    assert mark(asked, answer(asked, LEAK), strange).accuses


def test_what_cannot_be_simulated_is_infinitely_wrong(
    asked: tuple[Any, Any], recorded: tuple[Path, Any]
) -> None:
    given = answer(asked, OFFSET)
    run = asked[0].held_out[0].name
    broken = given.prediction[run] | {"current": np.full(300, np.nan)}
    worse = type(given)(given.claimed, (), given.prediction | {run: broken})
    assert math.isinf(mark(asked, worse.checked(asked[0]), recorded[1]).error)


def test_an_answer_that_does_not_fit_is_a_sentence(asked: tuple[Any, Any]) -> None:
    from benchmarks.league.answer import Answer

    with pytest.raises(ValueError, match="'gremlin' may not be named"):
        answer(asked, ("gremlin",))
    with pytest.raises(ValueError, match="named twice"):
        answer(asked, LEAK, LEAK)
    with pytest.raises(ValueError, match="'magic' is not a balance"):
        answer(asked, ("unknown", "magic"))
    with pytest.raises(ValueError, match="is to be predicted at 300 ticks"):
        Answer(()).checked(asked[0])


def test_answers_are_kept_bit_for_bit(asked: tuple[Any, Any], tmp_path: Path) -> None:
    from benchmarks.league.answer import read_answer

    given = answer(asked, OFFSET, others=[LEAK], error=1.0)
    given.write(tmp_path)
    back = read_answer(tmp_path)
    assert (back.claimed, back.others) == (given.claimed, given.others)
    for run, columns in given.prediction.items():
        for name, values in columns.items():
            assert np.array_equal(back.prediction[run][name], values)


def silent(question: Any) -> Any:
    """An entrant that gives up."""
    raise RuntimeError("no idea")


def test_a_league_from_its_command_to_its_page(
    league: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "my_entrant", sys.modules[__name__])
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- tables by benchmarks.league -->\n<!-- end of the tables -->\nb\n")
    monkeypatch.setattr(sys, "argv", [
        "league", "--cases", "1", "--none", "1", "--foreign", "0", "--seed", "3",
        "--duration", "0.3", "--entrant", "declared", "my_entrant:silent",
        "--out", str(tmp_path / "out"), "--json", str(tmp_path / "rows.json"), "--page", str(page),
    ])  # fmt: skip
    assert league.main() == 0
    text = page.read_text()
    assert "| 2 cases, seed 3 | declared | my_entrant:silent |" in text
    assert "| nothing missing: says so | 1 of 1 (21–100 %) | 0 of 1 (0–79 %) |" in text
    assert "| gave no answer | 0 of 2 (0–66 %) | 2 of 2 (34–100 %) |" in text
    figures = {row["figure"] for row in json.loads((tmp_path / "rows.json").read_text())}
    assert "declared: right cause first" in figures
    found = json.loads((tmp_path / "out" / "league.json").read_text())
    failures = found["entrants"]["my_entrant:silent"]["failures"]
    assert len(failures) == 2
    for failure in failures.values():
        assert failure.startswith("RuntimeError: no idea, at ")
        assert failure.endswith("in silent")
        assert "test_league.py:" in failure


def test_an_answer_is_kept_until_its_file_budget_or_case_changes(
    league: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "counting.py"
    file.write_text(
        "from benchmarks.league.declared import enter as declared\n"
        "calls = []\n"
        "def enter(question):\n"
        "    calls.append(question.case)\n"
        "    return declared(question)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    counting = importlib.import_module("counting")

    def play(seed: int, *more: str) -> int:
        counting.calls.clear()
        given = league.arguments().parse_args([
            "--cases", "1", "--none", "0", "--foreign", "0", "--duration", "0.1", "--seed",
            str(seed), "--entrant", "counting:enter", "--out", str(tmp_path / "out"), *more,
        ])  # fmt: skip
        found = league.run(given)
        assert found["seed"] == seed
        return len(counting.calls)

    assert play(1) == 1
    assert play(1) == 0
    assert play(2) == 1  # another seed: another case, though it has the same name
    assert play(1) == 0
    assert play(1, "--budget", "0.5") == 1
    assert play(1, "--budget", "0.5", "--again") == 1
    file.write_text(file.read_text() + "# another version\n")
    assert play(1, "--budget", "0.5") == 1


def test_an_answer_of_another_kind_is_a_sentence(
    league: Any, asked: tuple[Any, Any], tmp_path: Path
) -> None:
    assert league._kept({}, asked[0], tmp_path) == "an entrant returns an Answer, this one a dict"
    wrong = type(answer(asked))(())
    assert "is to be predicted at 300 ticks" in league._kept(wrong, asked[0], tmp_path)


def test_every_case_is_shown_with_what_was_made_of_it() -> None:
    from benchmarks.league.page import each

    def one(**changes: Any) -> dict[str, Any]:
        base = {
            "case": "case_0000",
            "truth": ("a", "b"),
            "claimed": (),
            "error": 2.0,
            "failure": "",
        }
        return base | {"failure": ""} | changes

    text = each({"entrants": {
        "mine": {"marks": [one(claimed=("a",))]},
        "yours": {"marks": [one(failure="KeyError: 'x', at y.py:3 in enter")]},
    }})  # fmt: skip
    assert text.splitlines()[-1] == (
        "| case_0000 | a + b | a (2) | no answer: KeyError: 'x', at y.py:3 in enter |"
    )


def test_a_new_seed_is_drawn(league: Any) -> None:
    drawn = {league.arguments().parse_args(["--seed", "new"]).seed for _ in range(5)}
    assert len(drawn) > 1
    assert league.arguments().parse_args(["--seed", "7"]).seed == 7


def test_entrants_are_found_or_a_sentence(league: Any) -> None:
    from benchmarks.league.entrants import ENTRANTS, entrant

    assert all(callable(entrant(name)) for name in ENTRANTS)
    for name in ("nobody", "no_such_module:enter", "benchmarks.league.declared:leave"):
        with pytest.raises(ValueError, match="entrant"):
            entrant(name)


def test_sparse_regression_finds_what_made_its_data() -> None:
    """A known answer: a rate made of two terms of the library, and noise."""
    from benchmarks.league.sindy import _sparse, library

    terms = library()["motor_speed"]
    draws = np.random.default_rng(1)
    arguments = tuple(
        draws.normal(size=2000) * size for size in (1.0, 1.0, 9.0, 9.0, 150.0, 8e6, 8e6, 5e-3, 0.1)
    )
    causes = [term.cause for term in terms]
    drag, leak = terms[1], terms[causes.index("pressure_dependent_friction")]
    made = -0.8 * drag.values(*arguments) - 2e-6 * leak.values(*arguments)
    fit = _sparse(terms, [(arguments, made + draws.normal(size=2000) * 5.0)])
    assert max(fit.shares, key=lambda name: fit.shares[name]) == "pressure_dependent_friction"
    found = fit.coefficients[causes.index("pressure_dependent_friction")]
    assert found == pytest.approx(-2e-6, rel=0.05)


def test_evolution_finds_a_minimum_and_thins(asked: tuple[Any, Any]) -> None:
    """What is on in a vector of numbers is on in the model, and BIC switches off what is idle."""
    from benchmarks.league.evolution import Search, _model, _thinned

    from eha_bench.diagnosis.data.dataset import load_dataset

    search = Search(load_dataset(asked[0].dataset))
    numbers = np.zeros(len(search.keys) + len(search.starts))
    names = [start.candidate for start in search.starts]
    before = search.cost(numbers)
    place = len(search.keys) + names.index("pressure_sensor_offset")
    numbers[place] = 1.0
    model = _model(search, numbers)
    assert "pressure_sensor_offset" in {effect.id for effect in model.effects}
    numbers[place] = 0.0
    _, cost, lost = _thinned(search, numbers, before)
    assert not search.on.any()
    assert cost == before
    assert set(lost) == set(names)

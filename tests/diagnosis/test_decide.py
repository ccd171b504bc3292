"""The verdict on a finished search, state by state, without simulating anything."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eha_bench.diagnosis.fit.baseline import no_progress
from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.fit.evidence import NOT_COMPARED, SOFT_MEAN, Excess
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.thresholds import Thresholds
from eha_bench.diagnosis.outcome import decide as module
from eha_bench.diagnosis.outcome.decide import (
    Decision,
    _is_their_law,
    decide,
    in_held_out,
    without_curve,
)
from eha_bench.diagnosis.outcome.diagnosis import Unknown, Verdict
from eha_bench.diagnosis.outcome.refusal import Refusal, placed_by_refusals
from eha_bench.diagnosis.search.state import Accepted, RankedCandidate, Search
from eha_bench.diagnosis.unknown.curves import LocatedCurve
from eha_bench.diagnosis.unknown.places import Template

SIZE = 1000


def beyond(relative: float, significance: float = 50.0, **channels: float) -> Excess:
    """What a residual holds beyond noise, as a share of the noise's cost."""
    total = relative * SOFT_MEAN * SIZE
    return Excess(total, SIZE, significance, channels or {"current": 1.0, "pressure_a": 2.0})


def fit(cost: float = 0.0, period: float = 0.0, soft: float = 1.0) -> Fit:
    """A fit of a given cost whose residual is as large everywhere."""
    residual = np.full(SIZE, 2.0)
    return Fit(np.array([period]), (), residual, np.zeros((SIZE, 0)), cost, soft=soft)


def found(candidate: str, equation: str = "torque") -> Accepted:
    start = Start(candidate, (), 0, 0.0, 1.0, 0.0, 2.0, (), equation)
    return Accepted(start, NOT_COMPARED, ())


def search(before: float, rest: Excess, *accepted: Accepted) -> Search:
    plant = SimpleNamespace(layout=SimpleNamespace(index={"learned.period": 0}, effects=()))
    problem: Any = SimpleNamespace(plant=plant, size=SIZE)
    groups: Any = None
    state = Search(
        problem, (), (), fit(1.0), fit(2.0), groups, np.zeros(1), beyond(before), rest,
    )  # fmt: skip
    state.accepted = list(accepted)
    return state


Curves = Callable[..., None]


Asked = dict[str, tuple[Any, ...]]


@pytest.fixture
def asked() -> Asked:
    """What was asked of those who locate and learn, by their names."""
    return {}


@pytest.fixture
def curves(monkeypatch: pytest.MonkeyPatch, asked: Asked) -> Curves:
    """What is located, and the share of the excess that a learned curve explains."""
    from eha_bench.diagnosis.fit.problem import soften

    def set_to(
        share: float, equation: str = "torque", variable: str = "motor_speed", period: float = 0.0,
        *, places: int = 2, located: bool = True, scale: float = 1.0,
    ) -> None:  # fmt: skip
        # before learning: the softened cost of residuals of 2, less what noise alone costs
        soft, _ = soften(np.full(SIZE, 2.0), scale)
        before = float(soft @ soft)
        excess = before - SOFT_MEAN * SIZE
        template = Template(equation, "flow", "pump", variable)
        curve = LocatedCurve(template, share, np.zeros(2), np.zeros(2))
        learned = fit(before - share * excess, period, scale)
        answers = {
            "locate": (
                SimpleNamespace(short="short", near=(equation,)),
                equation,
                [curve] if located else [],
            ),
            "learn": (None, learned),
            "times_of": ((1.0, 2.0),),
            "places_of": ("place",) * places,
            "straight_line": "",
        }
        for name, answer in answers.items():
            monkeypatch.setattr(
                module, name, lambda *given, n=name, a=answer: (asked.update({n: given}), a)[1]
            )

    return set_to


REFUSED = Refusal(found("backlash"), "its strength is at its bound")


def verdict(state: Search) -> Decision:
    return decide(state, 1e-3, no_progress, (REFUSED,))


def test_an_effect_that_leaves_noise_is_the_verdict() -> None:
    told = verdict(search(0.5, beyond(0.01, 1.0), found("backlash")))
    assert (told.verdict, told.unknown, told.learned) == (Verdict.EFFECT, None, False)
    assert told.fit.cost == 2.0
    assert told.notes == (
        REFUSED.note,
        "the mean square error that remains is 1.0 % above the noise's (50.0 % before)",
    )


@pytest.mark.parametrize(("rest", "whole"), [(0.25, True), (0.2501, False)])
def test_half_of_the_excess_is_a_verdict_and_less_is_not(
    rest: float, whole: bool, curves: Curves
) -> None:
    curves(0.9)
    told = verdict(search(0.5, beyond(rest), found("backlash")))
    assert (told.verdict is Verdict.EFFECT) is whole
    more = "the causes found do not explain everything: something else is missing"
    assert (more in told.notes) is whole


def test_what_may_be_another_form_is_no_other_cause() -> None:
    told = verdict(search(10.0, beyond(0.1), found("backlash")))
    assert told.verdict is Verdict.EFFECT
    assert told.notes[-1].startswith("the causes found leave more than noise, as little as another")


@pytest.mark.parametrize(("other", "alone"), [(1.05, True), (1.5, False)])
def test_what_remains_in_one_sensor_is_said_to(other: float, alone: bool) -> None:
    rest = beyond(0.2, pressure_a=6.8, pressure_b=other)
    told = verdict(search(0.5, rest, found("backlash")))
    assert told.verdict is Verdict.EFFECT
    assert told.notes[-1].startswith("what remains shows in 'pressure_a' alone, by 2.6") is alone


def test_nothing_left_and_nothing_found_is_none() -> None:
    told = verdict(search(0.5, beyond(0.029)))
    assert (told.verdict, told.unknown) == (Verdict.NONE, None)
    assert len(told.notes) == 2


def test_more_noise_without_structure_is_none_and_names_the_channel() -> None:
    told = verdict(search(0.5, beyond(0.4, 7.9, current=9.0, pressure_a=2.0)))
    assert told.verdict is Verdict.NONE
    assert told.notes[-1].startswith("that has no structure in time")
    assert told.notes[-1].endswith("mostly of 'current'")


def test_an_assumed_parameter_is_no_effect(curves: Curves) -> None:
    curves(0.9)
    assumed = found("parameter:rotor_inertia")
    assert verdict(search(0.5, beyond(0.01, 1.0), assumed)).verdict is Verdict.NONE
    assert verdict(search(0.5, beyond(0.3), assumed)).verdict is Verdict.UNKNOWN


def test_what_is_unknown_is_located_and_its_curve_kept(curves: Curves) -> None:
    curves(0.6)
    told = verdict(search(0.5, beyond(0.4)))
    assert told.verdict is Verdict.UNKNOWN
    assert told.unknown is not None
    assert (told.unknown.equation, told.unknown.variables) == ("torque", ("motor_speed",))
    assert told.unknown.share == pytest.approx(0.6)
    assert told.unknown.description.endswith("a learned curve explains 60 % of the excess")
    assert (told.unknown.when, told.unknown.period) == ((), 0.0)
    assert told.learned
    assert [item.template.place for item in told.located] == ["pump"]
    assert told.locator is not None


def test_a_period_and_times_are_told_where_there_are_some(curves: Curves) -> None:
    curves(0.6, "measurement", "time", 0.5)
    told = verdict(search(0.5, beyond(0.4))).unknown
    assert told is not None
    assert (told.period, told.when) == (0.5, ((1.0, 2.0),))
    assert "in the measurement of pump and depends on time, periodic with 0.5 (SI)" in (
        told.description
    )


def test_who_locates_and_learns_is_asked_about_this_search(curves: Curves, asked: Asked) -> None:
    curves(0.6, "measurement", "time", 0.5)
    state = search(0.5, beyond(0.4))
    seen: list[str] = []

    def progress(stage: str, share: float) -> None:
        seen.append(stage)

    told = decide(state, 1e-3, progress)
    assert asked["locate"] == (state.problem, state.fit, 1e-3, progress)
    assert asked["learn"] == (state.problem, "short", state.fit, told.located[0], 1e-3)
    assert asked["times_of"] == (state.problem, told.fit, state.declared_vector)
    assert seen == ["learn"]


@pytest.mark.parametrize(
    ("share", "says", "learned", "told_share"),
    [
        (0.11, "and depends on motor_speed", True, 0.11),
        # it is said to follow several, so it is not said to follow one, nor learned as one
        (
            0.006,
            "a curve of motor_speed explains 1 % of the excess, so it depends on",
            False,
            0.006,
        ),
        (0.09, "a curve of motor_speed explains 9 % of the excess, so it depends on", False, 0.09),
        (0.004, "no curve that was tried explains any of it", False, 0.0),
        (-0.2, "no curve that was tried explains any of it", False, 0.0),
    ],
)
def test_a_curve_that_explains_little_is_said_to(
    share: float, says: str, learned: bool, told_share: float, curves: Curves
) -> None:
    curves(share)
    state = search(0.5, beyond(0.4))
    told = verdict(state)
    assert told.verdict is Verdict.UNKNOWN
    assert told.unknown is not None
    assert says in told.unknown.description
    assert told.learned is learned
    assert (told.fit is state.fit) is not learned
    assert told.unknown.variables == (("motor_speed",) if learned else ())
    assert told.unknown.share == pytest.approx(told_share)


@pytest.mark.parametrize(
    ("equation", "places", "says", "told"),
    [
        ("flow", 1, "something acts in the flow balance; no curve", "flow"),
        ("", 1, "nothing was located; no curve", None),
        (
            "",
            0,
            "something is missing, but its place is unknown: this plant has no `advance`",
            None,
        ),
    ],
)
def test_what_cannot_be_located_is_said(
    equation: str, places: int, says: str, told: str | None, curves: Curves
) -> None:
    curves(0.0, equation, places=places, located=False)
    unknown = verdict(search(0.5, beyond(0.4))).unknown
    assert unknown is not None
    assert unknown.description.startswith(says)
    assert (unknown.equation, unknown.variables) == (told, ())


# --- effects that explain less than half, where much is missing --------------------------------


def beside(curves: Curves, curve: float, equation: str = "torque", before: float = 6.0) -> Any:
    """A search whose effect explains two fifths of what is missing, and a curve so much of it."""
    curves(curve, equation)
    state = search(before, beyond(0.6 * before), found("parameter:mass"), found("backlash"))
    kept = list(state.accepted)
    return state, kept, verdict(state)


def test_a_curve_is_looked_for_without_the_effects(curves: Curves, asked: Asked) -> None:
    state, _, _ = beside(curves, 0.19)
    assert asked["locate"] == (state.problem, state.base, 1e-3, no_progress)


def test_a_part_is_named_where_a_curve_explains_less_than_half_of_it(curves: Curves) -> None:
    state, kept, told = beside(curves, 0.19)
    assert (told.verdict, told.unknown) == (Verdict.EFFECT, None)
    assert told.notes[-1] == (
        "backlash: 40 % of it is explained; more is missing in the torque balance, and a curve of "
        "one variable would explain 19 % of it"
    )
    assert (state.accepted, told.fit.cost) == (kept, 2.0)


@pytest.mark.parametrize(
    ("curve", "equation", "before"),
    [(0.21, "torque", 6.0), (0.19, "flow", 6.0), (0.19, "torque", 4.9)],
    ids=["a curve does half as much", "another balance", "little is missing"],
)
def test_else_it_is_taken_for_an_imitation(
    curves: Curves, curve: float, equation: str, before: float
) -> None:
    state, _, told = beside(curves, curve, equation, before)
    assert told.verdict is Verdict.UNKNOWN
    assert told.notes[-1] == "the best known effects explain less than half of it: backlash"
    # what was only assumed stays, and the fit is that without the effect
    assert [item.start.candidate for item in state.accepted] == ["parameter:mass"]
    assert state.fit is state.base


@pytest.mark.parametrize(
    ("variable", "law", "same"),
    [("air_pressure", "p_a", True), ("pressure_sum", "p_a", True), ("rod_speed", "p_a", False),
     ("air_pressure", "speed", False)],
)  # fmt: skip
def test_a_curve_of_the_pressure_that_an_effect_follows_is_the_same_cause(
    variable: str, law: str, same: bool
) -> None:
    laws = {"p_a": lambda level, p_a: level + p_a, "speed": lambda level, speed: level + speed}
    effect = SimpleNamespace(id="seal", action=SimpleNamespace(hooks={"dry": laws[law]}))
    plant = SimpleNamespace(
        layout=SimpleNamespace(effects=(effect,)), units={"air_pressure": "Pa", "rod_speed": "m/s"}
    )
    state: Any = SimpleNamespace(problem=SimpleNamespace(plant=plant))
    told = Unknown("force", (variable,), "", 0.6)
    assert _is_their_law(state, [found("seal", "force")], told) is same


def test_a_curve_is_credited_by_the_loss_that_it_was_fitted_with(curves: Curves) -> None:
    curves(0.4, scale=3.0)
    told = verdict(search(5.0, beyond(5.0)))
    assert told.unknown is not None
    assert told.unknown.share == pytest.approx(0.4)


@pytest.mark.parametrize(("share", "named"), [(0.15, ()), (0.68, ("time",))])
def test_a_little_curve_that_harms_whole_runs_names_no_variable(share: float, named: Any) -> None:
    unknown = Unknown("force", ("time",), "depends on time", share, 5.6, ((0.0, 1.0),), "rod")
    state = search(5.0, beyond(5.0))
    with_curve = Decision(Verdict.UNKNOWN, fit(1.0), ("noted",), unknown, learned=True)
    told = without_curve(with_curve, state, "whole runs grow")
    assert not told.learned
    assert told.fit is state.fit
    assert told.notes[-1].endswith("left out of the revised model: whole runs grow")
    assert told.unknown is not None
    assert (told.unknown.equation, told.unknown.at) == ("force", "rod")
    assert told.unknown.share == share
    assert told.unknown.variables == named
    assert ("remains open" in told.unknown.description) is not bool(named)
    assert bool(told.unknown.period) is bool(named)


@pytest.mark.parametrize(
    ("equation", "text"),
    [
        ("flow", "something acts in the flow balance in held-out runs, where"),
        ("", "something acts in held-out runs, where"),
    ],
)
def test_what_held_out_runs_alone_show_is_unknown(equation: str, text: str) -> None:
    told = in_held_out(Decision(Verdict.NONE, fit(2.0), ("noted",), None), equation)
    assert (told.verdict, told.notes, told.fit.cost) == (Verdict.UNKNOWN, ("noted",), 2.0)
    assert told.unknown is not None
    assert (told.unknown.equation, told.unknown.variables) == (equation or None, ())
    assert told.unknown.description.startswith(text)


def test_a_search_is_asked_for_by_its_shares_not_its_sizes() -> None:
    """What remains below the noise counts as nothing, and so does an excess below one."""
    state = search(0.5, replace(beyond(0.0, 1.0), total=-40.0), found("backlash"))
    told = verdict(state)
    assert told.verdict is Verdict.EFFECT
    assert (
        told.notes[1]
        == "the mean square error that remains is 0.0 % above the noise's (50.0 % before)"
    )


@pytest.mark.parametrize(
    ("after", "before", "said"),
    [
        (
            0.1,
            622.0,
            "the mean square error that remains is 10.0 % above the noise's "
            "(623 times the noise's before)",
        ),
        (
            9.0,
            20.5,
            "the mean square error that remains is 10 times the noise's "
            "(21.5 times the noise's before)",
        ),
        (
            0.99,
            8.99,
            "the mean square error that remains is 99.0 % above the noise's "
            "(9.99 times the noise's before)",
        ),
        (3.61e6, 3.61e6, "the mean square error is 3.61e+06 times the noise's"),
    ],
)
def test_what_remains_is_counted_so_that_it_can_be_read(
    after: float, before: float, said: str
) -> None:
    assert module._remaining(after, before) == said


def refused(candidate: str, equation: str, explained: float) -> Refusal:
    item = found(candidate, equation)
    told = replace(NOT_COMPARED, gain=900.0, explained_out=explained)
    return Refusal(replace(item, comparison=told), "whole replays grow")


@pytest.mark.parametrize(
    ("explained", "share", "placed"),
    [(0.96, 0.1, "actuation"), (0.5, 0.1, "torque"), (0.96, 0.7, "torque")],
    ids=["explained nearly all", "explained half", "a curve explains most"],
)
def test_what_explained_nearly_all_and_does_not_stand_tells_the_balance(
    explained: float, share: float, placed: str
) -> None:
    located = Unknown("torque", ("motor_speed",), "something", share)
    told = placed_by_refusals(
        located, [refused("current_lag", "actuation", explained)], Thresholds()
    )
    assert told.equation == placed
    if placed == "actuation":
        assert "much as current_lag would" in told.description
        assert not told.variables
    else:
        assert told is located


def test_a_curve_in_another_balance_than_the_refused_effect_is_left_out(curves: Curves) -> None:
    curves(0.3)
    state = search(4.0, beyond(4.0))
    told = decide(state, 1e-3, no_progress, [refused("current_lag", "actuation", 0.96)])
    assert told.unknown is not None
    assert (told.unknown.equation, told.learned) == ("actuation", False)
    assert told.fit is state.fit


@pytest.mark.parametrize(
    ("score", "p_value", "gain", "is_said"),
    [
        (0.9, 0.003, 100.0, True),
        (0.4, 0.003, 100.0, False),  # it would leave most
        (0.9, 1e-9, 100.0, False),  # sure, and refused for another reason
        (0.9, 0.3, 100.0, False),  # chance
        (0.9, 0.003, 20.0, False),  # a share of next to nothing
    ],
)
def test_what_shows_in_too_few_stretches_is_said(
    score: float, p_value: float, gain: float, is_said: bool
) -> None:
    state = search(0.07, beyond(0.02))
    state.ranking = [
        RankedCandidate("command_delay", score, p_value, state.base.cost - gain, 0.0, True),
        RankedCandidate("parameter:motor.torque_constant", 1.0, 0.003, -500.0, 0.0, True),
        RankedCandidate("current_lag", 1.0, 0.003, -500.0, 0.0, False),
    ]
    decision = decide(state, 1e-3, no_progress)
    assert decision.verdict is Verdict.NONE
    refused = [Refusal(found("command_delay"), "its strength is at its bound")]
    notes = decide(state, 1e-3, no_progress, refused).notes
    assert not any("too few stretches" in note for note in notes)
    told = [note for note in decision.notes if "too few stretches" in note]
    assert told == (
        [
            "command_delay would explain 90 % of what is missing, but shows in too few stretches "
            "of these runs to be sure (probability of chance 0.003, and 0.001 is asked for): "
            "record more of them, or longer ones"
        ]
        if is_said
        else []
    )

"""Two effects that are looked for at once."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from fixtures.rig.case import Conditions, Plan, record_case
from fixtures.rig.plans import by_id

sys.path.insert(0, str(Path(__file__).parent))

from known_search import LinearProblem, search_of, shape

from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.fit.baseline import calibrated_baseline
from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.fit.evidence import NOT_COMPARED, Improvement
from eha_bench.diagnosis.fit.thresholds import DEFAULT
from eha_bench.diagnosis.search import joint as module
from eha_bench.diagnosis.search.joint import joint
from eha_bench.diagnosis.search.state import Accepted, begin

SECONDS = 2.0
"""Of each of ten runs: half a sample's."""


@pytest.mark.slow(45)
def test_two_effects_are_found_from_the_calibrated_model_alone(tmp_path: Path) -> None:
    hidden = (by_id("seal_friction")[0], by_id("torque_saturation")[0])
    plan = Plan("case", "two", hidden, ("strong", "middle"), (1, 2, 3))
    path = record_case(plan, tmp_path, Conditions(duration=SECONDS))
    search = begin(calibrated_baseline(load_dataset(path)))
    assert joint(search)
    assert {item.start.candidate for item in search.effects} == {item.id for item in hidden}
    assert search.excess_left.total < 0.2 * search.excess_base.total


@pytest.mark.slow(12)
def test_no_pair_is_made_of_what_is_outside_the_list(tmp_path: Path) -> None:
    plan = Plan("case", "foreign", tuple(by_id("supply_sag")), ("strong",), (1, 2, 4))
    path = record_case(plan, tmp_path, Conditions(duration=SECONDS))
    search = begin(calibrated_baseline(load_dataset(path)))
    fit = search.fit
    assert not joint(search)
    assert search.fit is fit
    assert not search.accepted


@pytest.mark.parametrize(
    ("gained", "alone", "taken"),
    [
        ((500.0, 2.0), 102.0, "entrained_air"),
        ((2.0, 500.0), 102.0, "relief_valve"),
        # the other one is needed after all: without it the first explains little
        ((500.0, 2.0), 590.0, None),
        # neither is, or both are
        ((2.0, 2.0), 102.0, None),
        ((500.0, 500.0), 102.0, None),
    ],
)
def test_one_of_two_is_taken_that_the_other_only_led_to(
    monkeypatch: pytest.MonkeyPatch,
    gained: tuple[float, float],
    alone: float,
    taken: str | None,
) -> None:
    def improvement(gain: float) -> Improvement:
        share = gain / 500.0
        return Improvement(gain, gain, share, share, 1e-9, 1.0, 0.9)

    items = [Accepted(_start(name), NOT_COMPARED, ()) for name in ("entrained_air", "relief_valve")]
    search: Any = SimpleNamespace(
        accepted=items,
        thresholds=DEFAULT,
        problem=None,
        groups=None,
        base=SimpleNamespace(cost=600.0),
        fit=SimpleNamespace(cost=100.0),
        excess_base=SimpleNamespace(total=500.0, relative=0.5, significance=40.0, size=4000),
    )
    monkeypatch.setattr(module, "without", lambda *_: SimpleNamespace(cost=alone))
    monkeypatch.setattr(module, "excess", lambda *_: "left")
    monkeypatch.setattr(module, "compare", lambda base, fit, *_: improvement(base.cost - fit.cost))
    found = [improvement(gain) if gain > 10.0 else None for gain in gained]
    assert module._is_one(search, found, 600.0) is (taken is not None)
    if taken is None:
        assert search.accepted is items
    else:
        (item,) = search.accepted
        assert item.start.candidate == taken
        assert search.fit.cost == alone
        assert search.excess_left == "left"


@pytest.mark.parametrize(("share", "relative", "enough"), [
    (0.3, 0.5, True),
    # a small part of what the other leaves is its form
    (0.16, 0.3, False),
    # where much is missing a cause shows as a smaller part
    (0.22, 8.0, True),
])  # fmt: skip
def test_each_of_two_explains_enough_of_what_the_other_leaves(
    monkeypatch: pytest.MonkeyPatch, share: float, relative: float, enough: bool
) -> None:
    search: Any = SimpleNamespace(thresholds=DEFAULT, problem=None, groups=None, fit=None)
    left = SimpleNamespace(total=6000.0, relative=relative)
    gained = Improvement(share * 6000, share * 6000, share, share, 1e-9, 1.0, 0.9)
    monkeypatch.setattr(module, "without", lambda *_: None)
    monkeypatch.setattr(module, "excess", lambda *_: left)
    monkeypatch.setattr(module, "compare", lambda *_: gained)
    item = Accepted(_start("load_dependent_friction"), NOT_COMPARED, ())
    assert module._beside(search, item) is (gained if enough else None)


def test_an_interrupt_leaves_what_was_found_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forms of a pair that has not stood its tests are tried: a stop there is no finding."""
    search = search_of(LinearProblem({"viscous_friction": 0.2 * shape(0.0)}, {}))
    starts = (_start("entrained_air"), _start("relief_valve"))
    pair = SimpleNamespace(fit="of a pair", starts=starts)

    def stop(*_: Any) -> None:
        assert len(search.accepted) == 2
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "_best", lambda *_: pair)
    monkeypatch.setattr(module, "_may_win", lambda *_: True)
    monkeypatch.setattr(module, "excess", lambda *_: search.excess_left)
    monkeypatch.setattr(module, "take_best_form", stop)
    before = search.fit
    with pytest.raises(KeyboardInterrupt):
        joint(search)
    assert search.accepted == []
    assert search.fit is before


@pytest.mark.parametrize(("names", "gain", "passes"), [
    # what was found leaves 30 of 1000: two others may leave twice that
    (("entrained_air", "relief_valve"), 945.0, True),
    (("entrained_air", "relief_valve"), 930.0, False),
    # beside it, a part of the 30
    (("command_delay", "relief_valve"), 977.0, False),
    (("relief_valve", "command_delay"), 978.0, True),
])  # fmt: skip
def test_over_short_windows_two_have_to_come_near_what_was_found(
    names: tuple[str, str], gain: float, passes: bool
) -> None:
    found = SimpleNamespace(starts=(_start("command_delay"),), gain=970.0)
    pair = SimpleNamespace(starts=tuple(map(_start, names)), gain=gain)
    near: Any = SimpleNamespace(excess=1000.0, gain=lambda item: item.gain)
    left = SimpleNamespace(total=500.0, relative=0.2)
    kept: Any = SimpleNamespace(thresholds=DEFAULT, excess_left=left)
    assert module._may_pass(kept, near, cast(Any, pair), cast(Any, found)) is passes
    assert module._may_pass(kept, near, cast(Any, pair), None)


@pytest.mark.parametrize(("names", "cost", "may_win"), [
    (("entrained_air", "relief_valve"), 150.0, True),
    (("entrained_air", "relief_valve"), 200.0, False),
    # what was found has its best form
    (("command_delay", "relief_valve"), 101.0, False),
    (("command_delay", "relief_valve"), 99.0, True),
])  # fmt: skip
def test_forms_are_tried_of_two_that_may_explain_more_than_what_was_found(
    names: tuple[str, str], cost: float, may_win: bool
) -> None:
    item = Accepted(_start("command_delay"), NOT_COMPARED, ())
    costs = SimpleNamespace(cost=500.0), SimpleNamespace(cost=100.0)
    search: Any = SimpleNamespace(accepted=[item], base=costs[0], fit=costs[1])
    pair: Any = SimpleNamespace(starts=tuple(map(_start, names)), fit=SimpleNamespace(cost=cost))
    assert module._may_win(search, pair) is may_win


def _start(name: str) -> Start:
    return Start(name, (), 0, 0.0, 0.02, 0.0, 0.5, (f"{name}.size",), "flow")

"""A candidate that hides how it is bent where a window begins is tried with that open."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from eha_bench.diagnosis.search import hidden_starts
from eha_bench.diagnosis.search.hidden_starts import _best_opened, with_hidden_starts

MISSING, COST = 1000.0, 3000.0


class Hiding:
    """A problem in which bristles hide something, and nothing else does."""

    @staticmethod
    def hides_more(vector) -> bool:
        return vector == "bristles"


def candidate(name: str, gain: float) -> SimpleNamespace:
    start = SimpleNamespace(candidate=name, apply=lambda _: name)
    return SimpleNamespace(
        candidate=name, start=start, fit=SimpleNamespace(cost=COST - gain, vector=name)
    )


@pytest.fixture
def search(monkeypatch):
    """A search that lacks 1000, and what bristles leave of it with their start open."""
    opened = {}

    def starts_of(*_):
        return [candidate(name, 0.0).start for name in ("bristles", "delay")]

    def open_it(_, item, starts):
        assert [start.candidate for start in starts] == ["bristles"]
        left, share = opened["bristles"]
        return SimpleNamespace(item=item, left=left, share=share)

    monkeypatch.setattr(hidden_starts, "starts_of", starts_of)
    monkeypatch.setattr(hidden_starts, "_opened", open_it)
    found = SimpleNamespace(
        problem=Hiding(),
        fit=SimpleNamespace(cost=COST, vector="calibrated"),
        excess_left=SimpleNamespace(total=MISSING),
        accepted=[],
    )
    return found, opened


FINALS = [candidate("delay", 120.0), candidate("bristles", 10.0)]


def test_what_explains_most_with_its_start_open_is_taken(search) -> None:
    found, opened = search
    opened["bristles"] = (20.0, 0.98)
    taken = _best_opened(found, FINALS, FINALS[0])
    assert taken is not None
    assert taken.item.candidate == "bristles"


@pytest.mark.parametrize(
    ("left", "share"),
    # it leaves nearly as much as the best does; or explains a smaller part than that, and what is
    # open explains the rest
    [(800.0, 0.9), (20.0, 0.1)],
)
def test_what_does_no_better_is_not(search, left: float, share: float) -> None:
    found, opened = search
    opened["bristles"] = left, share
    assert _best_opened(found, FINALS, FINALS[0]) is None


def test_where_nearly_all_is_explained_nothing_is_tried(search) -> None:
    found, _ = search
    finals = [candidate("delay", 950.0), candidate("bristles", 10.0)]
    assert _best_opened(found, finals, finals[0]) is None
    assert with_hidden_starts(found, finals) == finals
    assert with_hidden_starts(found, []) == []

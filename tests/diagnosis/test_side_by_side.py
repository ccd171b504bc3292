"""What is done side by side, here or by workers, is done as by one, counted, and interrupted."""

from __future__ import annotations

import threading

import pytest

from eha_bench.core.interruption import checkpoint, checkpoints
from eha_bench.core.workers import InProcess, Processes, WorkError, Workers
from eha_bench.diagnosis.fit import side_by_side as module
from eha_bench.diagnosis.fit.effort import count_simulated_time, note_simulated_time
from eha_bench.diagnosis.fit.side_by_side import fits_by, is_one_of_several, side_by_side

EVERYWHERE = pytest.mark.parametrize(
    "workers", [InProcess(), Processes(2)], ids=["here", "processes"]
)


@pytest.fixture(autouse=True)
def _two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PROCESSORS", 2)


@EVERYWHERE
def test_values_come_in_the_order_of_the_items(workers: Workers) -> None:
    with fits_by(workers):
        assert side_by_side(lambda k: k * k, range(20)) == [k * k for k in range(20)]
        assert side_by_side(lambda k: k, []) == []
        assert all(side_by_side(lambda _: is_one_of_several(), range(4)))
    assert not is_one_of_several()


def test_items_run_at_the_same_time_each_on_one_thread() -> None:
    both = threading.Barrier(2, timeout=10.0)

    def meet(_: int) -> tuple[bool, bool]:
        both.wait()  # times out unless two run at once
        return is_one_of_several(), all(side_by_side(lambda _: is_one_of_several(), range(3)))

    assert side_by_side(meet, range(2)) == [(True, True)] * 2
    assert not is_one_of_several()


@EVERYWHERE
def test_what_is_simulated_there_is_counted_here(workers: Workers) -> None:
    with count_simulated_time() as spent, fits_by(workers):
        side_by_side(lambda k: note_simulated_time(float(k)), range(5))
    assert sum(spent) == 10.0


@EVERYWHERE
def test_a_stop_that_is_asked_for_here_stops_there(workers: Workers) -> None:
    with fits_by(workers), checkpoints(lambda: True), pytest.raises(KeyboardInterrupt):
        side_by_side(lambda _: checkpoint(), range(4))


@EVERYWHERE
def test_an_error_is_raised_here(workers: Workers) -> None:
    def fails(k: int) -> int:
        if k == 3:
            raise ValueError("three")
        return k

    with fits_by(workers), pytest.raises((ValueError, WorkError), match="three"):
        side_by_side(fails, range(6))

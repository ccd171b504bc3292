"""Progress that is repeated while a long stage goes on."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from eha_bench.core import progress
from eha_bench.core.interruption import checkpoint, result_at_checkpoints
from eha_bench.core.progress import live_progress, still_at_work


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_the_last_call_is_repeated_at_checkpoints_when_a_second_has_passed(
    clock: list[float],
) -> None:
    calls: list[tuple[str, float]] = []
    with live_progress(lambda *call: calls.append(call)) as live:
        still_at_work()  # nothing was said yet
        live("search", 0.25)
        clock[0] += 0.9
        checkpoint()
        assert calls == [("search", 0.25)]
        clock[0] += 0.2
        checkpoint()
        checkpoint()
    clock[0] += 5.0
    checkpoint()
    assert calls == [("search", 0.25)] * 2


def test_only_the_thread_that_asked_for_progress_hears_of_it(clock: list[float]) -> None:
    heard: list[int] = []
    with live_progress(lambda *_: heard.append(threading.get_ident())) as live:
        live("search", 0.0)
        clock[0] += 2.0
        other = threading.Thread(target=live.repeat_if_due)
        other.start()
        other.join()
        assert len(heard) == 1
        live.repeat_if_due()
    assert heard == [threading.get_ident()] * 2


def test_progress_is_repeated_while_others_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Many short pieces of work, none of which is as long as the time between two calls."""
    monkeypatch.setattr(progress, "REPEATED_AFTER", 0.05)
    heard: list[float] = []
    with ThreadPoolExecutor(1) as pool, live_progress(lambda *_: heard.append(1.0)) as live:
        live("search", 0.5)
        for future in [pool.submit(time.sleep, 0.02) for _ in range(20)]:
            result_at_checkpoints(future)
    assert len(heard) >= 4

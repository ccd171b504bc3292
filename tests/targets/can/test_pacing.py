"""Loop health is counted, and decides whether a trial can be scored."""

import gc
import math
import os

import pytest

from eha_bench.targets.can.pacing import LoopHealth, Pacer, RealTime


def test_health_counts_ticks_and_frames() -> None:
    health = LoopHealth(10, 1e-3, 2)
    for tick in range(8):
        health.tick(tick * 1e-3 + (2e-3 if tick == 7 else 0.0), 2e-3 if tick == 7 else 0.0, 0)
        health.on_time += 2 if tick < 6 else 0
    health.late = 1
    found = health.metadata((0.5, 0.5, 0.5))
    assert found["loop_overruns"] == "1"
    assert found["loop_lost_frames"] == "3"
    assert found["loop_late_frames"] == "1"
    assert float(found["loop_period_p50"]) == pytest.approx(1e-3)
    assert float(found["loop_period_max"]) == pytest.approx(3e-3)
    assert found["loop_unhealthy"] == ""


@pytest.mark.parametrize(
    ("field", "word"), [("overruns", "overran"), ("late", "late"), ("on_time", "lost")]
)
def test_a_loop_that_is_too_bad_says_why(field: str, word: str) -> None:
    health = LoopHealth(100, 1e-3, 1)
    for tick in range(100):
        health.tick(tick * 1e-3, 0.0, 0)
    health.on_time = 100
    setattr(health, field, 2 if field != "on_time" else 98)
    if field == "late":
        health.on_time = 98
    assert word in health.trouble(0.01, 0.01, 0.01)
    assert health.trouble(0.02, 0.02, 0.02) == ""


def test_skipped_ticks_are_overruns() -> None:
    health = LoopHealth(10, 1e-3, 1)
    health.tick(0.0, 0.0, 0)
    health.tick(4e-3, 0.0, 3)
    assert health.overruns == 4


def test_a_loop_without_ticks_has_no_period() -> None:
    found = LoopHealth(0, 1e-3, 2).metadata((0.01, 0.01, 0.01))
    assert math.isnan(float(found["loop_period_p50"]))


def test_a_tick_never_comes_before_its_deadline() -> None:
    pacer = Pacer(1e-3, spin=2e-4)
    for tick in range(5):
        assert pacer.wait(tick) >= pacer.start + tick * 1e-3
    assert pacer.due_tick(pacer.start + 4.5e-3) == 4


def test_the_process_is_ordinary_again_afterwards() -> None:
    before = os.sched_getscheduler(0)
    with RealTime(1):
        assert not gc.isenabled()
    assert gc.isenabled()
    assert os.sched_getscheduler(0) == before

"""Simulated time is counted inside its context only."""

from __future__ import annotations

from eha_bench.diagnosis.fit.effort import count_simulated_time, note_simulated_time


def test_only_what_is_simulated_inside_is_counted():
    note_simulated_time(5.0)
    with count_simulated_time() as spent:
        note_simulated_time(2.0)
        with count_simulated_time() as inner:
            note_simulated_time(3.0)
    note_simulated_time(7.0)
    assert (sum(spent), sum(inner)) == (2.0, 3.0)

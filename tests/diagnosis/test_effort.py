"""Simulated time is counted inside its context only."""

from __future__ import annotations

from eha_bench.diagnosis.fit.effort import counted, simulated


def test_only_what_is_simulated_inside_is_counted():
    simulated(5.0)
    with counted() as spent:
        simulated(2.0)
        with counted() as inner:
            simulated(3.0)
    simulated(7.0)
    assert (sum(spent), sum(inner)) == (2.0, 3.0)

"""Where a model errs most: one channel's range, told by the errors of all others."""

from __future__ import annotations

import math

import pytest

from eha_bench.diagnosis.outcome.worst_range import worst_range
from eha_bench.diagnosis.replay.error_by_value import ErrorBin, ErrorByValue

FLOORS = {"pressure_a": 1e4, "pressure_b": 1e4, "speed": 1e-3}


def table(channel: str, by: str, errors: list[float], ends: tuple[float, float] = (0.0, 0.05)):
    step = (ends[1] - ends[0]) / len(errors)
    bins = tuple(
        ErrorBin(ends[0] + k * step, ends[0] + (k + 1) * step, error, 2.0, 1.0)
        for k, error in enumerate(errors)
    )
    return ErrorByValue(channel, "Pa", by, "m", None, bins, None)


def test_the_range_at_whose_end_all_channels_err_is_named() -> None:
    found = worst_range(
        [
            table("pressure_a", "position", [4e4, 3e4, 5e4, 4e4, 4e6]),
            table("pressure_b", "position", [4e4, 3e4, 4e4, 6e4, 8e6]),
            # a pressure is high there as well, but not there alone
            table("pressure_a", "pressure_b", [4e4, 5e5, 6e5, 2e6, 3e6]),
        ],
        FLOORS,
    )
    assert found is not None
    assert (found.by, found.channel) == ("position", "pressure_b")
    assert (found.low, found.high) == pytest.approx((0.04, 0.05))
    assert found.elsewhere == pytest.approx(4e4)
    assert found.words() == (
        "the model errs most where position is 0.04 to 0.05 m: pressure_b by 8e+06 Pa, 4e+04 Pa "
        "elsewhere"
    )


def test_errors_that_are_alike_or_noise_or_their_own_channels_name_nothing() -> None:
    alike = table("pressure_a", "position", [4e4, 5e4, 7e4, 5e4, 4e4])
    # five times the others, and still no more than noise may be taken for
    noise = table("pressure_b", "position", [2e3, 2e3, 2e3, 2e3, 1e4])
    own = table("speed", "speed", [1.0, 1.0, 1.0, 1.0, 50.0])
    nothing = table("pressure_a", "speed", [math.nan] * 5)
    assert worst_range([alike, noise, own, nothing], FLOORS) is None
    assert worst_range([], FLOORS) is None


def test_one_channel_of_several_that_errs_there_is_not_enough() -> None:
    tables = [
        table("pressure_a", "position", [4e4, 4e4, 4e4, 4e4, 2e5]),
        table("pressure_b", "position", [4e4, 4e4, 4e4, 4e4, 2e4]),
        table("speed", "position", [1.0, 1.0, 1.0, 1.0, 1.0]),
    ]
    assert worst_range(tables, FLOORS) is None
    assert worst_range(tables[:1], FLOORS) is not None

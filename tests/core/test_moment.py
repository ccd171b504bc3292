"""Moments of results, in whatever time zone they were written."""

import math

import pytest

from eha_bench.core.moment import seconds_of


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("1970-01-02T00:00:00+00:00", 86_400.0),
        ("1970-01-02T02:00:00+02:00", 86_400.0),
        ("1970-01-02T00:00:00", 86_400.0),
        ("1970-01-02", 86_400.0),
        ("yesterday", math.nan),
        ("", math.nan),
    ],
)
def test_a_moment_is_the_same_in_every_time_zone(text: str, seconds: float) -> None:
    assert seconds_of(text) == pytest.approx(seconds, nan_ok=True)

"""What lies beyond recordings: a tenth of their range, and more than their noise."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.posterior.covered import Covered, CoveredSetup

FREE = CoveredSetup("free", "closed", {"speed": (-10.0, 10.0), "position": (0.02, 0.02)})
COVERED = Covered(
    1000.0, 20.0, {"command": (-1.0, 1.0, 0.1)}, {"speed": 0.1, "position": 1e-4}, {}, (FREE,)
)


@pytest.mark.parametrize(
    ("low", "high", "beyond"),
    [
        (-9.0, 9.0, []),
        (-12.0, 11.0, []),  # a tenth of the range
        (-10.0, 12.5, [("speed", 12.5, 0.125)]),
        (-30.0, 14.0, [("speed", -30.0, 1.0)]),
    ],
)
def test_a_tenth_of_the_range_is_no_extrapolation(low, high, beyond):
    found = list(COVERED.beyond(FREE, {"speed": (low, high)}))
    assert [(item.channel, item.reached, pytest.approx(item.distance)) for item in found] == beyond


def test_a_channel_that_stood_still_may_move_by_its_noise():
    assert not list(COVERED.beyond(FREE, {"position": (0.0196, 0.0204)}))
    (found,) = COVERED.beyond(FREE, {"position": (0.02, 0.03)})
    assert found.reached == 0.03


def test_channels_that_were_not_recorded_are_not_asked():
    assert not list(COVERED.beyond(FREE, {"torque": (-1e9, 1e9)}))


def test_a_setup_is_found_by_both_of_its_words():
    assert COVERED.setup("free", "closed") is FREE
    assert COVERED.setup("free", "open") is None


@given(st.floats(-1e6, 1e6), st.floats(0.0, 1e6), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_nothing_within_a_recorded_range_is_beyond_it(low, width, one, other):
    setup = CoveredSetup("free", "closed", {"speed": (low, low + width)})
    least, most = sorted((low + one * width, low + other * width))
    inside = max(least, low), min(most, low + width)
    assert not list(COVERED.beyond(setup, {"speed": inside}))


def test_it_is_read_as_it_was_written():
    content = json.loads(json.dumps(COVERED.to_dict()))
    assert Covered.from_dict(content) == COVERED
    empty = Covered.from_dict({})
    assert (empty.setups, empty.unexplained) == ((), {})

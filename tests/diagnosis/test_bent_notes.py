"""Runs that were never fitted, on which a model is worse than the declared, or calibrated, one."""

import math

import pytest

from eha_bench.diagnosis.replay.errors_by_channel import ChannelError, bent_notes, spoiled_notes

# a rod whose friction fell with the oil's temperature, which nobody had declared
BENT = ChannelError(17.0, 102.0, 93.0, 1.5, "rpm")


def test_it_is_said_with_both_errors() -> None:
    (note,) = bent_notes({"motor_speed": BENT}, "held-out")
    assert note.startswith("CAUTION: on held-out runs the fitted model errs 5.47 times as much")
    assert "'motor_speed' (93 for 17 rpm)" in note


def test_only_the_worst_channel_is_named() -> None:
    other = ChannelError(1.0, 2.0, 2.0, 0.1, "Pa")
    (note,) = bent_notes({"a": other, "motor_speed": BENT}, "unseen")
    assert "motor_speed" in note


@pytest.mark.parametrize(
    "error",
    [
        ChannelError(17.0, 5.0, 3.0, 1.5, "rpm"),
        ChannelError(17.0, 20.0, 20.0, 1.5, "rpm"),
        ChannelError(1.0, 2.0, 2.0, 1.5, "rpm"),
        ChannelError(0.0, 2.0, 2.0, 0.1, "rpm"),
        ChannelError(math.inf, math.inf, math.inf, 0.1, "rpm"),
        ChannelError(math.nan, math.nan, math.nan, 0.1, "rpm"),
    ],
    ids=["better", "a little worse", "in the noise", "exact", "diverges", "nothing measured"],
)
def test_nothing_is_said_otherwise(error: ChannelError) -> None:
    assert not list(bent_notes({"motor_speed": error}, "held-out"))


def test_a_channel_that_errs_more_with_what_was_added_is_named() -> None:
    # a gear of 9 declared as 10, which an encoder's eccentricity imitates in the speed
    speed = ChannelError(47.0, 17.7, 2.75, 2.6, "rpm")
    angle = ChannelError(0.07, 5.3e-4, 9.0e-4, 1.3e-4, "rad")
    (note,) = spoiled_notes({"motor_speed": speed, "joint_angle": angle}, "held-out")
    assert note.startswith("CAUTION: on held-out runs 'joint_angle' errs 1.7 times as much")
    assert "(0.0009 for 0.00053 rad)" in note
    assert not list(spoiled_notes({"motor_speed": speed}, "held-out"))


@pytest.mark.parametrize("before", [4e-4, 0.0, 9e-4], ids=["a little", "exact", "as before"])
def test_what_is_hardly_worse_is_not_spoiled(before: float) -> None:
    angle = ChannelError(0.07, before, 5e-4, 1.3e-4, "rad")
    assert not list(spoiled_notes({"joint_angle": angle}, "held-out"))

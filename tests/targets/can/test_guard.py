"""What is checked at every tick before the command goes out."""

import math

import pytest

from eha_bench.core.limit import Bounds, SafetyLimit
from eha_bench.core.linkage import Linkage
from eha_bench.targets.can.drive import Drive
from eha_bench.targets.can.guard import ChannelLimit, Following, Guard, Limits

LINKAGE = Linkage(0.3208, 0.0462, 0.280, 0.04)


def guard(
    *limits: ChannelLimit, following: tuple[Following, ...] = (), agrees: float = math.inf
) -> Guard:
    return Guard(Limits(limits, following, agrees), (), LINKAGE)


def walk(checked: Guard, values: list[float], period: float = 1e-3) -> list[str]:
    """Return what is said at each of the ticks."""
    said = []
    for tick, value in enumerate(values):
        now = tick * period
        said.append(checked.check(now, {"current": value}, {"current": now}))
    return said


@pytest.mark.parametrize(
    ("limit", "values", "word"),
    [
        (ChannelLimit("current", high=5.0), [1.0, 4.9, 5.1], "outside"),
        (ChannelLimit("current", low=-5.0), [1.0, -4.9, -5.1], "outside"),
        (ChannelLimit("current"), [1.0, 2.0, math.nan], "outside"),
        (ChannelLimit("current", rate=900.0), [1.0, 1.8, 2.8], "changes by"),
        (ChannelLimit("current", frozen=2e-3), [1.0, 2.0, 2.0, 2.0], "frozen"),
    ],
)
def test_the_first_bad_tick_is_named(limit: ChannelLimit, values: list[float], word: str) -> None:
    *before, last = walk(guard(limit), values)
    assert not any(before)
    assert word in last
    assert "current" in last


def test_a_value_that_is_too_old_is_stale() -> None:
    checked = guard(ChannelLimit("current", stale=10e-3))
    assert checked.check(0.009, {"current": 1.0}, {"current": 0.0}) == ""
    assert "stale current" in checked.check(0.011, {"current": 1.0}, {"current": 0.0})
    assert "stale current" in guard(ChannelLimit("current", stale=10e-3)).check(1.0, {}, {})


def test_every_channel_is_watched_for_age_even_without_a_limit(eha_drive: Drive) -> None:
    bare = Limits.of(eha_drive)
    assert {limit.channel for limit in bare.channels} == set(eha_drive.channels)
    assert all(math.isfinite(limit.stale) for limit in bare.channels)


def test_a_channel_has_to_follow_its_command_in_the_end() -> None:
    checked = guard(following=(Following("current", 2.0, 3e-3),))
    said = [checked.follows(tick * 1e-3, {"current": 0.0}, 10.0) for tick in range(4)]
    assert [bool(text) for text in said] == [False, False, False, True]
    assert checked.follows(0.004, {"current": 9.0}, 10.0) == ""
    assert checked.follows(0.005, {"current": 0.0}, 10.0) == ""


def test_joint_and_rod_have_to_agree() -> None:
    checked = guard(agrees=0.01)
    angle = LINKAGE.angle_at(0.01)
    assert checked.check(0.0, {"piston_position": 0.01, "joint_angle": angle}, {}) == ""
    said = checked.check(0.0, {"piston_position": 0.01, "joint_angle": angle + 0.02}, {})
    assert "does not agree" in said


def test_the_suites_own_safety_limits_hold_too() -> None:
    limit = SafetyLimit("pressure_a", Bounds(high=60e6), "<= 60 MPa")
    checked = Guard(Limits((), (), math.inf), (limit,), None)
    assert checked.check(0.0, {"pressure_a": 1e6}, {}) == ""
    assert "<= 60 MPa" in checked.check(0.0, {"pressure_a": 61e6}, {})
    assert "<= 60 MPa" in checked.check(0.0, {}, {})

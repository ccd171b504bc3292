"""What is checked at every tick before the command goes out."""

import math

import pytest

from eha_bench.core.limit import Bounds, SafetyLimit
from eha_bench.core.linkage import Linkage
from eha_bench.targets.can.balance import Balance, BalanceLimits, Tolerance, TorqueModel
from eha_bench.targets.can.drive import CanDrive
from eha_bench.targets.can.guard import ChannelLimit, Following, Guard, GuardLimits

LINKAGE = Linkage(0.3208, 0.0462, 0.280, 0.04)


def guard(
    *limits: ChannelLimit, following: tuple[Following, ...] = (), agrees: float = math.inf
) -> Guard:
    return Guard(GuardLimits(limits, following, agrees), (), LINKAGE)


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


def test_every_channel_is_watched_for_age_even_without_a_limit(eha_drive: CanDrive) -> None:
    bare = GuardLimits.of(eha_drive)
    assert {limit.channel for limit in bare.channels} == set(eha_drive.channels)
    assert all(math.isfinite(limit.stale) for limit in bare.channels)


def test_a_sample_after_a_gap_may_repeat_the_one_before() -> None:
    checked = guard(ChannelLimit("current", frozen=5e-3, stale=1.0))
    for now in (0.0, 0.02, 0.04):
        assert checked.check(now, {"current": 1.0}, {"current": now}) == ""


def test_a_channel_has_to_follow_its_command_in_the_end() -> None:
    checked = guard(following=(Following("current", 2.0, 3e-3),))
    said = []
    for tick in range(4):
        now = tick * 1e-3
        said.append(checked.follows(now, {"current": 0.0}, {"current": now}, 10.0))
    assert [bool(text) for text in said] == [False, False, False, True]
    assert checked.follows(0.004, {"current": 9.0}, {"current": 0.004}, 10.0) == ""
    assert checked.follows(0.005, {"current": 0.0}, {"current": 0.005}, 10.0) == ""
    # what is not fresh says nothing about the newest command
    assert checked.follows(0.010, {"current": 0.0}, {"current": 0.005}, 10.0) == ""


def test_joint_and_rod_have_to_agree() -> None:
    checked = guard(agrees=0.01)
    angle = LINKAGE.angle_at(0.01)
    assert checked.check(0.0, {"piston_position": 0.01, "joint_angle": angle}, {}) == ""
    said = checked.check(0.0, {"piston_position": 0.01, "joint_angle": angle + 0.02}, {})
    assert "does not agree" in said


def test_the_suites_own_safety_limits_hold_too() -> None:
    limit = SafetyLimit("pressure_a", Bounds(high=60e6), "<= 60 MPa")
    checked = Guard(GuardLimits((), (), math.inf), (limit,), None)
    assert checked.check(0.0, {"pressure_a": 1e6}, {}) == ""
    assert "<= 60 MPa" in checked.check(0.0, {"pressure_a": 61e6}, {})
    assert "<= 60 MPa" in checked.check(0.0, {}, {})


MODEL = TorqueModel(0.13, 0.69e-6 / (2 * math.pi), 0.005, 0.003)


def balanced(scale: float, stuck: bool) -> list[str]:
    """Accelerate the motor at 10 A against rising pressure, the rod moving; return what is said."""
    limits = BalanceLimits(5e-3, Tolerance(0.1, 0.1), Tolerance(1e-3, 0.1), MODEL)
    balance, said, speed = Balance(limits, 1e-3), [], 0.0
    for tick in range(40):
        time, pressure = tick * 1e-3, 2e8 * tick * 1e-3
        torque = 1.3 - MODEL.displacement * pressure - MODEL.viscous * speed
        reading = {
            "current": 10.0,
            "motor_speed": speed,
            "pressure_difference": pressure * scale,
            "piston_position": 0.0 if stuck else 0.05 * time,
            "piston_velocity": 0.05,
        }
        said.append(balance.check(time, reading))
        speed += torque / MODEL.inertia * 1e-3
    return said


@pytest.mark.parametrize(
    ("scale", "stuck", "word"),
    [(1.0, False, ""), (3.0, False, "pressures contradict"), (1.0, True, "piston_velocity")],
)
def test_signals_that_contradict_each_other_are_found(scale: float, stuck: bool, word: str) -> None:
    said = [text for text in balanced(scale, stuck) if text]
    assert bool(said) == bool(word)
    assert not word or word in said[0]


def test_a_window_with_a_gap_is_not_believed() -> None:
    limits = BalanceLimits(3e-3, None, Tolerance(1e-3, 0.1), MODEL)
    balance = Balance(limits, 1e-3)
    reading = {"piston_position": 0.0, "piston_velocity": 1.0}
    assert not any(balance.check(tick * 1.5e-3, reading) for tick in range(20))


def test_answers_that_came_late_are_no_jump_and_not_frozen() -> None:
    """After a stall several answers show the same moment under earlier stamps."""
    checked = guard(ChannelLimit("current", rate=900.0, frozen=2e-3))
    assert checked.check(0.000, {"current": 1.0}, {"current": 0.000}) == ""
    for age in (4e-3, 3e-3, 2e-3, 1e-3):
        assert checked.check(0.005, {"current": 5.0}, {"current": 0.005 - age}) == ""
    assert checked.check(0.006, {"current": 5.4}, {"current": 0.006}) == ""
    assert "changes by" in checked.check(0.007, {"current": 7.0}, {"current": 0.007})

"""Effects of the firmware of a position loop, each against a case worked by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive
from eha_bench.plants.registry import get_plant

NAMES = ("reference_rate_limit", "reference_delay", "position_deadband", "integral_action")
FORMS = [
    ("reference_rate_limit", {"form": "rate"}),
    ("reference_rate_limit", {"form": "trapezoid"}),
    ("reference_delay", {}),
    ("position_deadband", {"form": "shifted"}),
    ("position_deadband", {"form": "jump"}),
    ("integral_action", {}),
]
P, D, T = 6.0, 0.1, 1e-3
FREE = {"gear_friction.coulomb": 0.0}
# what holds the pendulum level, as a share of 12 V: m g l R / (n K_T V)
LEVEL = 0.8 * 9.80665 * 0.18 * 2.3 / (193 * 0.0083 * 12.0)


def vector_of(effect: str = "", **values: Any) -> FloatArray:
    declared = (DeclaredEffect(effect, values),) if effect else ()
    return Model("position_servo", FREE, (), declared).vector()


def run(
    goal: FloatArray, effect: str = "", start: float = 0.0, period: float = T, **values: Any
) -> dict[str, FloatArray]:
    plant = get_plant("position_servo")
    drive = Drive(
        ticks(goal.size, period), {"goal_position": goal}, {"angle": start, "velocity": 0.0}
    )
    out = plant.simulate(vector_of(effect, **values), drive, 1e-4)
    return dict(zip(plant.outputs, out.T, strict=True))


def ticks(count: int, period: float = T) -> FloatArray:
    return np.asarray(period * np.arange(count), dtype=np.float64)


def stepped(size: float, seconds: float = 1.0) -> FloatArray:
    """A goal that steps after a tenth of a second."""
    goal = np.zeros(round(seconds / T))
    goal[100:] = size
    return goal


# --- reference_rate_limit -----------------------------------------------------------------------


def test_a_limited_step_is_a_ramp() -> None:
    """At 0.5 rad/s a step of 0.2 rad is a ramp of 0.5 mrad a period, from its first period on."""
    goal = stepped(0.2)
    ramp = np.minimum(0.5 * T * np.maximum(np.arange(goal.size) - 99, 0), 0.2)
    limited = run(goal, "reference_rate_limit", time_per_unit=2.0)
    np.testing.assert_allclose(limited["angle"], run(ramp)["angle"], atol=1e-9)
    assert np.max(np.abs(limited["angle"] - run(goal)["angle"])) > 0.1


def test_a_limit_goes_on_between_the_samples_of_a_slow_log() -> None:
    """A goal sent each 20 ms is followed at the loop's own period."""
    slow = stepped(0.2)[::20]
    limited = run(slow, "reference_rate_limit", period=0.02, time_per_unit=2.0)
    fast = run(stepped(0.2), "reference_rate_limit", time_per_unit=2.0)
    np.testing.assert_allclose(limited["angle"], fast["angle"][::20], atol=1e-9)


def test_a_trapezoid_takes_the_way_over_its_speed_and_the_speed_over_its_acceleration() -> None:
    """0.4 rad at 1 rad/s and 5 rad/s^2: 0.2 s each way, 0.6 s in all; at half way 0.2 rad."""
    goal = stepped(0.4)
    t = T * np.arange(goal.size) - 0.1
    begins, ends = 2.5 * np.clip(t, 0.0, 0.2) ** 2, 2.5 * np.clip(0.6 - t, 0.0, 0.2) ** 2
    profile = np.where(t < 0.2, begins, np.where(t < 0.4, t - 0.1, 0.4 - ends))
    profiled = run(goal, "reference_rate_limit", time_per_unit=1.0, ramp_time=0.2, form="trapezoid")
    np.testing.assert_allclose(profiled["angle"], run(profile)["angle"], atol=2e-3)


def test_a_window_begins_where_the_limited_reference_was() -> None:
    """After 0.3 s at 0.5 rad/s a reference is half way to 0.3 rad: no reading says so."""
    assert_begins_where_it_was(stepped(0.3), 350, "reference_rate_limit", time_per_unit=2.0)


def assert_begins_where_it_was(goal: FloatArray, before: int, effect: str, **values: Any) -> None:
    """A window of a run, of which so many rows before are known, is a part of it."""
    whole = run(goal, effect, **values)
    plant, first = get_plant("position_servo"), 400
    rows = slice(first - before, first + 100)
    start = {name: float(whole[name][first]) for name in ("angle", "velocity")}
    drive = Drive(ticks(goal.size)[rows], {"goal_position": goal[rows]}, start, first=before)
    vector = vector_of(effect, **values)
    window = plant.simulate(vector, drive, 1e-4)[before:, list(plant.outputs).index("angle")]
    np.testing.assert_allclose(window, whole["angle"][first : first + 100], atol=1e-4)


# --- reference_delay ----------------------------------------------------------------------------


def test_a_late_reference_is_the_same_answer_later() -> None:
    """12 ms late: twelve periods; 2.5 ms: half of the step is there after two, all after three."""
    goal = stepped(0.2)
    late = run(goal, "reference_delay", delay=0.012)["angle"]
    np.testing.assert_allclose(late[12:], run(goal)["angle"][:-12], atol=1e-9)
    between = goal.copy()
    between[100:103] = (0.0, 0.0, 0.1)
    late = run(goal, "reference_delay", delay=2.5e-3)["angle"]
    np.testing.assert_allclose(late, run(between)["angle"], atol=1e-9)


def test_a_reference_is_late_between_the_samples_of_a_slow_log() -> None:
    slow = run(stepped(0.2)[::20], "reference_delay", period=0.02, delay=7e-3)
    fast = run(stepped(0.2), "reference_delay", delay=7e-3)
    np.testing.assert_allclose(slow["angle"], fast["angle"][::20], atol=1e-9)


def test_a_window_begins_with_what_was_asked_for_before_it() -> None:
    goal = 0.3 * np.sin(np.arange(600) / 40.0)
    assert_begins_where_it_was(goal, 60, "reference_delay", delay=0.03)


def test_a_late_reference_leaves_the_loop_as_stiff_as_it_is() -> None:
    """A weight that is let go is held as soon; a delay behind the loop makes it swing."""
    goal = np.zeros(1000)
    plain, late, behind = (
        run(goal, name, 0.2, **values)["angle"]
        for name, values in (("", {}), ("reference_delay", {"delay": 0.05}),
                             ("command_delay", {"delay": 0.05}))
    )  # fmt: skip
    np.testing.assert_allclose(late, plain, atol=1e-9)
    assert np.max(np.abs(behind - plain)) > 1e-2


# --- position_deadband --------------------------------------------------------------------------


def test_a_goal_within_the_zone_moves_nothing() -> None:
    for form in ("shifted", "jump"):
        within = run(stepped(0.019), "position_deadband", deadband=0.02, form=form)
        assert np.max(np.abs(within["angle"])) == 0.0
    assert np.max(run(stepped(0.021), "position_deadband", deadband=0.02)["angle"]) > 5e-4


def test_a_shifted_zone_adds_to_what_a_weight_pulls_off() -> None:
    """Held at an angle a: P (e - d) = LEVEL sin a."""
    goal = np.full(4000, 0.5)
    for zone in (0.0, 0.03):
        effect = "position_deadband" if zone else ""
        held = run(goal, effect, 0.4, **({"deadband": zone} if zone else {}))["angle"][-1]
        assert 0.5 - held == pytest.approx(zone + LEVEL * math.sin(held) / P, rel=1e-3)


def test_a_jump_passes_the_whole_error_beyond_it() -> None:
    """At the first sample of a step of 0.1 rad: P e, or P (e - d)."""
    jump = run(stepped(0.1, 0.11), "position_deadband", deadband=0.03, form="jump")
    shifted = run(stepped(0.1, 0.11), "position_deadband", deadband=0.03)
    assert jump["duty"][100] == pytest.approx(P * 0.1)
    assert shifted["duty"][100] == pytest.approx(P * 0.07)


def test_a_zone_before_the_limit_leaves_full_command_as_it_is() -> None:
    """Of a way that asks for more than all, nothing is missing at first: behind the limit it is."""
    goal = stepped(2.0, 0.2)
    plain, before = run(goal), run(goal, "position_deadband", deadband=0.02)
    behind = run(goal, "current_deadband", deadband=0.12)
    np.testing.assert_array_equal(before["angle"][:150], plain["angle"][:150])
    assert plain["angle"][150] - behind["angle"][150] > 0.05 * plain["angle"][150]


# --- integral_action ----------------------------------------------------------------------------


def test_the_integral_part_is_the_sum_of_the_errors() -> None:
    """c_k = K_i T (e_0 + ... + e_k), on top of P e - D v."""
    goal = stepped(0.05)
    found = run(goal, "integral_action", integral_gain=12.0, limit=1.0)
    error = goal - found["angle"]
    back = np.concatenate([[0.0, 0.0], found["angle"][:-2]])
    law = P * error - D * (found["angle"] - back) / (2.0 * T)
    np.testing.assert_allclose(found["duty"] - law, 12.0 * T * np.cumsum(error), atol=1e-9)


@pytest.mark.parametrize("limit", [1.0, 0.05])
def test_an_integral_holds_a_weight_as_far_as_its_limit_goes(limit: float) -> None:
    """P e = LEVEL sin a - c with c = min(LEVEL sin a, limit)."""
    assert 0.05 < LEVEL * math.sin(0.5) < 1.0
    goal = np.full(8000, 0.5)
    held = run(goal, "integral_action", 0.4, integral_gain=10.0, limit=limit)["angle"][-1]
    missing = max(0.0, LEVEL * math.sin(held) - limit)
    assert 0.5 - held == pytest.approx(missing / P, abs=2e-5)


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_an_integral_begins_with_what_the_law_leaves_of_a_weight(share: float) -> None:
    """Sagged by a share of LEVEL sin a / P the law holds that share: the rest was gathered."""
    angle = 0.4
    weight = LEVEL * math.sin(angle)
    goal = np.full(300, angle + share * weight / P)
    found = run(goal, "integral_action", angle, integral_gain=1e-9, limit=1.0)
    np.testing.assert_allclose(found["duty"], weight, rtol=1e-6)
    np.testing.assert_allclose(found["angle"], angle, atol=1e-6)


@pytest.mark.parametrize(("asked", "begins"), [(0.3, 0.0), (-0.3, 1.0)])
def test_a_step_at_the_first_sample_is_no_integral(asked: float, begins: float) -> None:
    """Its part is between nothing and what holds the weight, and within its limit."""
    weight = LEVEL * math.sin(0.4)
    for limit in (1.0, 0.3 * weight):
        goal = np.full(20, 0.4 + asked)
        duty = run(goal, "integral_action", 0.4, integral_gain=1e-9, limit=limit)["duty"][0]
        assert duty - P * asked == pytest.approx(min(begins * weight, limit), abs=1e-6)


def test_what_an_integral_may_have_gathered_is_nothing_where_it_is_weak() -> None:
    """A tenth of a second of 1 / P rad at most, and never beyond its limit."""
    plant = get_plant("position_servo")

    def hidden(**values: float) -> float:
        (reach,) = plant.at(vector_of("integral_action", **values)).hidden.values()
        return reach

    full = 1.0 / P
    assert hidden(integral_gain=1e-6, limit=1.0) == pytest.approx(0.1 * 1e-6 * full)
    assert hidden(integral_gain=6.0, limit=1.0) == pytest.approx(0.1 * 6.0 * full)
    assert hidden(integral_gain=600.0, limit=0.2) == pytest.approx(0.2)


# --- all of them --------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "form"), FORMS)
def test_neutral_strength_is_the_declared_model_to_the_last_bit(
    name: str, form: dict[str, Any]
) -> None:
    goal = 1.2 * np.sin(np.arange(1200) / 300.0)
    plant = get_plant("position_servo")
    drive = Drive(ticks(goal.size), {"goal_position": goal}, {})
    effect = plant.layout.effect(name)
    vector = vector_of(name, **form)
    vector[plant.layout.index[f"{name}.{effect.strength.name}"]] = effect.neutral
    expected = plant.simulate(vector_of(), drive, 1e-4)
    np.testing.assert_array_equal(plant.simulate(vector, drive, 1e-4), expected)
    # ... and beside an effect that is on, so that the kernel is that with all effects
    other = Model("position_servo", FREE, (), (DeclaredEffect("current_lag"),)).vector()
    mixed = np.where(vector == vector_of(), other, vector)
    both = plant.simulate(mixed, drive, 1e-4)
    np.testing.assert_array_equal(both, plant.simulate(other, drive, 1e-4))


@pytest.mark.parametrize(("name", "form"), FORMS)
def test_a_little_of_an_effect_changes_little(name: str, form: dict[str, Any]) -> None:
    goal = 1.2 * np.sin(np.arange(1200) / 300.0)
    effect = get_plant("position_servo").layout.effect(name)
    plain = run(goal)["angle"]
    usual = run(goal, name, **form)["angle"] - plain
    little = run(goal, name, **{effect.strength.name: 1e-4 * effect.strength.default}, **form)
    assert np.max(np.abs(usual)) > 1e-3
    assert np.max(np.abs(little["angle"] - plain)) < 0.05 * np.max(np.abs(usual))


def test_only_a_plant_whose_loop_is_given_a_reference_has_them() -> None:
    for plant, has in (("position_servo", True), ("linear_drive", True), ("geared_servo", False)):
        effects = {effect.id for effect in get_plant(plant).layout.effects}
        assert set(NAMES) <= effects if has else not set(NAMES) & effects
    spot = get_plant("position_servo").layout.effect("reference_rate_limit").spots[0]
    # no load: 12 V / (K_T n); all of the duty: 1 / P
    assert spot.usual["speed"] == pytest.approx(12.0 / (193 * 0.0083))
    assert spot.usual["position"] == pytest.approx(1.0 / P)

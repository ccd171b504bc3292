"""The control laws against ticks worked out by hand."""

import math

import pytest

from eha_bench.control.controller import Context, NoGains
from eha_bench.control.open_loop import OpenLoop
from eha_bench.control.pressure_pi import PressureGains, PressurePI
from eha_bench.control.profile import Profile, ProfileLimits
from eha_bench.control.sliding_mode import DesignModel, SlidingMode, SlidingModeGains
from eha_bench.control.speed_pi import SpeedGains, SpeedPI
from eha_bench.core.errors import InputError
from eha_bench.core.linkage import Linkage

CONTEXT = Context(period=1e-3, command_limit=30.0, linkage=Linkage(0.3208, 0.0462, 0.28, 0.04))


def pressure(**changes: float) -> PressurePI:
    values = {"k_1": 1e-6, "k_p": 0.5e-6, "k_i": 20e-6, "k_2": 0.1, **changes}
    return PressurePI(PressureGains.model_validate(values), CONTEXT)


def test_eq_11_by_hand() -> None:
    controller = pressure()
    reading = {"pressure_difference": 4e6, "motor_speed": 10.0}
    # 1e-6 * 10e6 + 0.5e-6 * 6e6 - 0.1 * 10 = 12 A; then the integral adds 20e-6 * 6e6 * 1e-3
    assert controller.step(10e6, reading) == pytest.approx(12.0)
    assert controller.step(10e6, reading) == pytest.approx(12.12)


def test_the_integral_does_not_wind_up_at_the_current_limit() -> None:
    controller = pressure()
    far = {"pressure_difference": 0.0, "motor_speed": 0.0}
    for _ in range(5000):
        assert controller.step(30e6, far) == 30.0
    there = {"pressure_difference": 30e6, "motor_speed": 0.0}
    assert controller.step(30e6, there) == pytest.approx(30.0)
    above = {"pressure_difference": 31e6, "motor_speed": 0.0}
    assert controller.step(30e6, above) == pytest.approx(29.5)


def test_the_integral_rests_in_the_dead_band() -> None:
    controller = pressure(dead_band=0.2e6)
    near = {"pressure_difference": 9.9e6, "motor_speed": 0.0}
    first = controller.step(10e6, near)
    assert [controller.step(10e6, near) for _ in range(10)] == [first] * 10


def test_open_loop_passes_the_reference_within_the_limit() -> None:
    controller = OpenLoop(NoGains(), CONTEXT)
    assert controller.step(12.5, {}) == 12.5
    assert controller.step(-99.0, {}) == -30.0


def test_speed_loop_limits_the_speed_that_is_asked_for() -> None:
    gains = SpeedGains.model_validate({"k_p": 0.1, "k_i": 1.0, "speed_limit": 100.0})
    controller = SpeedPI(gains, CONTEXT)
    assert controller.step(1e6, {"motor_speed": 0.0}) == pytest.approx(10.0)
    assert controller.step(1e6, {"motor_speed": 0.0}) == pytest.approx(10.1)


def sliding(**changes: float) -> SlidingMode:
    values = {
        "c": 30.0, "k": 5.0, "epsilon": 100.0, "phi": 1.0,
        "profile": {"rate": 60.0, "speed": 0.2, "acceleration": 1.0},
        "speed": {"k_p": 1.0, "k_i": 0.0, "speed_limit": 400.0},
        "model": {
            "pump_displacement": 1.1e-7, "piston_area": 3.1337e-4, "bulk_modulus": 900e6,
            "volume": 1.2535e-5, "leakage": 0.0, "load_mass": 60.0, "rod_viscous": 800.0,
        },
        **changes,
    }  # fmt: skip
    return SlidingMode(SlidingModeGains.model_validate(values), CONTEXT)


def at(angle: float, speed: float = 0.0) -> dict[str, float]:
    linkage = CONTEXT.linkage
    assert linkage is not None
    return {
        "piston_position": linkage.position_at(angle),
        "piston_velocity": 0.0,
        "pressure_difference": 0.0,
        "motor_speed": speed,
    }


def test_sliding_mode_asks_for_nothing_where_it_is() -> None:
    assert sliding().step(1.5, at(1.5)) == pytest.approx(0.0, abs=1e-9)


def test_sliding_mode_drives_towards_the_reference() -> None:
    for target in (1.2, 1.8):
        controller = sliding()
        controller.step(1.5, at(1.5))
        currents = [controller.step(target, at(1.5)) for _ in range(50)]
        assert math.copysign(1.0, currents[-1]) == math.copysign(1.0, target - 1.5)


def test_inside_the_boundary_layer_the_law_is_linear() -> None:
    # a rod off its reference by e at rest: s = c^2 e, u' = -(k/phi + epsilon) s / g
    linkage = CONTEXT.linkage
    assert linkage is not None
    design = DesignModel(
        pump_displacement=1.1e-7, piston_area=3.1337e-4, bulk_modulus=900e6, volume=1.2535e-5,
        leakage=0.0, load_mass=60.0, rod_viscous=800.0,
    )  # fmt: skip
    controller = sliding()
    controller.step(1.5, at(1.5))
    reading = at(1.5)
    reading["piston_position"] += 1e-5
    x = reading["piston_position"]
    stiffness = sum(900e6 / (1.2535e-5 + sign * 3.1337e-4 * x) for sign in (1, -1))
    g = design.piston_area * design.pump_displacement * stiffness / design.load_mass
    s = 30.0**2 * 1e-5
    assert controller.step(1.5, reading) == pytest.approx(-(5.0 + 100.0) * s / g, rel=1e-6)


def test_sliding_mode_needs_a_joint() -> None:
    with pytest.raises(InputError, match="needs a joint"):
        SlidingMode(sliding()._gains, Context(1e-3, 30.0))


def profile(speed: float = 0.1, acceleration: float = 0.5) -> Profile:
    return Profile(ProfileLimits(rate=60.0, speed=speed, acceleration=acceleration), 1e-3, 0.0)


def test_a_jump_is_followed_within_the_bounds_and_without_overshoot() -> None:
    moving = profile()
    path = [moving.step(0.05) for _ in range(2000)]
    assert max(abs(point.v) for point in path) <= 0.1 * 1.02
    assert max(abs(point.a) for point in path) <= 0.5 * 1.05
    assert max(point.x for point in path) <= 0.05 * 1.005
    assert path[-1].x == pytest.approx(0.05, abs=1e-5)


def test_a_smooth_target_is_followed_without_lag() -> None:
    # 20 mm at 1 Hz asks for 0.79 m/s^2, more than the bound for catching up
    moving = profile()
    error = 0.0
    for tick in range(3000):
        target = 0.02 * math.sin(2 * math.pi * tick * 1e-3)
        point = moving.step(target)
        if tick > 1500:
            error = max(error, abs(point.x - target))
    assert error < 0.02 * 0.02

"""Known answers of leakage, valves, air and areas."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.plants.effects import (
    entrained_air,
    external_leakage,
    oil_stiffening,
    relief_valve,
    turbulent_leakage,
    widening_leakage,
)
from eha_bench.plants.network.file import load_plant
from eha_bench.plants.plant import Drive

BETA, VOLUME = 9e8, 1.2535e-5


def _resting(knee, time, effects, p_a, p_b, **options):
    """Decay of both pressures with the piston locked and the shaft held at rest."""
    inputs = {"motor_speed": np.zeros(time.size)}
    start = {"pressure_a": p_a, "pressure_b": p_b}
    return knee.run(time, inputs, *effects, initial=start, **options)


def test_orifice_decays_linearly_in_the_root(bare_knee, effect) -> None:
    """d sqrt(dp) / dt = -k beta / V while the flow is turbulent."""
    time = np.arange(0.0, 0.05, 1e-3)
    k = 3e-10
    out = _resting(bare_knee, time, [effect("turbulent_leakage", orifice_coefficient=k)], 12e6, 2e6)
    root = np.sqrt(out["pressure_a"] - out["pressure_b"])
    expected = np.sqrt(10e6) - k * BETA / VOLUME * time
    assert expected[-1] > 1000
    np.testing.assert_allclose(root, expected, rtol=1e-5)


@given(dp=st.floats(1e5, 4e7))
def test_orifice_follows_the_root_law_and_is_odd(dp) -> None:
    flow = turbulent_leakage.into_b(0.0, dp, 0.0, 1e-9, 1e3)
    assert flow == pytest.approx(1e-9 * np.sqrt(dp), rel=1e-3)
    assert turbulent_leakage.into_b(0.0, 0.0, dp, 1e-9, 1e3) == -flow
    assert turbulent_leakage.into_a(0.0, dp, 0.0, 1e-9, 1e3) == -flow


def test_external_leakage_drains_each_chamber_at_its_rate(bare_knee, effect) -> None:
    time = np.arange(0.0, 0.2, 1e-3)
    rate = 1e-13 * BETA / VOLUME
    for chamber in ("all", "chamber_a", "chamber_b"):
        drain = effect("external_leakage", leakage_coefficient=1e-13, at=chamber)
        out = _resting(bare_knee, time, [drain], 10e6, 4e6)
        for name, start, drains in (
            ("pressure_a", 10e6, chamber != "chamber_b"),
            ("pressure_b", 4e6, chamber != "chamber_a"),
        ):
            expected = start * np.exp(-rate * time) if drains else np.full(time.size, start)
            np.testing.assert_allclose(out[name], expected, rtol=1e-6)


@pytest.mark.parametrize("exponent", [0.6, 1.5])
def test_a_gap_that_is_no_straight_line_drains_by_its_power(bare_knee, effect, exponent) -> None:
    time = np.arange(0.0, 0.05, 1e-3)
    drain = effect("external_leakage", leakage_coefficient=1e-13, law="power", exponent=exponent)
    out = _resting(bare_knee, time, [drain], 12e6, 4e6)
    # by hand: dp/dt = -r p (p/p_s)^(n-1), so p^(1-n) = p_0^(1-n) - (1-n) r t p_s^(1-n)
    rate, rest = 1e-13 * BETA / VOLUME, 1.0 - exponent
    for name, start in (("pressure_a", 12e6), ("pressure_b", 4e6)):
        expected = (start**rest - rest * rate * time * 10e6**rest) ** (1.0 / rest)
        np.testing.assert_allclose(out[name], expected, rtol=1e-4)


def test_at_ten_megapascals_every_law_drains_as_much() -> None:
    laminar, power = (external_leakage.Leak(1e-13, 0.0, 0.0, law, 1.7) for law in (0.0, 1.0))
    flows = [external_leakage.leak(0.0, 10e6, 0.0, own) for own in (laminar, power)]
    assert flows == pytest.approx([-1e-6, -1e-6], rel=1e-4)
    h = 10.0
    for pressure in (1e3, 2e5, 5e6, 20e6):
        down, up = (external_leakage.leak(0.0, pressure + d, 0.0, power) for d in (-h, h))
        assert (down - up) / (2.0 * h) <= 1.001 * external_leakage.slope(0.0, pressure, 0.0, power)


def test_a_gap_that_widens_moves_oil_from_one_chamber_to_the_other() -> None:
    own = (1e-13, 1.5)
    # by hand: C d (d / 10 MPa)^0.5 at 2.5 MPa is half of what a laminar one would leak
    assert widening_leakage.into_a(0.0, 4.5e6, 2e6, *own) == pytest.approx(-1.25e-7, rel=1e-4)
    assert widening_leakage.into_b(0.0, 4.5e6, 2e6, *own) == pytest.approx(1.25e-7, rel=1e-4)
    assert widening_leakage.into_a(0.0, 2e6, 4.5e6, *own) == pytest.approx(1.25e-7, rel=1e-4)
    for difference in (0.0, 1e4, 3e6, 25e6):
        ends = [widening_leakage.into_b(0.0, difference + h, 0.0, *own) for h in (-10.0, 10.0)]
        steepest = widening_leakage.slope(0.0, difference, 0.0, *own)
        assert (ends[1] - ends[0]) / 20.0 <= 1.001 * steepest


def test_check_valve_keeps_the_low_side_near_its_charge(bare_knee, effect) -> None:
    time = np.arange(0.0, 0.1, 1e-3)
    valves = effect("anti_cavitation")
    with_valves = bare_knee.run(time, 15.0, valves)
    without = bare_knee.run(time, 15.0)
    assert without["pressure_b"].min() < -5e6
    assert with_valves["pressure_b"].min() > 0.55e6
    assert with_valves["pressure_b"].max() <= 0.6e6 + 1.0


@pytest.mark.parametrize("route", ["tank", "ports"])
def test_relief_valve_opens_at_its_setting(bare_knee, effect, route) -> None:
    time = np.arange(0.0, 0.02, 1e-4)
    opening = 10e6
    valve = effect("relief_valve", valve_conductance=1e-10, setting=opening, route=route)
    base = 5e6
    over = opening if route == "tank" else opening + base
    shut = _resting(bare_knee, time, [valve], over - 1e4, base)
    np.testing.assert_allclose(shut["pressure_a"], over - 1e4, rtol=1e-12)
    open_ = _resting(bare_knee, time, [valve], over + 2e6, base)
    if route == "tank":
        rate = 1e-10 * BETA / VOLUME
        expected = opening + 2e6 * np.exp(-rate * time)
        np.testing.assert_allclose(open_["pressure_a"], expected, rtol=2e-3)
        np.testing.assert_allclose(open_["pressure_b"], base)
    else:
        total = open_["pressure_a"] + open_["pressure_b"]
        np.testing.assert_allclose(total, total[0], rtol=1e-9)
        assert open_["pressure_a"][-1] - open_["pressure_b"][-1] == pytest.approx(opening, rel=1e-3)


def test_relief_valve_limits_the_pump(knee, effect) -> None:
    time = np.arange(0.0, 0.3, 1e-3)
    limited = knee.run(time, 30.0, effect("relief_valve", valve_conductance=1e-8, setting=12e6))
    assert limited["pressure_a"].max() < 12.5e6
    assert knee.run(time, 30.0)["pressure_a"].max() > 20e6


def test_relief_valve_with_a_drained_spring_is_opened_by_the_higher_pressure(
    bare_knee, effect
) -> None:
    """From 12 MPa it lets oil over until 10 MPa are left, whatever the other chamber holds."""
    time = np.arange(0.0, 0.02, 1e-4)
    ports = {"valve_conductance": 1e-10, "setting": 10e6, "route": "ports"}
    drained = effect("relief_valve", **ports, opened_by="pressure")
    got = _resting(bare_knee, time, [drained], 12e6, 5e6)
    rate = 1e-10 * BETA / VOLUME
    out = 2e6 * (1.0 - np.exp(-rate * time))
    np.testing.assert_allclose(got["pressure_a"], 12e6 - out, rtol=2e-3)
    np.testing.assert_allclose(got["pressure_b"], 5e6 + out, rtol=2e-3)
    by_difference = _resting(bare_knee, time, [effect("relief_valve", **ports)], 12e6, 5e6)
    np.testing.assert_allclose(by_difference["pressure_a"], 12e6, rtol=1e-12)


ONE_LINE = """\
plant: press
nodes:
  shaft: {kind: rotation, inertia: 1e-4 kg*m^2}
  cap:   {kind: volume, bulk_modulus: 1 GPa, volume: 20 cm^3}
  tank:  {kind: reservoir, pressure: 0 bar}
  rod:   {kind: translation, mass: 20 kg}
elements:
  motor: {kind: motor, on: shaft, torque_constant: 0.1 N*m/A}
  pump:  {kind: pump, on: shaft, from: tank, to: cap, displacement: 1 cm^3/rev}
  ram:   {kind: cylinder, on: rod, a: cap, b: tank, area_a: 8 cm^2, area_b: 6 cm^2,
          volume_a: 50 cm^3, volume_b: 50 cm^3}
  seals: {kind: friction, on: rod, viscous: 500 N*s/m}
inputs:   {current_command: motor.current}
channels: {motor_speed: shaft.speed, pressure: cap.pressure, piston_velocity: rod.velocity}
"""


@pytest.mark.slow  # compiles a kernel
def test_a_relief_valve_drains_the_only_line_under_pressure(tmp_path) -> None:
    """With all at rest the pressure falls to the setting as through a conductance."""
    (tmp_path / "plant.yaml").write_text(ONE_LINE)
    plant = load_plant(tmp_path / "plant.yaml")
    declared = plant.layout.effect("relief_valve")
    assert (declared.role, declared.places) == ("chamber", ("cap",))
    vector = plant.layout.defaults()
    vector[plant.layout.index["relief_valve.valve_conductance"]] = 1e-10
    vector[plant.layout.index["relief_valve.setting"]] = 2e6
    time = np.arange(0.0, 0.02, 1e-4)
    still = dict.fromkeys(("motor_speed", "piston_velocity"), np.zeros(time.size))
    for start in (1.5e6, 3e6):
        out = plant.at(vector).simulate(Drive(time, still), {"pressure": start}, 2e-5)
        pressure = out[:, plant.outputs.index("pressure")]
        # 20 cm^3 beside the 50 of the chamber
        over = max(start - 2e6, 0.0) * np.exp(-1e-10 * 1e9 / 70e-6 * time)
        np.testing.assert_allclose(pressure, min(start, 2e6) + over, rtol=2e-3)


@given(
    p_a=st.floats(0, 4e7), p_b=st.floats(0, 4e7),
    route=st.sampled_from([0.0, 1.0]), opened_by=st.sampled_from([0.0, 1.0]),
)  # fmt: skip
def test_relief_valve_only_lets_oil_down(p_a, p_b, route, opened_by) -> None:
    own = relief_valve.Valve(1e-9, 5e6, route, opened_by)
    a = relief_valve.into_a(0.0, p_a, p_b, own)
    b = relief_valve.into_b(0.0, p_a, p_b, own)
    assert a * p_a + b * p_b <= 0.0
    if route:
        assert a == -b


def test_air_under_gauge_pressure_is_air_one_atmosphere_higher() -> None:
    """By ISO 2533; stiffer by the index where no heat is exchanged."""
    modulus = entrained_air.effective_bulk_modulus
    absolute, gauge, polytropic = 0.0, 1.0, 2.0
    read = (BETA, 4e5, 0.02, 1.0, 1e5, 0.0, 0.0, 2e7)
    above = (BETA, 4e5 + 101325.0, 0.02, 1.0, 1e5, 0.0, 0.0, 2e7)
    assert modulus(*read, gauge) == modulus(*above, absolute)
    assert modulus(*read, polytropic) == modulus(*read, gauge)
    # hardly any oil is compressed where nearly all is air: n p
    soft = modulus(BETA, 0.0, 0.499, 1.4, 101325.0, 0.0, 0.0, 2e7, polytropic)
    s = 0.499 / 0.501
    assert soft == pytest.approx(BETA * (1 + s) / (1 + s * BETA / (1.4 * 101325.0)))


def test_bubbles_dissolve_as_the_pressure_rises() -> None:
    """Half of s is left half-way to p_d, none beyond; below p_0 all of it."""

    def modulus(p: float, dissolution: float, air: float = 0.02) -> float:
        own = (BETA, p, air, 1.0, 1e5, 0.0, dissolution, 2e7 + 1e5, 0.0)
        return entrained_air.effective_bulk_modulus(*own)

    assert modulus(2.1e7, 1.0) == BETA
    assert modulus(5e4, 1.0) == modulus(5e4, 0.0)
    half = 0.01 / (0.98 + 0.01)  # a fraction with half the volume of air per volume of oil
    assert modulus(1e7 + 1e5, 1.0) == pytest.approx(modulus(1e7 + 1e5, 0.0, half), rel=1e-12)


def test_oil_with_air_has_its_limits() -> None:
    def modulus(p, air=0.02, index=1.0):
        return entrained_air.effective_bulk_modulus(BETA, p, air, index, 1e5, 0.0, 0.0, 2e7, 0.0)

    assert modulus(1e12) == pytest.approx(BETA, rel=1e-3)
    # at p_0 the volumes are as declared: compliances add in proportion
    expected = 1.0 / ((1 - 0.02) / BETA + 0.02 / 1e5)
    assert modulus(1e5) == pytest.approx(expected, rel=1e-12)
    assert modulus(1e5, index=1.4) == pytest.approx(
        1.0 / ((1 - 0.02) / BETA + 0.02 / 1.4e5), rel=1e-12
    )
    assert modulus(5e6, air=0.0) == BETA
    assert modulus(-1e6) == modulus(0.0) > 0.0


@given(p=st.floats(1e5, 4e7), air=st.floats(1e-4, 0.3))
def test_air_only_softens_and_less_at_high_pressure(p, air) -> None:
    here = entrained_air.effective_bulk_modulus(BETA, p, air, 1.0, 1e5, 0.0, 0.0, 2e7, 0.0)
    higher = entrained_air.effective_bulk_modulus(BETA, p * 1.1, air, 1.0, 1e5, 0.0, 0.0, 2e7, 0.0)
    assert 0 < here <= higher <= BETA


def test_compressing_oil_that_stiffens_follows_the_exponential_law(bare_knee, effect) -> None:
    """beta = beta_0 + m p: p grows to beta_0 / m (exp(m dV / V) - 1), more than in proportion."""
    time = np.arange(0.0, 0.02, 1e-3)
    omega, m = 20.0, 50.0
    speed = {"motor_speed": np.full(time.size, omega)}
    start = {"pressure_a": 0.0, "pressure_b": 4e7}
    plain = bare_knee.run(time, speed, initial=start)["pressure_a"]
    stiff = bare_knee.run(time, speed, effect("oil_stiffening", slope=m), initial=start, step=2e-6)[
        "pressure_a"
    ]
    assert plain[-1] > 2e6
    expected = BETA / m * np.expm1(m * plain / BETA)
    np.testing.assert_allclose(stiff, expected, rtol=1e-4, atol=1.0)
    assert oil_stiffening.stiffer(BETA, -1e5, m) == BETA


def test_compressing_oil_with_air_follows_the_mixture_law(bare_knee, effect) -> None:
    """The volume pumped in is that by which oil and air together shrink (isothermal air).

    dV/V = -dp/beta_e integrated against the mixture: V(p) = V_oil + V_air p_0 / p.
    """
    time = np.arange(0.0, 0.05, 1e-3)
    air = effect("entrained_air", air_fraction=0.05)
    omega = 30.0
    out = bare_knee.run(time, {"motor_speed": np.full(time.size, omega)}, air, step=2e-6)
    pumped = bare_knee.model().value("pump_displacement") * omega * time
    p = out["pressure_a"]
    # integrate V / beta_e dp with the fixed chamber volume of the model, Eq. (4)
    grid = np.linspace(p[0], p[-1], 200001)
    beta = np.array(
        [
            entrained_air.effective_bulk_modulus(BETA, q, 0.05, 1.0, 1e5, 0.0, 0.0, 2e7, 0.0)
            for q in grid[::100]
        ]
    )
    compliance = np.interp(grid, grid[::100], VOLUME / beta)
    taken = np.concatenate(([0], np.cumsum(0.5 * (compliance[1:] + compliance[:-1]))))
    taken *= grid[1] - grid[0]
    np.testing.assert_allclose(np.interp(p, grid, taken), pumped, atol=2e-4 * pumped[-1])


def test_single_rod_cylinder_moves_less_oil_on_side_b(bare_knee, effect) -> None:
    """With the pump held and the rod pushed, each chamber is squeezed by its own area."""
    time = np.arange(0.0, 0.01, 1e-4)
    inputs = {
        "motor_speed": np.zeros(time.size),
        "piston_position": 0.1 * time,
        "piston_velocity": np.full(time.size, 0.1),
    }
    out = bare_knee.run(
        time, inputs, effect("unequal_areas", area_difference=0.2), locked=False, step=1e-6,
        initial={"pressure_a": 20e6, "pressure_b": 20e6},
    )  # fmt: skip
    area = bare_knee.model().value("piston_area_a")
    x = 0.1 * time
    np.testing.assert_allclose(
        out["pressure_a"], 20e6 - BETA * np.log1p(area * x / VOLUME), rtol=1e-4
    )
    np.testing.assert_allclose(
        out["pressure_b"], 20e6 - BETA * np.log1p(-0.8 * area * x / VOLUME), rtol=1e-4
    )


def test_smaller_chamber_is_stiffer(bare_knee, effect) -> None:
    """With its volume scaled along, the same flow raises chamber B's pressure more."""
    time = np.arange(0.0, 0.02, 1e-3)
    inputs = {"motor_speed": np.full(time.size, -20.0)}
    rises = {}
    for chamber in ("kept", "scaled"):
        out = bare_knee.run(
            time, inputs, effect("unequal_areas", area_difference=0.2, chamber=chamber)
        )
        rises[chamber] = out["pressure_b"][-1] - out["pressure_b"][0]
    assert rises["scaled"] == pytest.approx(rises["kept"] / 0.8, rel=1e-9)


def test_single_rod_cylinder_pushes_with_the_difference_of_areas(knee, effect) -> None:
    """Equal pressures extend it: F = p A delta, against the rod's own friction."""
    time = np.arange(0.0, 0.02, 1e-3)
    area = knee.model().value("piston_area_a")
    edge = 60.0 / (area * 0.1)
    for pressure, moves in ((edge * 0.99, False), (edge * 1.01, True)):
        out = knee.run(
            time, 0.0, effect("unequal_areas", area_difference=0.1), locked=False,
            initial={"pressure_a": pressure, "pressure_b": pressure}, leakage=0.0,
        )  # fmt: skip
        assert (np.max(out["piston_velocity"]) > 0) == moves


def test_warm_oil_leaks_more(bare_knee, effect) -> None:
    time = np.arange(0.0, 0.05, 1e-3)
    inputs = {
        "motor_speed": np.zeros(time.size),
        "oil_temperature": np.full(time.size, 313.15 + np.log(2) / 0.02),
    }
    start = {"pressure_a": 5e6, "pressure_b": 3e6}
    out = bare_knee.run(
        time, inputs, effect("viscosity_temperature", temperature_coefficient=0.02),
        initial=start, leakage=1e-13,
    )  # fmt: skip
    rate = 2 * 1e-13 * BETA * 2 / VOLUME
    expected = 2e6 * np.exp(-rate * time)
    np.testing.assert_allclose(out["pressure_a"] - out["pressure_b"], expected, rtol=1e-5)

"""The linear drive: closed forms, friction, its controller, and the real EMPS measurements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.io
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import InputError
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive
from eha_bench.plants.registry import get_plant

G = 35.15065188248547


def _run(time, inputs, *effects, initial=None, step=1e-4, first=0, **parameters):
    model = Model("linear_drive", parameters, (), effects)
    drive = Drive(time, inputs, initial or {}, first=first)
    out = get_plant("linear_drive").simulate(model.vector(), drive, step)
    return {"voltage": out[:, 0], "position": out[:, 1], "velocity": out[:, 2]}


TIME = np.arange(0.0, 1.0, 1e-3)


def test_constant_voltage_reaches_the_terminal_speed_of_viscous_friction() -> None:
    out = _run(TIME, {"voltage": np.full(TIME.size, 2.0)}, mass=10.0, viscous_friction=200.0)
    expected = 2.0 * G / 200.0 * (1 - np.exp(-200.0 / 10.0 * TIME))
    np.testing.assert_allclose(out["velocity"], expected, atol=1e-6)


def test_carriage_decelerates_linearly_and_stays(effect) -> None:
    inputs = {"voltage": np.zeros(TIME.size)}
    start = {"piston_velocity": 0.1}
    declared = _run(TIME, inputs, initial=start, mass=100.0, viscous_friction=0.0,
                    coulomb_friction=20.0)  # fmt: skip
    added = _run(TIME, inputs, effect("coulomb_friction", friction_force=20.0), initial=start,
                 mass=100.0, viscous_friction=0.0)  # fmt: skip
    expected = np.maximum(0.0, 0.1 - 0.2 * TIME)
    for out in (declared, added):
        np.testing.assert_allclose(out["velocity"], expected, atol=1e-9)
        stop = 0.1**2 / 2 / 0.2
        assert out["position"][-1] == pytest.approx(stop, rel=1e-6)


@pytest.mark.parametrize("kind", ["dry", "viscous", "all"])
def test_asymmetric_friction_differs_by_direction(effect, kind) -> None:
    for sign in (1.0, -1.0):
        volts = np.full(TIME.size, sign * 2.0)
        out = _run(
            TIME, {"voltage": volts}, effect("asymmetric_friction", asymmetry=0.2, kind=kind),
            mass=5.0, viscous_friction=200.0, coulomb_friction=20.0,
        )  # fmt: skip
        dry = 20.0 * (1 + 0.2 * sign if kind != "viscous" else 1)
        viscous = 200.0 * (1 + 0.2 * sign if kind != "dry" else 1)
        assert abs(out["velocity"][-1]) == pytest.approx((2.0 * G - dry) / viscous, rel=1e-6)


def test_offset_and_stiction_hold() -> None:
    edge = (20.0 + 3.0) / G
    for volts, moves in ((edge * 0.999, False), (edge * 1.01, True)):
        out = _run(TIME, {"voltage": np.full(TIME.size, volts)}, coulomb_friction=20.0,
                   force_offset=3.0)  # fmt: skip
        assert (out["velocity"].max() > 0) == moves


def test_creep_is_the_inverse_tanh() -> None:
    out = _run(
        TIME, {"voltage": np.full(TIME.size, 10.0 / G)}, coulomb_friction=20.0,
        viscous_friction=0.0, creep_speed=1e-4, mass=1.0,
    )  # fmt: skip
    assert out["velocity"][-1] == pytest.approx(1e-4 * np.arctanh(0.5), rel=1e-3)


@pytest.mark.parametrize("creep", [1e-9, 1e-7, 1e-6, 1e-5])
def test_friction_that_creeps_ever_slower_becomes_sticking(creep) -> None:
    """A width that one step passes many times over holds the speed as sticking does."""
    volts = 3.0 * np.sin(2 * np.pi * 5 * TIME)
    options = {"coulomb_friction": 20.0, "mass": 2.0, "viscous_friction": 50.0, "step": 2e-4}
    sticks = _run(TIME, {"voltage": volts}, creep_speed=0.0, **options)["velocity"]
    creeps = _run(TIME, {"voltage": volts}, creep_speed=creep, **options)["velocity"]
    assert np.max(np.abs(creeps - sticks)) < 5e-3 * np.max(np.abs(sticks))


def test_error_falls_with_the_square_of_the_step() -> None:
    volts = 3.0 * np.sin(2 * np.pi * 3 * TIME)
    options = {"coulomb_friction": 20.0, "mass": 2.0, "viscous_friction": 50.0}
    truth = _run(TIME, {"voltage": volts}, step=1e-6, **options)["position"]
    errors = [
        np.max(np.abs(_run(TIME, {"voltage": volts}, step=s, **options)["position"] - truth))
        for s in (5e-4, 2.5e-4, 1.25e-4)
    ]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders > 1.7), orders


def test_delay_and_lag_shift_the_voltage(effect) -> None:
    volts = 3.0 * np.sin(2 * np.pi * 5 * TIME)
    late = _run(TIME, {"voltage": volts}, effect("command_delay", delay=4e-3))
    shifted = _run(TIME, {"voltage": np.concatenate((np.zeros(4), volts[:-4]))})
    np.testing.assert_allclose(late["velocity"], shifted["velocity"], atol=1e-9)
    lag = effect("current_lag", time_constant=0.1)
    lag = _run(TIME, {"voltage": np.full(TIME.size, 2.0)}, lag, viscous_friction=0.0, mass=100.0)
    expected = 2.0 * G / 100.0 * (TIME - 0.1 * (1 - np.exp(-TIME / 0.1)))
    np.testing.assert_allclose(lag["velocity"], expected, atol=1e-6)


def test_closed_loop_follows_its_reference_with_the_lag_of_its_gain() -> None:
    """A ramp is followed v / k_p behind (velocity feedback, no integrator), friction apart."""
    reference = 0.1 * TIME
    out = _run(TIME, {"reference": reference}, viscous_friction=0.0)
    assert reference[-1] - out["position"][-1] == pytest.approx(0.1 / 160.18, rel=1e-2)


def test_closed_loop_voltage_is_the_controller_s(effect) -> None:
    reference = 0.02 * np.sin(2 * np.pi * TIME)
    pulses = np.where((TIME > 0.4) & (TIME < 0.6), 5.0, 0.0)
    out = _run(TIME, {"reference": reference, "pulses": pulses}, coulomb_friction=20.0)
    np.testing.assert_allclose(
        out["voltage"][2:],
        _controller(reference, out["position"]) + pulses[2:],
        rtol=1e-9,
        atol=1e-9,
    )


def _controller(reference, position):
    """The published law with the velocity as the mean difference of three readings, V."""
    speed = (position[2:] - position[:-2]) / 2e-3
    return 243.45 * (160.18 * (reference - position)[2:] - speed)


def test_controller_keeps_its_rate_on_a_coarser_log() -> None:
    reference = 0.02 * np.sin(2 * np.pi * TIME)
    fine = _run(TIME, {"reference": reference}, coulomb_friction=20.0)
    coarse = _run(TIME[::10], {"reference": reference[::10]}, coulomb_friction=20.0)
    worst = np.max(np.abs(coarse["position"] - fine["position"][::10]))
    assert worst < 5e-3 * np.ptp(fine["position"])


def test_voltage_replayed_gives_the_closed_loop_s_motion() -> None:
    reference = 0.02 * np.sin(2 * np.pi * TIME)
    closed = _run(TIME, {"reference": reference}, coulomb_friction=20.0)
    replay = _run(TIME, {"voltage": closed["voltage"]}, coulomb_friction=20.0)
    np.testing.assert_allclose(replay["position"], closed["position"], atol=1e-12)


@pytest.mark.parametrize(
    ("inputs", "says"),
    [
        ({}, "either 'voltage'"),
        ({"voltage": TIME, "reference": TIME}, "either 'voltage'"),
        ({"voltage": TIME, "pulses": TIME}, "is part of .voltage"),
        ({"current_command": TIME}, "cannot be an input"),
    ],
)
def test_impossible_inputs_are_refused(inputs, says) -> None:
    with pytest.raises(InputError, match=says):
        _run(TIME, inputs)


def test_unknown_first_value_is_refused() -> None:
    with pytest.raises(InputError, match="not a state"):
        _run(TIME, {"voltage": TIME}, initial={"pressure_a": 1.0})


@dataclass(frozen=True)
class Emps:
    time: np.ndarray
    reference: np.ndarray
    position: np.ndarray
    voltage: np.ndarray
    pulses: np.ndarray


@pytest.fixture(scope="module")
def emps(shared_data):
    def load(name):
        raw = scipy.io.loadmat(shared_data / "emps" / name)
        get = {k: np.asarray(v, float).ravel() for k, v in raw.items() if not k.startswith("__")}
        pulses = get.get("pulses_N", np.zeros(get["t"].size))
        return Emps(get["t"], get["qg"], get["qm"], get["vir"], pulses)

    return load("DATA_EMPS.mat"), load("DATA_EMPS_PULSES.mat")


def _replay(data, model, *, pulses=True, step=1e-3):
    inputs = {"reference": data.reference}
    if pulses:
        inputs["pulses"] = data.pulses
    start = {
        "piston_position": data.position[0],
        "piston_velocity": (data.position[2] - data.position[0]) / 2e-3,
    }
    out = get_plant("linear_drive").simulate(model.vector(), Drive(data.time, inputs, start), step)
    return out[:, 1] - data.position


def _emps_model(values, *, lopsided):
    mass, viscous, coulomb, offset, *rest = values
    effects = [DeclaredEffect("coulomb_friction", {"friction_force": coulomb})]
    if lopsided:
        asymmetry = {"asymmetry": rest[0], "kind": "viscous"}
        effects.append(DeclaredEffect("asymmetric_friction", asymmetry))
    values = {"mass": mass, "viscous_friction": viscous, "force_offset": offset}
    return Model("linear_drive", values, (), tuple(effects))


def test_the_controller_s_law_reproduces_the_measured_voltage(emps) -> None:
    estimation, _ = emps
    error = estimation.voltage[2:] - _controller(estimation.reference, estimation.position)
    assert np.std(error) < 4e-3


def _rms(error):
    return 1e6 * float(np.sqrt(np.mean(error**2)))


def test_published_model_of_emps_follows_the_measurement(emps) -> None:
    estimation, validation = emps
    published = _emps_model((95.11, 203.5, 20.39, -3.16), lopsided=False)
    assert _rms(_replay(estimation, published)) < 1.8
    assert _rms(_replay(validation, published)) < 2.5


def test_asymmetric_friction_fitted_to_emps_predicts_the_pulses(emps) -> None:
    """Estimated on one file, the position on the other is within 2.3 um RMS with its pulses."""
    estimation, validation = emps
    start = np.array([95.0, 203.0, 20.4, -0.5, -0.15])
    fit = least_squares(
        lambda x: 1e6 * _replay(estimation, _emps_model(x, lopsided=True)), start,
        x_scale=np.abs(start), diff_step=5e-3, max_nfev=8,
    )  # fmt: skip
    model = _emps_model(fit.x, lopsided=True)
    assert fit.x[4] == pytest.approx(-0.18, abs=0.03)
    assert _rms(_replay(validation, model)) < 2.3
    assert _rms(_replay(validation, model, pulses=False)) > 90.0


@pytest.mark.parametrize("asymmetry", [0.4, -0.4])
def test_bristles_of_lopsided_friction_pull_as_they_are_bent(effect, asymmetry) -> None:
    """Where the motion turns back, their pull goes on from where it was (SciPy's own solution)."""
    mass, level, distance, damping = 2.0, 20.0, 1e-4, 2e-3
    time = np.arange(0.0, 0.5, 1e-3)
    # held between samples, as the drive holds it; turns before and after the friction breaks away
    volts = 0.9 * np.sin(2 * np.pi * 7.0 * time) * (1.0 + time)

    def rates(t: float, y: FloatArray, pushed: float) -> list[float]:
        _, v, z = y
        bending = v - abs(v) * z
        side = 1.0 + asymmetry * np.sign(z)
        pull = level * side * (z + damping * bending / distance)
        return [v, (pushed - pull) / mass, bending / distance]

    state, expected = np.zeros(3), [0.0]
    for pushed in G * volts[:-1]:
        state = solve_ivp(rates, (0.0, 1e-3), state, "LSODA", args=(pushed,), rtol=1e-9,
                          atol=1e-13).y[:, -1]  # fmt: skip
        expected.append(state[0])
    bristles = effect("presliding_friction", distance=distance, damping_time=damping)
    got = _run(
        time, {"voltage": volts}, effect("asymmetric_friction", asymmetry=asymmetry, kind="dry"),
        bristles, step=1e-5, mass=mass, viscous_friction=0.0, coulomb_friction=level,
    )["position"]  # fmt: skip
    assert np.ptp(expected) > 5.0 * distance
    assert np.max(np.abs(got - expected)) < 2e-3 * np.ptp(expected)

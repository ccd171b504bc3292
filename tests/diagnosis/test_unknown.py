"""What no effect explains is told in the balance or the sensor in which it acts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.fit.baseline import COARSE, no_progress
from eha_bench.diagnosis.fit.evidence import Excess, Groups
from eha_bench.diagnosis.fit.least_squares import Fit, free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.short_windows import aligned_problem
from eha_bench.diagnosis.fit.thresholds import DEFAULT
from eha_bench.diagnosis.outcome import decide as decide_module
from eha_bench.diagnosis.outcome.decide import Decision
from eha_bench.diagnosis.outcome.diagnosis import Unknown, Verdict
from eha_bench.diagnosis.search.state import Accepted, Search
from eha_bench.diagnosis.unknown.curves import LocatedCurve
from eha_bench.diagnosis.unknown.free_input import Support
from eha_bench.diagnosis.unknown.locator import (
    Locator,
    SupportedPlace,
    believed_place,
    by_what_it_follows,
    described_places,
    locate,
    near_balances,
)
from eha_bench.diagnosis.unknown.places import SuspectPlace, Template, places_of
from eha_bench.plants.effects.learned import KNOTS
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive, Plant
from eha_bench.plants.registry import get_plant

EMPTY = np.zeros(0)


def offered(
    place: SuspectPlace, support: float, left: float = 0.0, own_left: float = 0.0
) -> SupportedPlace:
    return SupportedPlace(
        place, 1.0, EMPTY, Support(support, 0.0, 0.0, EMPTY, EMPTY), support, left, own_left
    )


PLACES = places_of(get_plant("eha_knee"))
BALANCE = next(place for place in PLACES if not place.sensors)
SENSOR = next(place for place in PLACES if place.sensors)


def test_a_sensor_is_told_where_its_error_explains_all_and_clearly_more() -> None:
    found = believed_place([offered(SENSOR, 1000.0), offered(BALANCE, 900.0)])
    assert found.place is SENSOR


@pytest.mark.parametrize(
    ("support", "left", "own_left"),
    [(1000.0, 0.5, 0.0), (905.0, 0.0, 0.0), (1000.0, 0.0, 0.5)],
    ids=["other channels are still off", "hardly more", "its own channel is still off"],
)
def test_a_balance_is_preferred_to_a_sensor(support: float, left: float, own_left: float) -> None:
    found = believed_place([offered(SENSOR, support, left, own_left), offered(BALANCE, 900.0)])
    assert found.place is BALANCE


@pytest.mark.parametrize(
    ("support", "left", "told"), [(1400.0, 0.5, True), (1000.0, 0.5, False), (1400.0, 0.7, False)]
)
def test_a_sensor_is_told_that_is_far_ahead_and_explains_most(
    support: float, left: float, *, told: bool
) -> None:
    """A sensor that sticks leaves more than one whose error is slow."""
    found = believed_place([offered(SENSOR, support, left, left), offered(BALANCE, 900.0)])
    assert (found.place is SENSOR) == told


def test_balances_that_nearly_as_much_speaks_for_are_near() -> None:
    torque, flow, force = (
        SuspectPlace(name, "additive", name, ()) for name in ("torque", "flow", "force")
    )
    places = [offered(torque, 1000.0), offered(SENSOR, 990.0), offered(flow, 950.0),
              offered(force, 800.0)]  # fmt: skip
    assert near_balances(places, places[0]) == ("torque", "flow")


class _Forms(Locator):
    """Knows what every place's curve is worth without simulating it."""

    def __init__(self, worth: Mapping[str, float]) -> None:
        self.worth = worth

    def _predicted_curve(self, item: SupportedPlace) -> tuple[Support, str]:
        return Support(self.worth[item.place.form], 0.0, 0.0, EMPTY, EMPTY), "velocity"

    def _with_curve(self, item: SupportedPlace, found: Support, variable: str) -> SupportedPlace:
        return replace(item, support=found.log)


def test_the_form_is_simulated_whose_curve_is_worth_most_not_the_one_that_is_freest() -> None:
    friction = SuspectPlace("torque", "friction", "shaft", ("angle",))
    drag = SuspectPlace("torque", "additive", "shaft", ("angle", "velocity"))
    drive = SuspectPlace("actuation", "gain", "motor", ("duty",))
    known = _Forms({"friction": 110.0, "additive": 200.0, "gain": 150.0})
    found = known._with_curves([offered(friction, 101.0), offered(drag, 100.0),
                                offered(drive, 99.0)])  # fmt: skip
    assert {item.place: item.support for item in found} == {
        friction: 101.0, drag: 200.0, drive: 150.0,
    }  # fmt: skip


class _Describing:
    """Describes by any variable, worth the place's support."""

    def best_curves(self, items: Sequence[SupportedPlace]) -> list[LocatedCurve]:
        return [
            LocatedCurve(
                Template(o.place.equation, o.place.form, o.place.at, v), o.support, EMPTY, EMPTY
            )
            for o in items
            for v in o.place.variables
        ]


def test_both_chambers_at_once_are_described_by_each_of_them() -> None:
    both = SuspectPlace("flow", "additive", "chambers", ())
    one = next(place for place in PLACES if place.at == "chamber_a")
    found = described_places(_Describing(), [offered(both, 1000.0), offered(one, 500.0)])
    assert {item.template.place for item in found} == {"chamber_a"}


def test_what_follows_the_time_comes_from_the_drive_and_what_follows_speed_does_not() -> None:
    knots = np.zeros(2)
    driven = LocatedCurve(Template("actuation", "gain", "motor", "time"), 0.8, knots, knots)
    machine = LocatedCurve(
        Template("torque", "additive", "motor", "motor_speed"), 0.8, knots, knots
    )
    torque, drive = (next(p for p in PLACES if p.equation == e) for e in ("torque", "actuation"))
    less = replace(driven, share=0.3)
    assert by_what_it_follows([driven], [machine], torque) == [driven]
    assert by_what_it_follows([less], [machine], drive) == [machine]
    # a machine that knows the time is somebody who drives it
    clock = replace(machine, template=Template("force", "additive", "motor", "time"))
    assert by_what_it_follows([less], [clock], drive) == [less]
    assert by_what_it_follows([less], [clock], torque) == [clock]


DECLARED = {"rotor_inertia": 1e-3, "leakage": 1e-13, "current_limit": 36.0}
CALIBRATED = ("coulomb_torque", "viscous_torque", "leakage", "bulk_modulus", "rotor_inertia")
NOISE = {"current": 0.05, "motor_speed": 0.1, "pressure_a": 3e4, "pressure_b": 3e4}


def _run(plant: Plant, vector: FloatArray, seed: int) -> Measured:
    """A locked piston under a multisine, as it would be logged."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 1.0, 1e-3)
    tones = [np.sin(2.0 * np.pi * (f * time + rng.random())) for f in (0.7, 2.0, 5.0, 11.0, 23.0)]
    command = 9.0 + 2.5 * np.sum(tones, axis=0)
    initial = {"pressure_a": 6e5, "pressure_b": 6e5, "motor_speed": 0.0}
    inputs = {"current_command": command}
    values = plant.simulate(vector, Drive(time, inputs, initial, True, False), 1e-4)[:, :4]
    values = values + rng.standard_normal(values.shape) * list(NOISE.values())
    run = Run(f"run_{seed}", Path("none"), None, True, False, Use.TRAIN, Recording)
    held = {"piston_position": 0.0}
    whole = np.ones(values.shape, dtype=np.bool_)
    return Measured(run, time, inputs, tuple(NOISE), values, whole, held=held)


def _problem(**words: object) -> tuple[Problem, FloatArray]:
    """Two runs with a hidden curve, and a declared model that is 5 % off."""
    valves = DeclaredEffect("anti_cavitation")
    hidden = DeclaredEffect("learned", {"scale": 1.0, **words})
    true = Model("eha_knee", DECLARED, (), (valves, hidden))
    declared = Model("eha_knee", {**DECLARED, "rotor_inertia": 1.05e-3}, (), (valves,))
    plant, vector = declared.plant, declared.vector()
    runs = [_run(plant, true.vector(), seed) for seed in (1, 2)]
    windows = [window for item in runs for window in cut_windows(item, NOISE)]
    problem = Problem(plant, windows, NOISE, COARSE)
    problem.prepare(vector)
    problem.scale_to(problem.residual(vector))
    return problem, vector


def _told(**words: object) -> Template:
    """Where a hidden curve is said to act."""
    problem, vector = _problem(**words)
    plant = problem.plant
    free = free_parameters(plant.layout, CALIBRATED, vector)
    fit = levenberg_marquardt(problem, vector, free, iterations=4, refresh=0)
    return locate(problem, fit, COARSE, no_progress)[2][0].template


def _bump(size: float) -> list[float]:
    return [size if 8 <= k < 16 else 0.0 for k in range(KNOTS)]


def test_short_windows_begin_at_multiples_of_a_period_and_end_before_the_next() -> None:
    problem, vector = _problem(at="shaft", values=[0.0] * KNOTS)
    short, period = aligned_problem(problem, vector, KNOTS)
    assert len(short.windows) == 18
    for window in short.windows:
        time = window.measured.time
        turns = time[window.first] / period
        assert abs(turns - round(turns)) * period < 1.5e-3
        # the last knot lies in the gap
        assert time[window.last - 1] - time[window.first] <= period * (1.0 - 1.0 / KNOTS)


def test_losses_that_grow_with_speed_are_told_as_a_torque() -> None:
    told = _told(at="shaft", variable="motor_speed", low=-60.0, high=60.0,
                 values=[-0.1 * w * abs(w) for w in np.linspace(-1.0, 1.0, KNOTS)])  # fmt: skip
    assert (told.equation, told.variable) == ("torque", "motor_speed")


def test_an_encoder_that_slips_at_times_is_told_as_a_measurement() -> None:
    told = _told(at="motor_speed.sensor", form="gain", variable="time",
                 period=0.6, values=_bump(-0.02))  # fmt: skip
    assert (told.equation, told.place) == ("measurement", "motor_speed.sensor")


def test_a_gain_of_both_pressure_sensors_that_drifts_is_told_as_a_measurement() -> None:
    told = _told(at="pressures", form="gain", variable="time",
                 low=0.0, high=1.0, values=list(np.linspace(0.0, 0.03, KNOTS)))  # fmt: skip
    assert (told.equation, told.place) == ("measurement", "pressures")


def test_a_leak_that_opens_and_closes_is_told_as_a_flow() -> None:
    told = _told(at="pump", variable="time", period=0.7,
                 values=_bump(-2e-7))  # fmt: skip
    assert (told.equation, told.place) == ("flow", "pump")


@pytest.mark.parametrize(
    ("balance", "by_curve", "missing", "verdict"),
    [
        ("force", 0.04, 1e4, Verdict.EFFECT),
        ("force", 0.2, 1e4, Verdict.UNKNOWN),
        ("torque", 0.04, 1e4, Verdict.UNKNOWN),
        (None, math.nan, 1e4, Verdict.UNKNOWN),
        # near the noise no remainder is to be expected
        ("force", 0.04, 1e3, Verdict.UNKNOWN),
    ],
)
def test_an_effect_beside_a_remainder_stands_where_nothing_else_explains_as_much(
    monkeypatch: pytest.MonkeyPatch,
    balance: str | None,
    by_curve: float,
    missing: float,
    verdict: Verdict,
) -> None:
    """Of 30 %: where it acts in the balance of the rest, and no curve explains as much."""
    item = SimpleNamespace(
        start=SimpleNamespace(candidate="seal_friction", is_parameter=False, equation="force")
    )
    base, left = (Excess(size, 1000, 50.0, {}) for size in (missing, 0.7 * missing))
    search = Search(
        cast("Problem", None), (), (), cast("Fit", "without"), cast("Fit", "with it"),
        cast("Groups", None), EMPTY, base, left, [cast("Accepted", item)],
    )  # fmt: skip
    with_it = search.fit
    unknown = Unknown(balance, (), "", by_curve)
    located = Decision(Verdict.UNKNOWN, search.base, (), unknown)
    monkeypatch.setattr(decide_module, "_unknown", lambda *_: located)
    found = decide_module.decide(search, COARSE, no_progress)
    assert found.verdict is verdict
    if verdict is Verdict.EFFECT:
        assert found.fit is search.fit is with_it
        assert len(search.effects) == 1
        assert "30 %" in found.notes[-1]
    else:
        assert search.fit is search.base
        assert not search.effects


def test_what_was_not_located_is_in_no_equation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no place can act there is no equation, and none is made up."""
    left = Excess(1e4, 1000, 50.0, {})
    search = cast("Search", SimpleNamespace(
        excess_left=left, excess_base=left, effects=[], fit=None, is_unexplained=True,
        thresholds=DEFAULT, share_left=1.0, ranking=[],
        problem=SimpleNamespace(plant=None),
    ))  # fmt: skip
    monkeypatch.setattr(decide_module, "places_of", lambda _: ("somewhere",))
    monkeypatch.setattr(decide_module, "locate", lambda *_: (None, "", []))
    found = decide_module.decide(search, COARSE, no_progress)
    assert found.verdict is Verdict.UNKNOWN
    assert found.unknown is not None
    assert found.unknown.equation is None
    assert "nothing was located" in found.unknown.description
    monkeypatch.setattr(decide_module, "locate", lambda *_: (None, "force", []))
    found = decide_module.decide(search, COARSE, no_progress)
    assert found.unknown is not None
    assert found.unknown.equation == "force"
    monkeypatch.setattr(decide_module, "locate", lambda *_: (None, "", []))
    monkeypatch.setattr(decide_module, "places_of", lambda _: ())
    found = decide_module.decide(search, COARSE, no_progress)
    assert found.unknown is not None
    assert "no `advance`" in found.unknown.description


def test_a_command_that_nearly_goes_with_the_speed_is_not_what_a_machine_follows() -> None:
    knots = np.zeros(2)
    driven = LocatedCurve(Template("actuation", "additive", "motor", "duty"), 0.95, knots, knots)
    machine = LocatedCurve(
        Template("torque", "friction", "motor", "motor_speed"), 0.99, knots, knots
    )
    torque, drive = (next(p for p in PLACES if p.equation == e) for e in ("torque", "actuation"))
    assert by_what_it_follows([driven], [machine], torque) == [machine]
    assert by_what_it_follows([driven], [machine], drive) == [driven]
    more = replace(driven, share=1.0)
    assert by_what_it_follows([more], [machine], torque) == [more]

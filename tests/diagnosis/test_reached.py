"""Bounds of parameters by what was measured: settings of valves, speeds by which friction falls."""

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from slide_plant import slide

from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.fit.candidates import all_starts
from eha_bench.diagnosis.fit.least_squares import free_parameters
from eha_bench.diagnosis.fit.own_parameters import Places
from eha_bench.diagnosis.fit.reached import reached_bounds
from eha_bench.plants.channel_roles import KNOWN
from eha_bench.plants.registry import get_plant

TANK, PORTS = 0.0, 1.0


@pytest.fixture
def layout():
    return get_plant("eha_knee").layout


def read(**attributes):
    """Return what a run's pressures are asked for."""
    run = SimpleNamespace(**attributes)
    run.column, run.read = partial(Measured.column, run), partial(Measured.read, run)
    return run


def measured(pressure_a, pressure_b, valid=None):
    values = np.column_stack([pressure_a, pressure_b])
    return read(
        inputs={}, outputs=("pressure_a", "pressure_b"), values=values, roles=KNOWN,
        valid=np.ones(values.shape, bool) if valid is None else valid,
    )  # fmt: skip


def vector_with(layout, route, setting=15e6):
    vector = np.zeros(layout.size)
    vector[layout.index["relief_valve.route"]] = route
    vector[layout.index["relief_valve.setting"]] = setting
    return vector


@pytest.mark.parametrize(("route", "least"), [(TANK, 10e6), (PORTS, 9e6)])
def test_it_depends_on_where_the_oil_goes(layout, route, least):
    # chamber A at 0 to 20 MPa, B at 1 MPa: the medians are 10 MPa, and 9 MPa between the two
    run = measured(np.linspace(0.0, 20e6, 2001), np.full(2001, 1e6))
    places = Places(layout, reached=reached_bounds(layout, [run]))
    vector = vector_with(layout, route)
    (free,) = free_parameters(places, ["relief_valve.setting"], vector)
    assert free.low == pytest.approx(least, rel=2e-3)
    assert places.permits(vector, ["relief_valve.setting"])
    keys = ["relief_valve.setting", "relief_valve.valve_conductance"]
    assert not places.permits(vector_with(layout, route, 0.9 * least), keys)
    # what is never reached never opens, but a stiff valve ends at what it holds
    highest = 20e6 if route == TANK else 19e6
    above = vector_with(layout, route, 1.01 * highest)
    assert not places.may_begin(above, keys)
    assert places.may_begin(vector_with(layout, route, 0.99 * highest), keys)
    assert places.permits(above, keys)
    assert places.bound_met(keys, above) is None


@pytest.mark.parametrize("highest", [3e6, 30e6])
def test_a_valve_of_any_machine_has_settings_to_begin_from(layout, highest):
    """A machine that works at 20 bar has a valve of 24."""
    # a peak now and then: it is shut most of the time
    peaks = highest * np.maximum(0.0, np.sin(np.linspace(0.0, 40.0, 4001))) ** 6
    places = Places(layout, reached=reached_bounds(layout, [measured(peaks, np.zeros(4001))]))
    starts = [one for one in all_starts(layout, layout.defaults(), [], ())
              if one.candidate == "relief_valve"]  # fmt: skip
    at = layout.index["relief_valve.setting"]
    begun = [
        dict(one.settings)[at]
        for one in starts
        if places.may_begin(one.apply(layout.defaults()), one.keys)
    ]
    assert 0.1 * highest <= min(begun) < 0.13 * highest
    assert 0.85 * highest < max(begun) < highest
    assert 10 <= len(set(begun)) <= 20


def test_a_tenth_of_the_highest_pressure_is_a_leak(layout):
    rare = np.where(np.arange(2001) % 20 == 0, 20e6, 0.1e6)
    (found,) = settings(layout, measured(rare, np.zeros(2001)))
    assert found.at(vector_with(layout, TANK))[0] == pytest.approx(2e6)


def test_an_outlier_takes_no_setting_away(layout):
    pressure = 3e6 * np.maximum(0.0, np.sin(np.linspace(0.0, 40.0, 2001))) ** 6
    pressure[1000] = 60e6
    (found,) = settings(layout, measured(pressure, np.zeros(2001)))
    vector = vector_with(layout, TANK)
    assert found.at(vector)[0] == pytest.approx(0.3e6, rel=0.05)
    assert found.highest_first(vector) == pytest.approx(60e6)


def test_a_run_that_shows_one_pressure_leaves_all_settings_above(layout):
    """How high the other chamber went there nobody knows."""
    both = measured(np.linspace(0.0, 3e6, 2001), np.zeros(2001))
    one = read(**{**vars(measured(np.linspace(0, 30e6, 2001), np.zeros(2001))),
                  "outputs": ("pressure_a",)})  # fmt: skip
    places = Places(layout, reached=reached_bounds(layout, [both, one]))
    keys = ["relief_valve.setting", "relief_valve.valve_conductance"]
    assert places.may_begin(vector_with(layout, TANK, 24e6), keys)
    assert not places.may_begin(vector_with(layout, TANK, 1e6), keys)


def settings(layout, run):
    return [item for item in reached_bounds(layout, [run]) if item.key == "relief_valve.setting"]


def test_what_was_not_read_says_nothing(layout):
    run = measured(np.linspace(0.0, 20e6, 100), np.full(100, 1e6))
    valid = run.valid.copy()
    valid[50:] = False  # beyond 10 MPa nothing was believed
    half = read(**{**vars(run), "valid": valid})
    (found,) = settings(layout, half)
    assert found.at(vector_with(layout, TANK))[0] == pytest.approx(5e6, rel=0.05)
    one = read(**{**vars(run), "outputs": ("pressure_a",)})
    assert settings(layout, one) == []
    (free,) = free_parameters(Places(layout), ["relief_valve.setting"], vector_with(layout, TANK))
    assert free.low == layout.by_key["relief_valve.setting"].low


def test_a_plant_without_a_pair_of_chambers_has_none():
    servo = get_plant("geared_servo").layout
    run = measured(np.ones(10), np.ones(10))
    assert settings(servo, read(**{**vars(run), "roles": replace(KNOWN, pair=())})) == []


@pytest.mark.parametrize("channel", ["position", "velocity"])
def test_a_friction_has_fallen_at_a_fifth_of_the_fastest_speed(tmp_path, channel):
    layout = slide(tmp_path).plant.layout
    time = np.arange(0.0, 1.0, 1e-3)
    values = {
        "position": 0.3 / np.pi * np.sin(np.pi * time),
        "velocity": 0.3 * np.cos(np.pi * time),
    }
    run = read(
        inputs={}, outputs=(channel,), values=values[channel][:, None], roles=KNOWN, time=time,
        valid=np.ones((time.size, 1), bool),
    )  # fmt: skip
    places = Places(layout, reached=reached_bounds(layout, [run]))
    key = "stribeck_friction.stribeck_velocity"
    vector = np.zeros(layout.size)
    vector[layout.index[key]] = 0.01
    (free,) = free_parameters(places, [key], vector)
    assert free.high == pytest.approx(0.06, rel=0.01)
    assert places.permits(vector, [key])
    vector[layout.index[key]] = 0.07
    assert not places.permits(vector, [key])


def fastest(layout, values, time):
    """Return the most that the speed by which friction falls may be, by a logged position."""
    run = read(
        inputs={}, outputs=("position",), values=values[:, None], roles=KNOWN, time=time,
        valid=np.isfinite(values)[:, None],
    )  # fmt: skip
    key = "stribeck_friction.stribeck_velocity"
    (found,) = [item for item in reached_bounds(layout, [run]) if item.key == key]
    return found.at(np.zeros(layout.size))[1]


def test_a_position_with_empty_cells_and_gaps_shows_a_speed(tmp_path):
    layout = slide(tmp_path).plant.layout
    time = np.arange(0.0, 2.0, 1e-3)
    noise = 1e-6 * np.random.default_rng(0).standard_normal(time.size)
    swing = 0.3 / np.pi * np.sin(np.pi * time) + noise
    for every in (2, 40):
        slow = np.where(np.arange(time.size) % every == 0, swing, np.nan)
        assert fastest(layout, slow, time) == pytest.approx(0.06, rel=0.03)
    # what it moved by in a gap was at no speed that is known
    gap = np.where(time < 1.0, time, time + 3.0)
    moved = np.where(time < 1.0, 0.1 * time, 5.0 + 0.1 * time)
    assert fastest(layout, moved, gap) == pytest.approx(0.02, rel=0.01)


def test_noise_and_steps_of_a_sensor_are_no_speed(tmp_path):
    layout = slide(tmp_path).plant.layout
    time = np.arange(0.0, 4.0, 1e-3)
    noise = 1e-5 * np.random.default_rng(0).standard_normal(time.size)
    assert fastest(layout, noise, time) == np.inf
    coarse = np.round(5e-3 * time / 1e-3) * 1e-3
    assert fastest(layout, coarse, time) == np.inf
    slow = 0.05 * time + noise
    assert fastest(layout, slow, time) == pytest.approx(0.01, rel=0.1)
    assert fastest(layout, np.round(0.05 * time / 1e-3) * 1e-3, time) == pytest.approx(
        0.01, rel=0.1
    )


def test_a_place_that_never_moves_shows_none(tmp_path):
    layout = slide(tmp_path).plant.layout
    time = np.arange(0.0, 1.0, 1e-3)
    assert fastest(layout, np.zeros(time.size), time) == np.inf
    assert fastest(layout, np.full(time.size, np.nan), time) == np.inf


def test_a_play_is_no_larger_than_the_way_that_was_measured(tmp_path):
    """In one run: where another one begins is no way."""
    layout = slide(tmp_path).plant.layout
    time = np.arange(0.0, 1.0, 1e-3)
    ways = [0.2 + 0.05 * np.sin(np.pi * time), 0.02 * time]
    runs = [
        read(inputs={}, outputs=("position",), values=way[:, None], roles=KNOWN, time=time,
             valid=np.ones((time.size, 1), bool))
        for way in ways
    ]  # fmt: skip
    places = Places(layout, reached=reached_bounds(layout, runs))
    vector = np.zeros(layout.size)
    vector[layout.index["joint_backlash.gap"]] = 0.01
    (free,) = free_parameters(places, ["joint_backlash.gap"], vector)
    assert free.high == pytest.approx(0.05, rel=1e-3)
    still = read(**{**vars(runs[0]), "values": np.full((time.size, 1), 0.2)})
    (free,) = free_parameters(
        Places(layout, reached=reached_bounds(layout, [still])), ["joint_backlash.gap"], vector
    )
    assert free.high == layout.by_key["joint_backlash.gap"].high

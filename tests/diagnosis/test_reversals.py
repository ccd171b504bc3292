"""Plays are looked for only where something turns back."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.reversals import goes_one_way, turns_back
from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.fit.baseline import COARSE
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.search.state import Search, starts_of
from eha_bench.plants.network.file import load_plant
from eha_bench.plants.plant import Plant

NOISE = {"piston_position": 1e-5, "piston_velocity": 1e-3}
TIME = np.arange(0.0, 2.0, 2e-3)


@pytest.fixture(scope="module")
def plant(repository: Path) -> Plant:
    return load_plant(repository / "suites/plants/valve_cylinder.yaml")


def run_of(plant: Plant, **columns: np.ndarray) -> Measured:
    noise = np.random.default_rng(3)
    read = {
        name: values + NOISE.get(name, 1e3) * noise.standard_normal(TIME.size)
        for name, values in columns.items()
    }
    recording = Recording(TIME, {"valve_command": np.ones(TIME.size), **read})
    run = Run("run", Path("run.csv"), None, False, False, Use.TRAIN, lambda: recording)
    return admit(run, recording, ["valve_command"], plant.outputs, roles=plant.roles)


def search_of(plant: Plant, position: np.ndarray) -> Search:
    """A search that has just begun on one run, in which the position is read."""
    noise = {"piston_position": NOISE["piston_position"]}
    windows = cut_windows(run_of(plant, piston_position=position), noise)
    problem = Problem(plant, windows, noise, COARSE)
    vector = problem.places.lengthened(plant.layout.defaults())
    found = SimpleNamespace(
        problem=problem, fit=SimpleNamespace(vector=vector), declared=(), keys=(), accepted=[]
    )
    return cast(Search, found)


def test_runs_that_go_one_way_do_not(plant: Plant) -> None:
    there = run_of(plant, piston_position=0.04 * np.clip(TIME - 0.3, 0.0, None))
    back = run_of(plant, piston_position=-0.04 * np.clip(TIME - 0.3, 0.0, None))
    # each goes one way: what lies between the two nobody has seen
    assert not turns_back([there, back], NOISE)


def test_one_that_goes_there_and_back_does(plant: Plant) -> None:
    there = run_of(plant, piston_position=0.04 * TIME)
    swing = run_of(plant, piston_position=1e-3 * np.sin(8.0 * TIME))
    assert turns_back([there, swing], NOISE)


def test_a_speed_tells_it_too(plant: Plant) -> None:
    assert turns_back([run_of(plant, piston_velocity=0.1 * np.sin(8.0 * TIME))], NOISE)
    assert not turns_back([run_of(plant, piston_velocity=0.1 + 0.05 * np.sin(8.0 * TIME))], NOISE)


def test_where_nothing_tells_it_may(plant: Plant) -> None:
    assert turns_back([run_of(plant, pressure_a=5e6 + 1e6 * np.sin(8.0 * TIME))], NOISE)


@pytest.mark.parametrize(("dip", "back"), [(0.05, False), (0.2, True)])
def test_a_boom_that_sags_at_first_goes_one_way(plant: Plant, dip: float, back: bool) -> None:
    """As its valve opens."""
    position = 0.04 * np.clip(TIME - 0.2, 0.0, None)
    position -= dip * np.ptp(position) * np.clip(TIME / 0.2, 0.0, 1.0)
    assert turns_back([run_of(plant, piston_position=position)], NOISE) is back


def test_no_play_is_a_candidate_where_nothing_turns_back(plant: Plant) -> None:
    """A command that is late is: at a start from rest both look the same."""
    one_way, swing = (
        {start.candidate for start in starts_of(search_of(plant, position))}
        for position in (0.04 * np.clip(TIME - 0.3, 0.0, None), 0.02 * np.sin(8.0 * TIME))
    )
    assert swing - one_way == {"joint_backlash"}
    assert "command_delay" in one_way


def test_runs_of_both_ways_go_both_ways_together(plant: Plant) -> None:
    there = run_of(plant, piston_position=0.04 * TIME, piston_velocity=0.04 + 0.0 * TIME)
    back = run_of(plant, piston_position=-0.04 * TIME, piston_velocity=-0.04 + 0.0 * TIME)
    assert goes_one_way([there, there], NOISE) == ("piston_position", "piston_velocity")
    assert goes_one_way([there, back], NOISE) == ()
    assert goes_one_way([run_of(plant, pressure_a=5e6 + 1e6 * TIME)], NOISE) == ()

"""Windows end where the last digit of their simulation begins to matter."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from swinging_arm import arm, measured_as, swung

from eha_bench.diagnosis.data.windows import window_at
from eha_bench.diagnosis.fit.least_squares import free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Piece, Problem
from eha_bench.diagnosis.fit.settled import settled_fit
from eha_bench.diagnosis.fit.steady_windows import cut_alike, steady_problem, unsteady_notes

NOISE = {"angle": 1e-4}
TICK = 2e-3
STEP = 2e-3
TICKS = 400


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return arm(tmp_path_factory.mktemp("swing"), 0.02)


def _windows(model, name, count, angle=0.1):
    """So many windows of a run in which an arm swings."""
    time = TICK * np.arange(TICKS * count)
    noise = NOISE["angle"] * np.random.default_rng(3).standard_normal(time.size)
    measured = measured_as(model, time, swung(model, time, angle, noise, 1e-4), name)
    return [window_at(measured, TICKS * k, TICKS * (k + 1), NOISE) for k in range(count)]


class Unsure:
    """A problem of which half a step of integration changes some windows from a tick on."""

    def __init__(self, windows, since, step=STEP) -> None:
        self.windows, self.step, self._since = tuple(windows), step, since
        self.prepared = 0

    @property
    def pieces(self):
        each = ((k, np.arange(w.last - w.first)) for k, w in enumerate(self.windows))
        return [
            Piece(k, slice(k * TICKS, k * TICKS + ticks.size), ticks, np.zeros(ticks.size, int))
            for k, ticks in each
        ]

    def residual(self, _):
        found = np.zeros(TICKS * len(self.windows))
        for number, tick in self._since.items():
            found[number * TICKS + tick : (number + 1) * TICKS] = self.step / STEP
        return found

    def at_step(self, step):
        return Unsure(self.windows, self._since, step)

    def over(self, windows):
        return Unsure(windows, {})

    def prepare(self, _):
        self.prepared += 1


def test_a_window_ends_where_half_a_step_begins_to_matter(model) -> None:
    windows = _windows(model, "swing", 10)
    steady = steady_problem(Unsure(windows, {3: 300, 7: 20}), model.vector())
    assert steady.prepared
    # of one that is unsure from its start nothing is left; a hundredth of 400 is 16 quarters
    assert [w.last - w.first for w in steady.windows] == [400] * 3 + [315] + [400] * 5
    assert [w.first for w in steady.windows] == [400 * k for k in range(10) if k != 7]
    (note,) = unsteady_notes(windows, steady.windows)
    assert note == (
        "run 'swing' is not fitted at 3.03 to 3.2 s, 5.6 to 6.4 s: there small changes of a "
        "parameter change the simulation much, so a fit would learn nothing from it; that is no "
        "fault of the log"
    )


def test_a_stretch_over_two_windows_is_one_in_the_note(model) -> None:
    windows = _windows(model, "swing", 10)
    steady = steady_problem(Unsure(windows, {3: 300, 4: 0}), model.vector())
    (note,) = unsteady_notes(windows, steady.windows)
    assert note.startswith("run 'swing' is not fitted at 3.03 to 4 s: ")


def test_sure_windows_stay_as_they_are(model) -> None:
    problem = Problem(model.plant, _windows(model, "swing", 4), NOISE, STEP)
    problem.prepare(model.vector())
    assert steady_problem(problem, model.vector()) is problem
    assert unsteady_notes(problem.windows, problem.windows) == []


def test_where_much_is_unsure_nothing_goes(model) -> None:
    unsure = Unsure(_windows(model, "swing", 4), {1: 0})
    assert steady_problem(unsure, model.vector()) is unsure


def test_friction_that_sticks_holds_no_other_parameter(model) -> None:
    """A slope of how it creeps, taken where it sticks, leads nowhere, and no step is accepted."""
    problem = Problem(model.plant, _windows(model, "swing", 4), NOISE, STEP)
    problem.prepare(model.vector())
    at = model.plant.layout.index
    vector = model.vector()
    vector[at["drag.viscous"]] *= 1.5
    free = free_parameters(model.plant.layout, ["drag.viscous", "drag.creep_speed"], vector)
    begun = levenberg_marquardt(problem, vector, free, iterations=0)
    fit = settled_fit(problem, begun)
    assert [item.key for item in fit.free] == ["drag.viscous"]
    assert fit.vector[at["drag.viscous"]] == pytest.approx(0.02, rel=0.02)


def test_two_models_are_held_against_the_same_stretches(model) -> None:
    windows = _windows(model, "swing", 10)
    steady = steady_problem(Unsure(windows, {3: 300, 7: 20}), model.vector())
    alike = cut_alike(Unsure(_windows(model, "swing", 10), {}), steady)
    assert [(w.first, w.last) for w in alike.windows] == [(w.first, w.last) for w in steady.windows]

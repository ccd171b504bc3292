"""Of long data a share is fitted; what errs more than all of it is fitted as well."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from swinging_arm import arm, measured_as, swung

from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.fit.chosen_windows import thinned_windows, thinning_notes
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.telling_windows import note_of, telling_windows

NOISE = {"angle": 1e-3}
TICK = 1e-2
SECONDS = 240.0


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return arm(tmp_path_factory.mktemp("swing"), 0.002)


@pytest.fixture(scope="module")
def swing(model):
    time = np.arange(0.0, SECONDS, TICK)
    noise = NOISE["angle"] * np.random.default_rng(5).standard_normal(time.size)
    return time, swung(model, time, 0.3, noise, 1e-3)


def fitted(model, measured):
    chosen = thinned_windows(cut_windows(measured, NOISE))
    problem = Problem(model.plant, chosen, NOISE, 1e-3)
    problem.prepare(model.vector())
    return problem


def test_nothing_is_added_for_its_noise(model, swing) -> None:
    measured = measured_as(model, *swing)
    problem = fitted(model, measured)
    assert len(problem.windows) < len(cut_windows(measured, NOISE))
    assert thinning_notes([measured])
    assert telling_windows(problem, model.vector(), [measured]) == []


def test_the_window_in_which_something_acts_is_added(model, swing) -> None:
    time, angle = swing
    every = cut_windows(measured_as(model, time, angle), NOISE)
    chosen = {window.first for window in fitted(model, measured_as(model, time, angle)).windows}
    hidden = [window for window in every if window.first not in chosen][3]
    # something holds the arm for a fifth of a second
    at = slice(hidden.first + 20, hidden.first + 40)
    pushed = angle.copy()
    pushed[at] += 20.0 * NOISE["angle"]
    measured = measured_as(model, time, pushed)
    (found,) = telling_windows(fitted(model, measured), model.vector(), [measured])
    assert found.first <= hidden.first + 20 < found.last
    assert "in swing, the model errs more" in note_of([found])


def test_what_acts_everywhere_adds_nothing(model, swing) -> None:
    time, angle = swing
    measured = measured_as(model, time, 1.1 * angle)
    vector = model.vector()
    vector[model.plant.layout.index["arm.length"]] *= 1.05
    problem = fitted(model, measured)
    added = telling_windows(problem, vector, [measured])
    assert len(added) <= 0.1 * len(problem.windows)


def test_a_window_in_which_all_rests_has_a_reading(model, swing) -> None:
    time, _ = swing
    # what moves is finer than the step, and what rests reads the same
    swings = np.round(0.3 * np.exp(-time / 20.0) * np.cos(3.0 * time), 3)
    measured = measured_as(model, time, np.where(time < 40.0, swings, swings[4000]))
    assert measured.distinct[5000:].sum() <= 1
    for span in (slice(5000, 5100), slice(11000, 11100)):
        assert measured.distinct_within(span).sum() == 1
    problem = Problem(model.plant, cut_windows(measured, NOISE), NOISE, 1e-3)
    problem.prepare(model.vector())
    assert all(piece.ticks.size for piece in problem.pieces)

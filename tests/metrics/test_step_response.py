"""What a step's response knows of its levels and places, as the step metrics ask for it."""

from types import SimpleNamespace

import numpy as np
import pytest

from eha_bench.core.budget import Budget
from eha_bench.metrics.coverage import between
from eha_bench.metrics.step_response import StepResponse, step_responses


@pytest.mark.parametrize(
    ("steps", "share"), [(0.2, 1.0), (1.0, 1.0), (1.5, 1 / 1.5), (40.0, 1 / 40)]
)
def test_a_place_found_in_many_steps_of_the_sensor_is_known_to_a_part_of_one(steps, share):
    reading: Budget = between("resolution", 0.01)
    step = SimpleNamespace(resolution=0.01, reading=reading)
    crossing = SimpleNamespace(slope=-2.0, span=steps * 0.01 / 2.0)
    found = StepResponse.rounding(step, crossing)
    assert found.standard == pytest.approx(share * reading.standard)


@pytest.mark.parametrize("resolution", [0.0, 2e-4])
def test_a_level_that_is_still_approached_is_found_by_a_coarse_sensor_too(kit, resolution):
    """Its steps q count as noise of q / sqrt(12) in the tail's samples, and as no more."""
    recording, trial = kit.step(lambda t: 1.0 - np.exp(-t), hold=5.0)
    values = recording[kit.channel]
    if resolution:
        values = resolution * np.round(values / resolution)
    (step,) = step_responses(recording.with_values({kit.channel: values}), trial, kit.channel)
    # the mean over the last fifth is off by 0.0116
    assert step.final == pytest.approx(1.0, abs=1e-3)

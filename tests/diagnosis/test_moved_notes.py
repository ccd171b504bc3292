"""Parameters that a calibration takes far from what was declared are noted, as values."""

from dataclasses import replace

import pytest

from eha_bench.diagnosis.fit.convergence import AT_BOUND, MOVED_FAR, MOVED_OUT, moved_notes
from eha_bench.plants.model import load_model

LEAK = "leakage"
MODEL = replace(load_model("physical"), calibrate=(LEAK, "torque_constant"))
DECLARED = MODEL.value(LEAK)


@pytest.mark.parametrize(
    ("factor", "at_bounds", "within", "template"),
    [
        (2.9, {}, {}, None),
        (3.1, {}, {}, MOVED_FAR),
        (1.0 / 3.1, {}, {}, MOVED_FAR),
        (1.2, {}, {LEAK: 0.1 * DECLARED}, MOVED_OUT),
        (1.05, {}, {LEAK: 0.1 * DECLARED}, None),
        (5.0, {LEAK: 5.0 * DECLARED}, {}, AT_BOUND),
    ],
)
def test_what_is_noted(factor, at_bounds, within, template):
    model = replace(MODEL, within=within)
    notes = moved_notes(model, {LEAK: factor * DECLARED}, at_bounds)
    assert [note.template for note in notes] == ([] if template is None else [template])
    for note in notes:
        assert note.values["key"] == LEAK
        assert note.values["value"] == factor * DECLARED
        assert note.startswith("CAUTION: leakage")


def test_a_parameter_that_was_not_fitted_is_not_noted():
    assert moved_notes(MODEL, {}, {}) == []


@pytest.mark.parametrize(
    ("interval", "said"),
    [
        ((1.05 * DECLARED, 1.35 * DECLARED), False),
        ((1.15 * DECLARED, 1.25 * DECLARED), True),
        ((-float("inf"), float("inf")), True),  # of a fit that has no interval nothing is known
    ],
)
def test_what_its_interval_does_not_tell_from_what_is_given_is_not_noted(interval, said):
    model = replace(MODEL, within={LEAK: 0.1 * DECLARED})
    notes = moved_notes(model, {LEAK: 1.2 * DECLARED}, {}, {LEAK: interval})
    assert bool(notes) is said

"""Where a model holds: its error by the value of each channel, and beyond what was fitted."""

import json

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from eha_bench.diagnosis.data.dataset import Use
from eha_bench.diagnosis.replay.error_by_value import beyond_notes, errors_by_value
from eha_bench.diagnosis.replay.replay import Replay
from eha_bench.posterior.covered import Covered, CoveredSetup

NOISE = {"angle": 1e-3}
TIME = np.arange(0.0, 20.0, 0.01)


def _replay(run: str, use: Use, angle, error, inputs=None) -> Replay:
    """Return a run whose last model errs by (n,) `error` rad."""
    columns = {"angle": angle - error}
    return Replay(
        run, use, False, False, TIME, inputs or {}, {"angle": angle}, (columns,) * 3,
        (columns,) * 3, {}, {"angle": "rad", "command": "rad"},
    )  # fmt: skip


def _covered(**extremes: tuple[float, float]) -> Covered:
    return Covered(100.0, 20.0, {}, NOISE, {}, (CoveredSetup("free", "closed", extremes),))


def _two(error_beyond: float) -> tuple[list[Replay], Covered]:
    """Return a fitted run within 0.15 rad and an unseen one that goes to 0.45 rad."""
    near, far = 0.15 * np.sin(TIME), 0.15 + 0.3 * np.sin(TIME)
    small = 2e-3 * np.cos(7.0 * TIME)
    large = np.where(far > 0.15, error_beyond, small)
    runs = [_replay("sines", Use.TRAIN, near, small), _replay("hold", Use.UNSEEN, far, large)]
    return runs, _covered(angle=(-0.15, 0.15))


def test_the_error_stands_in_the_bin_where_it_is() -> None:
    """Five bins of 0.06 rad; the error is 5 mrad above 0.03 rad alone, as counted by hand."""
    angle = 0.15 * np.sin(TIME)
    (row,) = errors_by_value(
        [_replay("sines", Use.TRAIN, angle, np.where(angle > 0.03, 5e-3, 1e-3))],
        _covered(angle=(-0.15, 0.15)),
    )
    assert [item.error for item in row.bins] == pytest.approx([1e-3] * 3 + [5e-3] * 2)
    assert row.bins[3].low == pytest.approx(0.03)
    assert row.below is row.above is None
    assert sum(item.seconds for item in row.bins) == pytest.approx(20.0, rel=1e-3)
    assert (row.channel, row.unit, row.by, row.by_unit) == ("angle", "rad", "angle", "rad")


def test_what_lies_beyond_stands_apart() -> None:
    (row,) = errors_by_value(*_two(0.04))
    assert row.above is not None
    assert row.above.error == pytest.approx(0.04, rel=0.01)
    assert (row.above.low, row.above.high) == pytest.approx((0.15, 0.45), abs=1e-4)
    assert row.above.fitted == 0.0
    assert row.below is None, "a tenth of the range outside of it still counts as fitted"


def test_it_is_said_where_the_model_errs_more_beyond() -> None:
    (note,) = beyond_notes(*_two(0.04), NOISE)
    assert "hold (unseen) takes 'angle' to 0.45 rad" in note
    assert "from -0.15 to 0.15" in note
    assert "errs by 0.04 rad in 'angle', within it by 0.00141" in note


def test_nothing_is_said_where_it_errs_as_much() -> None:
    assert not list(beyond_notes(*_two(2e-3), NOISE))


def test_nothing_is_said_of_fitted_runs_or_of_noise() -> None:
    runs, covered = _two(0.04)
    assert not list(beyond_notes(runs[:1], covered, NOISE))
    assert not list(beyond_notes(runs, covered, {"angle": 0.02}))


def test_an_input_parts_the_error_as_well_and_a_constant_one_does_not() -> None:
    angle, command = 0.1 * np.sin(TIME), np.where(TIME < 10.0, 0.2, 0.4)
    run = _replay(
        "steps", Use.TRAIN, angle, np.where(TIME < 10.0, 1e-3, 9e-3),
        {"command": command, "supply": np.full(TIME.size, 5.0)},
    )  # fmt: skip
    rows = {
        item.by: item
        for item in errors_by_value(
            [run], _covered(angle=(-0.1, 0.1), command=(0.2, 0.4), supply=(5.0, 5.0))
        )
    }
    assert set(rows) == {"angle", "command"}
    errors = [item.error for item in rows["command"].bins]
    assert errors[0] == pytest.approx(1e-3)
    assert errors[4] == pytest.approx(9e-3)
    assert np.isnan(errors[1:4]).all(), "nothing was recorded there"
    json.dumps([item.to_dict() for item in rows.values()], allow_nan=False)


@given(st.floats(-1.0, 1.0), st.floats(0.01, 2.0), st.floats(1e-4, 1.0), st.integers(0, 2**31))
def test_bins_add_up_to_the_whole(centre: float, span: float, size: float, seed: int) -> None:
    """The mean square over all bins, each with its time, is that over all samples."""
    rng = np.random.default_rng(seed)
    angle = centre + span * rng.uniform(-1.0, 1.0, TIME.size)
    error = size * rng.standard_normal(TIME.size)
    rows = errors_by_value(
        [_replay("noise", Use.HOLDOUT, angle, error)],
        _covered(angle=(centre - 0.5 * span, centre + 0.5 * span)),
    )
    parts = [item for row in rows for item in (row.below, *row.bins, row.above) if item]
    if not rows:
        return
    # of a few samples no error is told
    assume(all(np.isfinite(item.error) for item in parts))
    total = sum(item.seconds for item in parts)
    square = sum(item.error**2 * item.seconds for item in parts) / total
    assert total == pytest.approx(20.0, rel=1e-3)
    assert np.sqrt(square) == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-6)

"""Runs whose readings come later from some moment on."""

from dataclasses import replace

import numpy as np
import pytest

from eha_bench.diagnosis.data.dataset import Use
from eha_bench.diagnosis.replay.delay_jump import delay_jump, ended_at_jumps
from eha_bench.diagnosis.replay.replay import Replay

NOISE = 1e-3
TICK = 0.02


def _replay(measured, simulated, tick: float = TICK, *, is_bounded: bool = True) -> Replay:
    """Return a run of one channel, replayed by three models that agree."""
    time = tick * np.arange(len(measured))
    columns = {"angle": np.asarray(simulated)}
    return Replay(
        "chirp", Use.HOLDOUT, False, False, time, {}, {"angle": np.asarray(measured)},
        (columns,) * 3, (columns,) * 3, {}, {"angle": "rad"}, is_bounded,
    )  # fmt: skip


def _sweep(time):
    return 0.15 * np.sin(2 * np.pi * (0.1 * time + 0.01 * time**2))


def _run(delays, seconds: float = 60.0, seed: int = 0):
    """Return readings of a sweep, each late by its own delay in s, and the sweep."""
    time = np.arange(0.0, seconds, TICK)
    noise = np.random.default_rng(seed).normal(0.0, NOISE, time.size)
    return _sweep(time - delays(time)) + noise, _sweep(time)


@pytest.mark.parametrize("later", [0.06, 0.15, -0.08])
def test_a_jump_is_found_where_it_is(later: float) -> None:
    measured, simulated = _run(lambda time: np.where(time < 40.0, 0.04, 0.04 + later))
    jump = delay_jump(_replay(measured, simulated), {"angle": NOISE})
    assert jump is not None
    assert jump.time == pytest.approx(40.0, abs=0.5)
    assert jump.later == pytest.approx(later, abs=1.01 * TICK)
    assert jump.shifted < 0.5 * jump.error


def test_where_errors_add_up_nothing_keeps_the_time() -> None:
    measured, simulated = _run(lambda time: np.where(time < 40.0, 0.04, 0.1))
    item = _replay(measured, simulated, is_bounded=False)
    assert delay_jump(item, {"angle": NOISE}) is None


@pytest.mark.parametrize(
    ("what", "delays"),
    [
        ("always the same", lambda time: np.full(time.size, 0.1)),
        ("grows slowly", lambda time: 0.1 * time / 60.0),
        ("none", lambda time: np.zeros(time.size)),
        ("less than two samples", lambda time: np.where(time < 40.0, 0.0, 0.02)),
    ],
)
def test_no_other_lag_is_a_jump(what: str, delays) -> None:
    measured, simulated = _run(delays)
    assert delay_jump(_replay(measured, simulated), {"angle": NOISE}) is None, what


def test_an_offset_of_a_ramp_is_no_jump() -> None:
    """A triangle's rising half, 0.1 rad off, is the same as one that comes later."""
    time = np.arange(0.0, 60.0, TICK)
    triangle = np.abs((time / 20.0) % 2.0 - 1.0)
    off = np.where(time < 35.0, 0.0, 0.01)
    measured = triangle + off + np.random.default_rng(1).normal(0.0, NOISE, time.size)
    assert delay_jump(_replay(measured, triangle), {"angle": NOISE}) is None


def test_one_late_event_is_no_jump() -> None:
    """A rod that slips once, later than simulated, and rests after that."""
    time = np.arange(0.0, 60.0, TICK)
    simulated = np.where(time < 40.0, _sweep(time), 0.1 * (time > 45.0))
    measured = np.where(time < 40.0, _sweep(time), 0.1 * (time > 45.2))
    assert delay_jump(_replay(measured, simulated), {"angle": NOISE}) is None


def test_no_jump_in_noise_whatever_is_missing() -> None:
    """Errors that are no shift: a gain, an offset, and another frequency; 60 runs of each."""
    found = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        time = np.arange(0.0, 30.0, TICK)
        simulated = _sweep(time)
        extra = rng.uniform(0.01, 0.1) * np.sin(rng.uniform(1.0, 20.0) * time)
        for wrong in (rng.uniform(0.5, 1.5) * simulated, simulated + 0.05, simulated + extra):
            measured = wrong + rng.normal(0.0, NOISE, time.size)
            found += delay_jump(_replay(measured, simulated), {"angle": NOISE}) is not None
    assert found == 0


def test_errors_count_up_to_the_jump() -> None:
    measured, simulated = _run(lambda time: np.where(time < 40.0, 0.0, 0.1))
    replays, notes = ended_at_jumps([_replay(measured, simulated)], {"angle": NOISE})
    (error, *_) = replays[0].errors("angle")
    assert np.sqrt(np.nanmean(error**2)) < 1.2 * NOISE
    assert np.isnan(error[replays[0].time > 40.5]).all()
    assert "chirp: from 4" in notes[0]
    assert "ms later than before" in notes[0]


@pytest.mark.parametrize("part", [np.s_[:3], np.s_[:0]])
def test_a_run_too_short_has_none(part) -> None:
    measured, simulated = _run(lambda time: np.zeros(time.size))
    assert delay_jump(_replay(measured[part], simulated[part]), {"angle": NOISE}) is None


def test_readings_at_half_the_rate_and_a_simulation_that_diverges() -> None:
    measured, simulated = _run(lambda time: np.where(time < 40.0, 0.0, 0.12))
    measured[1::2] = np.nan
    jump = delay_jump(_replay(measured, simulated), {"angle": NOISE})
    assert jump is not None
    assert jump.time == pytest.approx(40.0, abs=0.5)
    simulated[2500:] = np.inf
    assert delay_jump(_replay(measured, simulated), {"angle": NOISE}) is None


@pytest.mark.parametrize(("models_agree", "found"), [(True, True), (False, False)])
def test_two_models_have_to_show_it(models_agree: bool, found: bool) -> None:
    """A resonance that one model has at another frequency looks like a jump to that one alone."""
    measured, simulated = _run(lambda time: np.where(time < 40.0, 0.04, 0.12))
    item = _replay(measured, simulated)
    other = {"angle": simulated if models_agree else measured}
    for models in ((other, *item.simulated[1:2]), (*item.simulated[1:2], other)):
        jump = delay_jump(replace(item, simulated=models), {"angle": NOISE})
        assert (jump is not None) == found

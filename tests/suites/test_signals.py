"""Every signal: its samples are what its features say, and its defining formula holds."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from eha_bench.core import plugins
from eha_bench.core.arrays import FloatArray
from eha_bench.core.excerpt import Excerpt
from eha_bench.core.signal import Signal, Spacing
from eha_bench.suites.signals.chirp import Chirp
from eha_bench.suites.signals.constant import Constant
from eha_bench.suites.signals.multisine import Multisine
from eha_bench.suites.signals.prbs import Prbs
from eha_bench.suites.signals.ramp import Ramp
from eha_bench.suites.signals.signal_model import SignalModel
from eha_bench.suites.signals.sine import Sine
from eha_bench.suites.signals.step import Step
from eha_bench.suites.signals.stepped_sine import SteppedSine
from eha_bench.suites.signals.steps import Steps
from eha_bench.suites.signals.trajectory import Trajectory, TrajectorySamples

RATE = 1000.0
levels = st.floats(-100, 100).map(lambda value: round(value, 3))
moments = st.integers(0, 500).map(lambda ticks: ticks / RATE)
lengths = st.integers(1, 400).map(lambda ticks: ticks / RATE)
frequencies = st.floats(0.5, 100)
lists = st.lists(levels, min_size=1, max_size=8)

steps = st.builds(Step, kind=st.just("step"), initial=levels, final=levels, at=moments)
staircases = lists.flatmap(
    lambda found: st.builds(
        Steps,
        kind=st.just("steps"),
        initial=levels,
        levels=st.just(tuple(found)),
        hold=lengths | st.tuples(*[lengths] * len(found)),
        at=moments,
    )
)
sines = st.builds(
    Sine,
    kind=st.just("sine"),
    amplitude=levels,
    frequency=frequencies,
    offset=levels,
    phase=st.floats(-7, 7),
    at=moments,
    cycles=st.none() | st.floats(0.5, 20),
)
ramps = st.builds(
    Ramp, kind=st.just("ramp"), initial=levels, final=levels, over=lengths, at=moments
)
chirps = st.builds(
    lambda a, b, span, at, spacing, offset: Chirp(
        kind="chirp",
        amplitude=2.0,
        f_start=a,
        f_stop=b + (a == b),
        duration=span,
        spacing=spacing,
        at=at,
        offset=offset,
    ),
    frequencies,
    frequencies,
    st.floats(0.2, 3),
    moments,
    st.sampled_from(Spacing),
    levels,
)
stepped = st.lists(frequencies, min_size=1, max_size=5).flatmap(
    lambda found: st.builds(
        SteppedSine,
        kind=st.just("stepped_sine"),
        amplitude=levels | st.tuples(*[levels] * len(found)),
        frequencies=st.just(tuple(found)),
        cycles=st.integers(1, 4),
        dwell=st.none() | st.floats(0.01, 0.5),
        offset=levels,
        at=moments,
    )
)
multisines = st.builds(
    lambda lowest, width, amplitude, offset, periods, realisations, seed, at, harmonics: Multisine(
        kind="multisine",
        amplitude=amplitude,
        period=0.5,
        f_min=lowest,
        f_max=lowest + width,
        periods=periods,
        realisations=realisations,
        seed=seed,
        offset=offset,
        at=at,
        harmonics=harmonics,
    ),
    st.floats(2, 20),
    st.floats(4, 60),
    st.floats(0.1, 10),
    levels,
    st.integers(1, 3),
    st.integers(1, 3),
    st.integers(0, 2**63 - 1),
    moments,
    st.sampled_from(["all", "odd"]),
)
prbs = st.builds(
    lambda low, width, bit, order, periods, seed, at, initial: Prbs(
        kind="prbs",
        low=low,
        high=low + width,
        bit=bit,
        order=order,
        periods=periods,
        seed=seed,
        at=at,
        initial=initial,
    ),
    levels,
    st.floats(0.5, 50),
    st.integers(1, 20).map(lambda ticks: ticks / RATE),
    st.integers(2, 7),
    st.integers(1, 3),
    st.integers(0, 1000),
    moments,
    st.none() | levels,
)
tables = st.lists(st.tuples(st.floats(0.01, 1), levels), min_size=2, max_size=20).map(
    lambda rows: Trajectory(
        kind="trajectory",
        samples=TrajectorySamples(
            time=tuple(itertools.accumulate(gap for gap, _ in rows)),
            value=tuple(value for _, value in rows),
        ),
    )
)
constants = st.builds(Constant, kind=st.just("constant"), value=levels)
anything = st.one_of(
    steps, staircases, sines, ramps, chirps, stepped, multisines, prbs, tables, constants
)


def clock(signal: Signal, *, until: float = 2.0) -> FloatArray:
    stop = signal.duration if math.isfinite(signal.duration) else until
    return np.arange(-200, max(1, round(stop * RATE)) + 300) / RATE


def test_every_kind_is_registered() -> None:
    for kind in [
        "step",
        "steps",
        "ramp",
        "sine",
        "chirp",
        "stepped_sine",
        "multisine",
        "prbs",
        "trajectory",
        "constant",
    ]:
        model = plugins.load("signals", kind)
        assert issubclass(model, SignalModel)
        assert model.model_fields["kind"].annotation.__args__ == (kind,)


@given(anything)
def test_samples_are_finite_and_held_outside(signal: Signal) -> None:
    time = clock(signal)
    values = signal(time)
    assert values.shape == time.shape
    assert np.all(np.isfinite(values))
    assert signal.duration > 0 or isinstance(signal, Trajectory)
    assert np.ptp(values[time < -1e-6]) == 0
    if math.isfinite(signal.duration):
        assert np.ptp(values[time > signal.duration + 1e-6]) <= 1e-9 * max(1, np.ptp(values))


@given(anything)
def test_text_form_gives_the_same_signal(signal: SignalModel) -> None:
    again = type(signal).model_validate_json(signal.model_dump_json(by_alias=True))
    assert again == signal
    time = clock(signal)
    np.testing.assert_array_equal(again(time), signal(time))


@given(steps | staircases | prbs)
def test_edges_are_where_samples_jump(signal: Signal) -> None:
    time = clock(signal)
    values = signal(time)
    jumps = np.flatnonzero(np.diff(values)) + 1
    edges = signal.edges
    assert [round(edge.time * RATE) for edge in edges] == [round(time[i] * RATE) for i in jumps]
    for edge, jump in zip(edges, jumps, strict=True):
        assert (edge.before, edge.after) == (values[jump - 1], values[jump])
    for edge, following in itertools.pairwise(edges):
        assert edge.until == following.time
        assert edge.after == following.before
    assert not edges or edges[-1].until == signal.duration


@given(sines | stepped)
def test_tone_formula_gives_the_samples(signal: Signal) -> None:
    time = clock(signal)
    values = signal(time)
    covered = np.zeros(time.size, dtype=bool)
    for tone in signal.tones:
        inside = (time >= tone.start) & (time < tone.stop)
        angle = 2 * np.pi * tone.frequency * (time[inside] - tone.start) + tone.phase
        expected = tone.offset + tone.amplitude * np.sin(angle)
        np.testing.assert_allclose(
            values[inside], expected, atol=1e-7 * max(1, abs(tone.amplitude))
        )
        assert not np.any(covered & inside)
        covered |= inside
    at = signal.tones[0].start
    np.testing.assert_array_equal(covered, (time >= at) & (time < signal.tones[-1].stop))


@given(stepped)
def test_stepped_sine_lasts_whole_periods_and_is_continuous(signal: SteppedSine) -> None:
    for tone in signal.tones:
        periods = (tone.stop - tone.start) * tone.frequency
        assert periods == pytest.approx(round(periods), abs=1e-6)
        assert round(periods) >= signal.cycles
        assert tone.stop - tone.start >= (signal.dwell or 0) - 1e-6
        ends = signal(np.array([tone.start, tone.stop - 1e-9]))
        np.testing.assert_allclose(ends, signal.offset, atol=1e-3)


@given(multisines)
def test_multisine_has_power_on_its_lines_only(signal: Multisine) -> None:
    for lines in signal.lines:
        count = round(lines.period * RATE)
        time = lines.start + np.arange(count) / RATE
        spectrum = np.abs(np.fft.rfft(signal(time))) / count * 2
        excited = np.zeros(spectrum.size, dtype=bool)
        excited[list(lines.harmonics)] = True
        np.testing.assert_allclose(spectrum[excited], spectrum[excited][0], rtol=1e-6)
        assert np.all(spectrum[1:][~excited[1:]] < 1e-6 * spectrum[excited][0])
        later = signal(time + lines.period * (signal.periods - 1))
        np.testing.assert_allclose(later, signal(time), atol=1e-6 * signal.amplitude)
        frequencies = np.array(lines.harmonics) / lines.period
        assert np.all((frequencies >= signal.f_min - 1e-6) & (frequencies <= signal.f_max + 1e-6))


@given(multisines)
def test_multisine_keeps_its_amplitude(signal: Multisine) -> None:
    time = np.linspace(signal.at, signal.duration, 20_000)
    largest = float(np.max(np.abs(signal(time) - signal.offset)))
    assert largest == pytest.approx(signal.amplitude, rel=0.01)


def multisine(**changes: Any) -> Multisine:
    given_ = {"amplitude": 1.0, "period": 1.0, "f_min": 1.0, "f_max": 31.0, **changes}
    return Multisine.model_validate({"kind": "multisine", **given_})


def test_multisine_realisations_differ_and_are_seeded() -> None:
    time = np.arange(1000) / RATE
    signal = multisine(realisations=2, periods=2, seed=5)
    assert np.max(np.abs(signal(time) - signal(time + 2.0))) > 0.1
    np.testing.assert_array_equal(multisine(realisations=2, periods=2, seed=5)(time), signal(time))
    assert np.max(np.abs(multisine(realisations=2, periods=2, seed=6)(time) - signal(time))) > 0.1


def test_multisine_phases_do_not_depend_on_the_version_of_numpy() -> None:
    # raw bits of PCG64 under SeedSequence are fixed by NumPy's compatibility policy (NEP 19)
    first = multisine(seed=1, f_min=1.0, f_max=2.0)._phases[0] / (2 * np.pi)
    np.testing.assert_allclose(first, PHASES_OF_SEED_1, atol=1e-12)


PHASES_OF_SEED_1 = [0.6990345474368358, 0.17433552137309583]


def test_schroeder_phases_have_a_low_crest_factor() -> None:
    time = np.arange(4000) / 4000
    values = multisine(phases="schroeder", f_max=60.0)(time)
    crest = float(np.max(np.abs(values)) / np.sqrt(np.mean(values**2)))
    assert crest < 1.9  # a single sine has 1.41, random phases 2.5 to 4, equal phases 11


def test_odd_multisine_excites_odd_lines_only() -> None:
    assert multisine(harmonics="odd", f_max=10.0).lines_excited == (1, 3, 5, 7, 9)
    assert multisine(harmonics="odd", f_min=2.0, f_max=6.0).lines_excited == (3, 5)
    assert multisine(period=0.1, f_min=10.0, f_max=30.0).lines_excited == (1, 2, 3)


@given(chirps)
def test_chirp_has_the_frequency_that_its_sweep_says(signal: Chirp) -> None:
    (sweep,) = signal.sweeps
    assert sweep.frequency(sweep.start) == pytest.approx(signal.f_start)
    assert sweep.frequency(sweep.stop) == pytest.approx(signal.f_stop)
    # numeric derivative of the phase, in quadrature: x'' + (2 pi f)^2 x is small beside (2 pi f)^2
    middle = sweep.start + 0.4 * (sweep.stop - sweep.start)
    frequency = sweep.frequency(middle)
    cycles = abs(signal.f_stop - signal.f_start) / frequency**2 / (sweep.stop - sweep.start)
    assume(cycles < 0.01)
    step = 1e-3 / frequency
    time = middle + step * np.arange(-600, 601)
    assume(time[0] > sweep.start and time[-1] < sweep.stop)
    values = signal(time) - signal.offset
    rising = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    assume(rising.size >= 1)
    first = rising[0]
    slope = (values[first + 1] - values[first]) / step
    at_zero = sweep.frequency(time[first])
    assert slope == pytest.approx(2 * np.pi * at_zero * signal.amplitude, rel=0.02)


def test_chirps_of_both_spacings_by_their_closed_forms() -> None:
    # linear: f0 t + (f1 - f0) t^2 / (2 T) turns; logarithmic: f0 T / ln(f1/f0) ((f1/f0)^(t/T) - 1)
    time = np.array([0.0, 0.3, 1.1, 2.0])
    common = {"kind": "chirp", "amplitude": 1.0, "f_start": 1.0, "f_stop": 9.0, "duration": 2.0}
    linear = Chirp.model_validate({**common, "spacing": "linear"})
    np.testing.assert_allclose(
        linear(time), np.sin(2 * np.pi * (time + 8 * time**2 / 4)), atol=1e-12
    )
    logarithmic = Chirp.model_validate({**common, "spacing": "logarithmic"})
    turns = 2 / math.log(9) * (9 ** (time / 2) - 1)
    np.testing.assert_allclose(logarithmic(time), np.sin(2 * np.pi * turns), atol=1e-12)


@given(ramps)
def test_ramp_is_straight(signal: Ramp) -> None:
    time = signal.at + signal.over * np.linspace(0, 1, 11)
    expected = np.linspace(signal.initial, signal.final, 11)
    np.testing.assert_allclose(signal(time), expected, atol=1e-9)


@given(prbs)
def test_prbs_is_a_maximal_length_sequence(signal: Prbs) -> None:
    length = 2**signal.order - 1
    bits = signal(signal.at + signal.bit * (np.arange(length) + 0.5)) > signal.low
    assert np.count_nonzero(bits) == 2 ** (signal.order - 1)  # one more high than low
    windows = {tuple(np.roll(bits, -i)[: signal.order]) for i in range(length)}
    assert len(windows) == length  # every pattern of `order` bits but all low, once
    assert np.any([any(window) for window in windows])


def test_prbs_of_several_periods_reports_its_lines() -> None:
    signal = Prbs(kind="prbs", low=-1.0, high=1.0, bit=0.01, order=5, periods=3)
    (lines,) = signal.lines
    assert lines.period == pytest.approx(0.31)
    assert lines.harmonics == tuple(range(1, 13))
    assert Prbs(kind="prbs", low=-1.0, high=1.0, bit=0.01, order=5).lines == ()


@given(tables)
def test_trajectory_passes_through_its_rows(signal: Trajectory) -> None:
    assert signal.samples is not None
    time = np.array(signal.samples.time) - signal.samples.time[0] + signal.at
    np.testing.assert_allclose(signal(time), signal.samples.value, atol=1e-9)


@pytest.mark.parametrize("at", [k / 10 for k in range(1, 40)])
def test_edge_on_a_tick_is_on_that_tick(at: float) -> None:
    """Sums of holds are not exact in binary; the jump must not slip to the next tick."""
    signal = Steps(kind="steps", levels=tuple(range(1, 41)), hold=0.1)
    tick = np.array([round(at * RATE) / RATE])
    assert signal(tick)[0] == round(at * 10) + 1


@given(anything, st.floats(0.05, 3))
def test_excerpt_keeps_values_and_cuts_features(signal: Signal, length: float) -> None:
    cut = Excerpt(signal, length)
    assert cut.duration == length
    time = np.arange(round(length * RATE)) / RATE
    np.testing.assert_array_equal(cut(time), signal(time))
    for edge in cut.edges:
        assert 0 <= edge.time < edge.until <= length
        held = cut(np.array([edge.time + 1e-6, edge.until - 1e-6]))
        if edge.until - edge.time > 3e-6:
            np.testing.assert_array_equal(held, edge.after)
    for stretch in (*cut.tones, *cut.lines, *cut.sweeps):
        assert stretch.start < stretch.stop <= length
    jumps = np.count_nonzero(np.diff(signal(np.append(time, time[-1:]))))
    if isinstance(signal, (Step, Steps, Prbs)):
        assert len(cut.edges) >= jumps


def test_excerpt_of_a_chirp_ends_at_the_frequency_reached() -> None:
    common = {"kind": "chirp", "amplitude": 1.0, "f_start": 1.0, "f_stop": 100.0, "duration": 2.0}
    (sweep,) = Excerpt(Chirp.model_validate(common), 1.0).sweeps
    assert sweep.f_stop == pytest.approx(10.0)
    (sweep,) = Excerpt(Chirp.model_validate({**common, "spacing": "linear"}), 1.0).sweeps
    assert sweep.f_stop == pytest.approx(50.5)


def test_excerpt_longer_than_its_signal_holds_the_last_level() -> None:
    signal = Steps(kind="steps", levels=(1.0, 2.0), hold=0.1)
    first, last = Excerpt(signal, 1.0).edges
    assert (first.until, last.until) == (pytest.approx(0.1), 1.0)

"""Whatever is recorded, every metric gives a value or a reason: never an exception or a warning."""

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from eha_bench.core.recording import Recording
from eha_bench.core.signal import Lines, Signal, Sweep, Tone
from eha_bench.metrics import all_metrics, score
from eha_bench.metrics.scoring import metric

CHANNEL = "pressure_difference"


class Featured(Signal):
    """Any signal with any features."""

    def __init__(self, function, duration, **features):
        self._function, self._duration, self._features = function, duration, features

    @property
    def duration(self):
        return self._duration

    def __call__(self, time):
        return self._function(np.asarray(time, dtype=np.float64))

    @property
    def tones(self):
        return self._features.get("tones", ())

    @property
    def lines(self):
        return self._features.get("lines", ())

    @property
    def sweeps(self):
        return self._features.get("sweeps", ())


def signals(kit):
    two = (Tone(0.0, 1.0, 10.0, 1.0), Tone(1.0, 1.5, 20.0, 1.0))
    lines = tuple(Lines(0.6 * k, 0.6 * (k + 1), 0.2, (1, 3, 5, 7)) for k in range(3))
    comb = [np.random.default_rng(k).uniform(0, 6.28, 4) for k in range(3)]

    def multisine(time):
        index = np.clip((time // 0.6).astype(int), 0, 2)
        phase = np.array(comb)[index]
        return sum(
            np.sin(2 * np.pi * h * time / 0.2 + phase[:, i]) for i, h in enumerate((1, 3, 5, 7))
        )

    return {
        "step": kit.Steps((0.1,), (1.0, 3.0), 1.0),
        "steps": kit.Steps((0.1, 0.4, 0.7), (0.0, 1.0, -1.0, 0.5), 1.0),
        "endless": kit.Steps((0.001,), (0.0, 1.0), math.inf),
        "sine": kit.Sines((Tone(0.0, 1.0, 8.0, 1.0),)),
        "stepped": kit.Sines(two),
        "sweep": Featured(
            lambda t: np.sin(2 * np.pi * (1 + 9 * t) * t), 1.0, sweeps=(Sweep(0.0, 1.0, 1.0, 19.0),)
        ),
        "multisine": Featured(multisine, 1.8, lines=lines),
        "constant": Featured(lambda t: np.full_like(t, 2.0), 1.0),
    }


KINDS = ("step", "steps", "endless", "sine", "stepped", "sweep", "multisine", "constant")
SPECIAL = (
    "as is",
    "constant",
    "zero",
    "nan",
    "some nan",
    "inf",
    "huge",
    "tiny",
    "reversed",
    "saturated",
    "one sample",
    "two samples",
    "short",
    "no reference",
    "random",
)


def recorded(draw, kit, kind):
    """Draw a recording of a trial: a response, then one of the things that go wrong."""
    signal = signals(kit)[kind]
    rate = draw(st.sampled_from([50.0, 200.0, 1000.0]))
    duration = 1.0 if math.isinf(signal.duration) else signal.duration
    settle = draw(st.sampled_from([0.0, 0.05, 0.3]))
    ticks = np.arange(-round(settle * rate), round(duration * rate)) / rate
    reference = signal(ticks)
    lag = draw(st.floats(0.0, 0.3))
    values = signal(ticks - lag)
    noise = draw(st.sampled_from([0.0, 1e-9, 0.01, 1.0]))
    rng = np.random.default_rng(draw(st.integers(0, 1000)))
    values = values + noise * rng.normal(size=ticks.size)
    special = draw(st.sampled_from(SPECIAL))
    if special == "constant":
        values = np.full(ticks.size, draw(st.floats(-1e9, 1e9)))
    elif special == "zero":
        values, reference = np.zeros(ticks.size), np.zeros(ticks.size)
    elif special in ("nan", "inf"):
        values = np.full(ticks.size, np.nan if special == "nan" else np.inf)
    elif special == "some nan":
        values = np.where(rng.random(ticks.size) < 0.1, np.nan, values)
    elif special == "huge":
        values = np.clip(values, -1.0, 1.0) * 1e308
    elif special == "tiny":
        values, reference = values * 5e-324, reference * 1e-310
    elif special == "reversed":
        values = -values
    elif special == "saturated":
        values = np.clip(values, -0.2, 0.2)
    elif special == "random":
        values = draw(
            arrays.arrays(
                np.float64, ticks.size, elements=st.floats(allow_nan=True), fill=st.just(0.0)
            )
        )
    data = {CHANNEL: values, "reference": reference, "current": values}
    if special == "no reference" or draw(st.booleans()):
        data.pop("reference")
    keep = {"one sample": 1, "two samples": 2, "short": ticks.size // 3}.get(special, ticks.size)
    time = ticks - ticks[0] + draw(st.sampled_from([0.0, 7.5]))
    metadata = {"signal_start": repr(float(settle + time[0]))} if draw(st.booleans()) else {}
    recording = Recording(
        time[:keep], {name: array[:keep] for name, array in data.items()}, metadata=metadata
    )
    return recording, kit.trial(signal, duration, rate, settle)


def check(recording, trial):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scores = score(recording, trial)
        every = {item.metric: item.measure for item in scores}
    for name, measure in every.items():
        assert "failed (" not in measure.reason, f"{name}: {measure.reason}"
        if math.isnan(measure.value):
            assert measure.reason
        else:
            assert math.isfinite(measure.value)
            assert measure.reason
            if not math.isnan(measure.low):
                slack = 1e-9 * abs(measure.value) + 1e-300
                assert measure.low - slack <= measure.value <= measure.high + slack


@pytest.mark.parametrize("kind", KINDS)
def test_a_score_or_a_reason(kit, kind):
    @settings(max_examples=25)
    @given(st.data())
    def run(data):
        check(*recorded(data.draw, kit, kind))

    run()


def test_a_noisy_response_that_is_clipped_has_a_score_or_a_reason(kit):
    """It lies on its limit, and crosses a level with a slope of nothing."""
    drawn = iter([50.0, 0.05, 0.0, 1.0, 69, "saturated", False, 0.0, False])
    check(*recorded(lambda _: next(drawn), kit, "step"))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_score_or_a_reason_a_thousand_times(kit, kind):
    @settings(max_examples=130)
    @given(st.data())
    def run(data):
        check(*recorded(data.draw, kit, kind))

    run()


@pytest.mark.parametrize("name", sorted(all_metrics()))
def test_every_metric_on_every_kind_of_trial(kit, name):
    """A metric may be asked for where it makes no sense; then it says why there is no value."""
    found = metric(name)
    rng = np.random.default_rng(5)
    for signal in signals(kit).values():
        duration = 1.0 if math.isinf(signal.duration) else signal.duration
        time = np.arange(round(duration * 1000)) / 1000
        values = signal(time - 0.01) + 0.01 * rng.normal(size=time.size)
        recording = Recording(
            time,
            {CHANNEL: values, "reference": signal(time), "current": values},
            metadata={"signal_start": "0.0"},
        )
        trial = kit.trial(signal, duration)
        measure = kit.measure(name, recording, trial, found.spec.channel_for(trial.channel))
        assert "failed (" not in measure.reason
        assert measure.reason


def test_a_gap_in_the_periods_of_a_sine_is_said(kit):
    time = np.arange(1000) / 1000
    signal = signals(kit)["sine"]
    stamps = np.where(time > 0.5, time + 100.0, time)
    recording = Recording(
        stamps, {CHANNEL: signal(time), "reference": signal(time)}, metadata={"signal_start": "0.0"}
    )
    trial = kit.trial(signal, 1.0)
    check(recording, trial)
    found = kit.measure("amplitude_ratio", recording, trial)
    assert math.isnan(found.value)
    assert "gap" in found.reason


@pytest.mark.parametrize("stretch", [1e-300, 1e200])
@pytest.mark.parametrize("kind", KINDS)
def test_a_clock_beyond_reason_is_said(kit, kind, stretch):
    signal = signals(kit)[kind]
    time = np.arange(-100, 1000) / 1000
    values = signal(time - 0.02)
    recording = Recording(
        (time - time[0]) * stretch,
        {CHANNEL: values, "reference": signal(time), "current": values},
        metadata={"signal_start": "0.1"},
    )
    check(recording, kit.trial(signal, 1.0, settle=0.1))
    assert (
        "the clock is none" in kit.measure("tracking_rms", recording, kit.trial(signal, 1)).reason
    )


def test_two_samples_have_a_lag(kit):
    signal = signals(kit)["sweep"]
    recording = Recording(
        np.array([0.0, 1e-3]), {CHANNEL: np.ones(2), "reference": np.zeros(2)},
        metadata={"signal_start": "0.0"},
    )  # fmt: skip
    found = kit.measure("tracking_rms_lag_compensated", recording, kit.trial(signal, 2e-3))
    assert found.value == pytest.approx(1.0)

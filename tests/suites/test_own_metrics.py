"""A suite's own metrics: formulas that are read and never executed, scored like any metric."""

import json
import math

import numpy as np
import pytest

from eha_bench.core.errors import InputError
from eha_bench.core.formula import Formula
from eha_bench.core.recording import Recording
from eha_bench.core.score import ScoreStatus
from eha_bench.metrics import score
from eha_bench.suites.load import load_suite
from eha_bench.suites.trial_source import definition_of, trial_from_source

SUITE = """\
metrics:
{metrics}
trials:
  - id: hold
    mode: current
    duration: 4 s
    sample_rate: 500 Hz
    signal: {{kind: step, final: 1 A, at: 1 s}}
    accept: {accept}
    scores: [{scores}]
"""


@pytest.fixture
def suite(tmp_path):
    def write(metrics, accept="{}", scores=""):
        lines = "\n".join(f"  {line}" for line in metrics.splitlines())
        path = tmp_path / "suite.yaml"
        path.write_text(SUITE.format(metrics=lines, accept=accept, scores=scores))
        return load_suite(path)

    return write


def recorded(noise=0.0, **extra):
    rng = np.random.default_rng(3)
    time = np.arange(2000) / 500
    values = {
        "pressure_a": 5e6 + 1e5 * np.sin(2 * np.pi * time),
        "pressure_b": np.full(2000, 2e6),
        "current": np.where(time < 1.0, 0.0, -np.expm1(-(time - 1.0) / 0.05)),
        "reference": np.where(time < 1.0, 0.0, 1.0),
        **extra,
    }
    values["pressure_a"] = values["pressure_a"] + noise * rng.normal(size=2000)
    units = {"pressure_a": "Pa", "pressure_b": "Pa", "current": "A"}
    return Recording(time, values, units, metadata={"signal_start": "0.0"})


def by_name(found):
    return {one.metric: one for one in found}


def test_a_formula_is_scored_with_a_limit_like_any_metric(suite):
    metrics = """\
lift:
  expression: mean(pressure_a - pressure_b) / 1e6
  unit: MPa/Pa
half: {expression: lift / 2, unit: ""}
late:
  expression: max(abs(current)) * delay_time
  unit: A*s
"""
    (trial,) = suite(metrics, "{half: '<= 1.4', late: '<= 30 mA*s'}").trials
    found = by_name(score(recorded(), trial))
    assert found["half"].value == pytest.approx(1.5, rel=1e-6)
    assert found["half"].status is ScoreStatus.FAILED
    assert found["half"].channel == ""
    assert found["late"].value == pytest.approx(0.05 * math.log(2.0), rel=1e-2)
    assert (found["late"].unit, found["late"].status) == ("A*s", ScoreStatus.FAILED)
    assert found["late"].limit_in_si == "<= 0.03 A*s"
    assert "lift" not in found  # asked for by another metric only


def test_statistics_are_taken_over_the_stretch_that_is_said(suite):
    metrics = """\
early: {expression: max(current), from: 0 s, to: 0.9 s}
late: {expression: min(current), from: 2 s}
"""
    (trial,) = suite(metrics, scores="early, late").trials
    found = by_name(score(recorded(), trial))
    assert found["early"].value == 0.0
    assert found["late"].value == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("text", "status"),
    [
        ("max(pressure_a) / 5.05e6", ScoreStatus.UNDECIDED),
        ("2 - max(pressure_a) / 5.05e6", ScoreStatus.PASSED),
        ("1e6 * 5.05 / max(pressure_a) / 1e6", ScoreStatus.PASSED),
        ("mean(pressure_a) / 5.05e6", ScoreStatus.UNDECIDED),
        ("mean(pressure_b - pressure_a) / -5.05e6", ScoreStatus.UNDECIDED),
        ("max(pressure_a) / max(pressure_a + pressure_b)", ScoreStatus.NOT_SCORED),
        ("min(pressure_a) / 5.05e6", ScoreStatus.PASSED),
    ],
)
def test_a_formula_of_clipped_readings_passes_no_limit_that_they_may_break(suite, text, status):
    (trial,) = suite(f"share: {{expression: {text}}}", "{share: '<= 1.1'}").trials
    made = recorded(1e3)
    clipped = np.minimum(made["pressure_a"], 5.05e6)
    found = by_name(score(made.with_values({**made.values, "pressure_a": clipped}), trial))
    assert found["share"].status is status, found["share"].reason


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("mean(pressure_b)", 2e6),
        ("rms(pressure_a - 5e6)", 1e5 / math.sqrt(2.0)),
        ("std(pressure_a)", 1e5 / math.sqrt(2.0)),
        ("max(pressure_a) - min(pressure_a)", 2e5),
        ("sqrt(mean(pressure_b) ** 2)", 2e6),
        ("-mean(pressure_b) + 3 * max(abs(pressure_b))", 4e6),
        ("peak(pressure_b) / peak(pressure_b)", None),  # not scored: no step
    ],
)
def test_arithmetic_is_what_it_says(suite, text, value):
    (trial,) = suite(f"own: {text}", scores="own").trials
    found = by_name(score(recorded(), trial))["own"]
    if value is None:
        assert found.status is ScoreStatus.NOT_SCORED
        assert found.measure.reason.startswith("peak(pressure_b): no step")
    else:
        assert found.value == pytest.approx(value, rel=2e-4)


@pytest.mark.slow
def test_an_interval_holds_the_mean_of_noise_as_often_as_it_says(suite):
    (trial,) = suite("own: mean(pressure_a) / mean(pressure_b)", scores="own").trials
    rng, held, count = np.random.default_rng(0), 0, 300
    for _ in range(count):
        clean = recorded()
        values = {
            name: clean[name] + rng.normal(0.0, 1e5, 2000) for name in ("pressure_a", "pressure_b")
        }
        measure = by_name(score(clean.with_values(values), trial))["own"].measure
        held += measure.low <= 2.5 <= measure.high
    assert 0.91 <= held / count <= 0.985


def test_what_shares_a_channel_is_added_up_and_what_does_not_in_squares(suite):
    metrics = """\
apart: mean(pressure_a) + mean(pressure_b)
same: mean(pressure_a) + mean(pressure_a * 1)
"""
    (trial,) = suite(metrics, scores="apart, same").trials
    sensors = {f"sensor.{name}.uncertainty": "1000.0" for name in ("pressure_a", "pressure_b")}
    plain = recorded()
    recording = Recording(
        plain.time, plain.values, plain.units, metadata={**plain.metadata, **sensors}
    )
    found = by_name(score(recording, trial))
    wide = {name: found[name].measure.high - found[name].value for name in ("apart", "same")}
    assert wide["apart"] == pytest.approx(1.96e3 * math.sqrt(2.0), rel=1e-2)
    assert wide["same"] == pytest.approx(1.96e3 * 2.0, rel=1e-2)
    (part,) = found["same"].measure.budget.parts
    assert part.source == "mean(pressure_a) with mean(pressure_a * 1)"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("1 / (mean(pressure_b) - 2e6)", "is not a finite number"),
        ("mean(force)", "no force"),
        ("rise_time(pressure_b) * 2", "rise_time(pressure_b): no step"),
    ],
)
def test_what_cannot_be_had_says_why(suite, text, reason):
    (trial,) = suite(f"own: {text}", "{own: '<= 1'}").trials
    found = by_name(score(recorded(), trial))["own"]
    assert found.status is ScoreStatus.NOT_SCORED
    assert reason in found.measure.reason


def test_a_recording_carries_its_metrics(suite):
    metrics = """\
base: mean(pressure_b)
own: {expression: base * 2, unit: Pa, from: 1 s, description: twice the base}
idle: mean(pressure_a)
"""
    (trial,) = suite(metrics, "{own: '<= 5 MPa'}").trials
    assert [one.id for one in trial.own_metrics] == ["base", "own"]
    again = trial_from_source(trial.source)
    assert again.own_metrics == trial.own_metrics
    assert score(recorded(), again) == score(recorded(), trial)
    (plain,) = suite("idle: mean(pressure_a)").trials
    assert "metrics" not in json.loads(plain.source)
    assert definition_of(plain.source) == definition_of(trial.source)  # judged, not run


@pytest.mark.parametrize(
    ("metrics", "line", "key", "what"),
    [
        ("own: __import__('os').system('x')", 2, "metrics.own", "not plain arithmetic"),
        ("own: '(lambda: 1)()'", 2, "metrics.own", "not plain arithmetic"),
        ("own: mean(open('x'))", 2, "metrics.own", "unknown function 'open'"),
        ("own: 2 + 2", 2, "metrics.own", "neither a metric nor a channel"),
        ("own: risetime * 2", 2, "metrics.own", "did you mean 'rise_time'"),
        ("own: pressure_a * 2", 2, "metrics.own", "mean(pressure_a)"),
        ("own: mean(presure_a)", 2, "metrics.own", "did you mean 'pressure_a'"),
        ("own:\n  expression: mean(", 3, "metrics.own.expression", "not an arithmetic expression"),
        ("own:\n  expression: rise_time\n  unit: blue", 4, "metrics.own.unit", "blue"),
        ("own:\n  expresion: rise_time", 3, "metrics.own.expresion", "unknown key"),
        ("rise_time: mean(current)", 2, "metrics.rise_time", "already the name of"),
        ("two words: rise_time", 2, "metrics.two words", "not a name for a metric"),
        ("first: second * 2\nsecond: rise_time", 2, "metrics.first", "not defined above"),
        ("own: own * 2", 2, "metrics.own", "not defined above"),
        ("own:\n  expression: rise_time\n  from: 2 s\n  to: 1 s", 5, "metrics.own.to", "not after"),
        ("own: " + "-" * 300 + "rise_time", 2, "metrics.own", "is nested too deeply"),
        ("own: mean(" + "-" * 300 + "current)", 2, "metrics.own", "is nested too deeply"),
        ("own: " + "rise_time + " * 60 + "1", 2, "metrics.own", "characters"),
    ],
)
def test_a_mistake_is_told_with_file_line_and_key(suite, metrics, line, key, what):
    with pytest.raises(InputError) as caught:
        suite(metrics)
    error = next(one for one in caught.value.each if what in str(one))
    assert error.where.file.endswith("suite.yaml")
    assert (error.where.line, error.where.key) == (line, key)


def test_a_name_that_is_asked_for_and_not_there_is_told(suite):
    with pytest.raises(InputError, match="did you mean 'slowness'"):
        suite("slowness: rise_time", "{slownes: '<= 1'}")
    with pytest.raises(InputError, match="one number of the recording"):
        suite("own: rise_time", "{own: {max: 1, channel: pressure_a}}")


def test_a_formula_keeps_one_input_for_what_is_named_twice():
    formula = Formula.parse("rise_time + rise_time * mean(abs(current))")
    assert [str(one) for one in formula.inputs.values()] == ["rise_time", "mean(abs(current))"]
    names = list(formula.inputs)
    assert formula.value(dict(zip(names, (2.0, 3.0), strict=True))) == 8.0
    assert math.isnan(Formula.parse("1 / rise_time").value({"input_0": 0.0}))


def test_a_limit_of_a_mistaken_metric_is_no_further_mistake(suite):
    with pytest.raises(InputError) as caught:
        suite("slow: {expression: maen(pressure_a), unit: MPa}", accept='{slow: "<= 5 MPa"}')
    assert "unknown metric 'maen'" in str(caught.value)
    assert caught.value.also == ()


@pytest.mark.parametrize("limit", ["<= 5 MPaa", "<= 5 MPa", "5"])
def test_an_unknown_unit_of_a_metric_is_named_once(suite, limit):
    with pytest.raises(InputError) as caught:
        suite("slow: {expression: mean(pressure_a), unit: MPaa}", accept=f"{{slow: '{limit}'}}")
    assert "unknown unit 'MPaa'" in str(caught.value)
    assert "metrics.slow" in str(caught.value)
    assert caught.value.also == ()


def test_other_limits_are_read_beside_a_metric_of_unknown_unit(suite):
    metrics = "slow: {expression: mean(pressure_a), unit: MPaa}"
    with pytest.raises(InputError) as caught:
        suite(metrics, accept="{slow: '<= 5 MPa', overshoot: '<= 5 bar'}")
    assert len(caught.value.also) == 1
    assert "overshoot" in str(caught.value.also[0])


def test_a_name_that_is_taken_stays_what_it_was(suite):
    with pytest.raises(InputError) as caught:
        suite("overshoot: mean(pressure_a)", accept='{overshoot: "<= 5 %"}')
    assert "already the name of something else" in str(caught.value)
    assert caught.value.also == ()

"""The acceptance language: what limits mean, and what is refused."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from writing import STEP, only, refusal

from eha_bench.core.errors import InputError, UnitError
from eha_bench.core.limit import AcceptanceLimit, Bounds
from eha_bench.core.metric import METRICS, MetricSpec
from eha_bench.suites import load_suite
from eha_bench.suites.acceptance.grammar import parse_bounds

DEG = math.pi / 180


@pytest.mark.parametrize(
    ("text", "unit", "low", "high"),
    [
        ("<= 41 ms", "s", -math.inf, 0.041),
        ("≤ 41 ms", "s", -math.inf, 0.041),
        ("<=41ms", "s", -math.inf, 0.041),
        (">= 38 MPa", "Pa", 38e6, math.inf),
        ("≥ 38 MPa", "Pa", 38e6, math.inf),
        (">= 38 MPa, <= 41 MPa", "Pa", 38e6, 41e6),
        (">= 38 MPa and <= 41 MPa", "Pa", 38e6, 41e6),
        ("38 MPa .. 41 MPa", "Pa", 38e6, 41e6),
        ("38 MPa..41 MPa", "Pa", 38e6, 41e6),
        ("0 .. 41 MPa", "Pa", 0.0, 41e6),
        ("-5 .. 5", "Pa", -5.0, 5.0),
        ("0.039 s +- 6 %", "s", 0.039 * 0.94, 0.039 * 1.06),
        ("0.039 s ± 6 %", "s", 0.039 * 0.94, 0.039 * 1.06),
        ("-2 MPa +- 10 %", "Pa", -2.2e6, -1.8e6),
        ("90 deg +- 0.5 deg", "rad", 89.5 * DEG, 90.5 * DEG),
        ("+- 0.1 deg", "rad", -0.1 * DEG, 0.1 * DEG),
        ("± 0.1 deg", "rad", -0.1 * DEG, 0.1 * DEG),
        ("<= 5 %", "", -math.inf, 0.05),
        ("+- 5 %", "", -0.05, 0.05),
        ("1 +- 5 %", "", 0.95, 1.05),
        ("0.95 .. 1.05", "", 0.95, 1.05),
        ("350 K +- 5 degC", "K", 345.0, 355.0),
        ("<= 30 deg", "rad", -math.inf, 30 * DEG),
        (">= 6.7 Hz", "Hz", 6.7, math.inf),
        ("<= 0", "", -math.inf, 0.0),
    ],
)
def test_limit_means(text: str, unit: str, low: float, high: float) -> None:
    bounds = parse_bounds(text, unit)
    assert bounds.low == pytest.approx(low, rel=1e-12, abs=0)
    assert bounds.high == pytest.approx(high, rel=1e-12, abs=0)


def test_strict_comparison_leaves_the_bound_out() -> None:
    assert not parse_bounds("< 1", "").holds(1.0)
    assert parse_bounds("< 1", "").holds(0.9999999)
    assert not parse_bounds("> 1", "").holds(1.0)
    assert parse_bounds("<= 1", "").holds(1.0)


@pytest.mark.parametrize(
    ("text", "unit", "what"),
    [
        ("41 ms", "s", "is not a limit"),
        ("", "s", "is not a limit"),
        ("=< 41 ms", "s", "is not a limit"),
        ("<= ", "s", "not a limit"),
        ("<= 41 MPa", "s", "wrong dimension"),
        ("<= 5 deg", "", "wrong dimension"),
        ("<= fast", "s", "not a number"),
        ("<= nan", "s", "not a number"),
        (">= 41 ms, <= 38 ms", "s", "accepts no value"),
        ("41 .. 38", "s", "accepts no value"),
        ("38 .. 41 MPa", "Pa", "has no unit"),
        ("1 .. 2 .. 3", "s", "not a range"),
        ("1 s ..", "s", "not a range"),
        ("+-", "s", "not a tolerance"),
        ("1 s +- -5 %", "s", "negative"),
        ("1 s +- 2 MPa", "s", "wrong dimension"),
        ("+- 5 %", "s", "wrong dimension"),
        ("<= 1 s or >= 2 s", "s", "is not a limit"),
    ],
)
def test_what_is_no_limit_is_refused(text: str, unit: str, what: str) -> None:
    with pytest.raises(UnitError, match=what):
        parse_bounds(text, unit)


finite = st.floats(-1e9, 1e9)


@given(finite, finite)
def test_range_and_comparisons_agree(first: float, second: float) -> None:
    low, high = sorted((first, second))
    expected = Bounds(low, high)
    assert parse_bounds(f"{low!r} .. {high!r}", "Pa") == expected
    assert parse_bounds(f">= {low!r} Pa, <= {high!r} Pa", "Pa") == expected
    assert expected.holds(low)
    assert expected.holds(high)
    assert not expected.holds(math.nan)


@given(st.text(max_size=30))
def test_any_text_is_a_limit_or_a_unit_error(text: str) -> None:
    try:
        bounds = parse_bounds(text, "Pa")
    except UnitError:
        return
    assert bounds.low <= bounds.high


def limits(folder: Path, block: str) -> dict[tuple[str, str], AcceptanceLimit]:
    trial = only(folder, f"{STEP}    {block}\n")
    return {(limit.metric, limit.channel): limit for limit in trial.limits}


def test_accept_in_all_its_forms(tmp_path: Path) -> None:
    found = limits(
        tmp_path,
        """accept:
      response_time: <= 41 ms
      peak: {min: 38 MPa, max: 41 MPa}
      overshoot: {limit: <= 30 %, warn: <= 25 %}
      steady_state_error: [+- 1 MPa, {channel: current, max: 1 A, min: -1}]
      holding_current: 11 A +- 6 %
      loop_overruns: <= 0""",
    )
    difference = "pressure_difference"
    assert found["response_time", difference].bounds == Bounds(high=0.041)
    assert found["response_time", difference].text == "<= 41 ms"
    assert found["response_time", difference].unit == "s"
    assert found["peak", difference].bounds == Bounds(38e6, 41e6)
    assert found["peak", difference].text == ">= 38 MPa, <= 41 MPa"
    assert found["peak", difference].unit == "Pa"
    assert found["overshoot", difference].bounds == Bounds(high=0.3)
    assert found["overshoot", difference].warn == Bounds(high=0.25)
    assert found["steady_state_error", difference].bounds == Bounds(-1e6, 1e6)
    assert found["steady_state_error", "current"].bounds == Bounds(-1.0, 1.0)
    assert found["steady_state_error", "current"].unit == "A"
    assert found["holding_current", "current"].bounds.high == pytest.approx(11.66)
    assert found["loop_overruns", ""].bounds == Bounds(high=0.0)
    assert len(found) == 7


def test_null_limit_is_a_score(tmp_path: Path) -> None:
    trial = only(
        tmp_path,
        STEP
        + """    accept: {peak: null, overshoot: <= 5 %}
    scores: [rise_time, overshoot, peak, {metric: peak, channel: pressure_a}, rise_time]
""",
    )
    assert [limit.metric for limit in trial.limits] == ["overshoot"]
    assert trial.scores == (
        ("peak", "pressure_difference"),
        ("rise_time", "pressure_difference"),
        ("peak", "pressure_a"),
    )


def test_channel_of_ones_own(tmp_path: Path) -> None:
    trial = only(
        tmp_path,
        STEP
        + """    accept:
      peak: {channel: motor_temperature, unit: K, max: 80 degC}
    safety:
      motor_temperature: {max: 100 degC, unit: K}
      pressure_a: <= 45 MPa
      motor_speed: -3000 rpm .. 3000 rpm
""",
    )
    assert trial.limits[0].bounds.high == pytest.approx(353.15)
    assert [(limit.channel, limit.bounds.high) for limit in trial.safety] == [
        ("motor_temperature", pytest.approx(373.15)),
        ("pressure_a", 45e6),
        ("motor_speed", pytest.approx(314.159, rel=1e-5)),
    ]


@pytest.mark.parametrize(
    ("block", "key", "what"),
    [
        ("accept: {respose_time: <= 41 ms}", "accept.respose_time", "did you mean 'response_time'"),
        ("accept: {response_time: 41 ms}", "accept.response_time", "is not a limit"),
        ("accept: {response_time: 41}", "accept.response_time", "is not a limit"),
        ("accept: {response_time: <= 41 MPa}", "accept.response_time", "wrong dimension"),
        ("accept: {peak: <= 41 deg}", "accept.peak", "wrong dimension"),
        ("accept: {peak: {min: 41 deg}}", "accept.peak.min", "wrong dimension"),
        ("accept: {peak: {mni: 41 MPa}}", "accept.peak.mni", "did you mean 'min'"),
        ("accept: {peak: {min: .nan}}", "accept.peak.min", "nan"),
        ("accept: {peak: {min: 2, max: 1}}", "accept.peak", "accepts no value"),
        ("accept: {peak: {limit: <= 1, max: 1}}", "accept.peak", "keep one"),
        ("accept: {peak: {warn: <= 1}}", "accept.peak", "a warning needs a limit"),
        ("accept: {peak: {max: 1, warn: '>= 2'}}", "accept.peak.warn", "without a warning"),
        (
            "accept: {peak: {max: 1, channel: presure_a}}",
            "accept.peak.channel",
            "did you mean 'pressure_a'",
        ),
        ("accept: {peak: {max: 1, channel: pressure_a, unit: bar}}", "accept.peak.channel", "Pa"),
        ("accept: {peak: [<= 1, <= 2]}", "accept.peak.1", "limited twice"),
        ("accept: {peak: []}", "accept.peak", "the list of limits of peak is empty"),
        ("accept: {peak: [<= 1, 5]}", "accept.peak.1", "is not a limit"),
        ("accept: [peak]", "accept", "expected limits"),
        ("scores: [rise_tme]", "scores.0", "did you mean 'rise_time'"),
        ("scores: rise_time", "scores", "list of metrics"),
        ("scores: [3]", "scores.0", "expected a metric"),
        ("scores: [{metric: peak}]", "scores.0.channel", "missing"),
        ("scores: [{metric: peek, channel: current}]", "scores.0.metric", "did you mean 'peak'"),
        ("safety: {presure_a: <= 45 MPa}", "safety.presure_a", "did you mean 'pressure_a'"),
        ("safety: {pressure_a: <= 45 A}", "safety.pressure_a", "wrong dimension"),
        ("safety: {pressure_a: {}}", "safety.pressure_a", "empty"),
        ("safety: {pressure_a: null}", "safety.pressure_a", "not a limit"),
        ("safety: [pressure_a]", "safety", "expected limits"),
    ],
)
def test_refusal_names_the_key(tmp_path: Path, block: str, key: str, what: str) -> None:
    error = refusal(tmp_path, f"{STEP}    {block}\n")
    assert error.where.key == f"trials.step.{key}"
    assert error.where.line == 7
    assert what in str(error)


@pytest.mark.parametrize(
    ("stated", "bounds", "confident", "relative"),
    [
        ("<= 60 ms", "<= 60 ms", False, False),
        ("<= 60 ms with 95 % confidence", "<= 60 ms", True, False),
        ("<= 60 ms, median of the repeats", "<= 60 ms", False, False),
        ("0 s .. 1 s with 95 % confidence, worst of the repeats", "0 s .. 1 s", True, False),
        ("<= 105 % of baseline (0.0413 s)", "<= 105 %", False, True),
        (">= 95 %, <= 105 % of baseline (3e+07 Pa) with 95 % confidence, median of the repeats",
         ">= 95 %, <= 105 %", True, True),
    ],
)  # fmt: skip
def test_a_limit_is_read_as_a_result_states_it(stated, bounds, confident, relative):
    from eha_bench.suites.acceptance.grammar import split_stated

    words = split_stated(stated)
    assert (words.bounds, words.confident, words.relative) == (bounds, confident, relative)


@pytest.fixture
def integral(monkeypatch: pytest.MonkeyPatch) -> None:
    """A metric whose unit is that of its channel, times seconds."""
    spec = MetricSpec("iae", "integral of |error|", "{channel}*s")
    monkeypatch.setitem(METRICS, "iae", spec)


@pytest.mark.usefixtures("integral")
@pytest.mark.parametrize(
    ("mode", "final", "limit", "unit", "high"),
    [
        ("pressure", "15 MPa", "<= 0.3 MPa*s", "Pa*s", 3e5),
        ("joint_angle", "15 deg", "<= 3 deg*s", "rad*s", 3 * DEG),
        ("my_own", "15 mm", "<= 3 mm*s", "m*s", 3e-3),
        ("pressure", "15 MPa", "{max: 2 A*s, channel: current}", "A*s", 2.0),
        ("pressure", "15 MPa", "{max: 2 K*s, channel: core_heat, unit: K}", "K*s", 2.0),
    ],
)
def test_a_limit_on_a_metric_that_has_its_channels_unit_in_it(
    tmp_path: Path, mode: str, final: str, limit: str, unit: str, high: float
) -> None:
    text = STEP.replace("mode: pressure", f"mode: {mode}").replace("15 MPa", final)
    trial = only(tmp_path, f"{text}    accept: {{iae: {limit}}}\n")
    (found,) = trial.limits
    assert found.unit == unit
    assert found.bounds.high == pytest.approx(high)


@pytest.mark.usefixtures("integral")
def test_what_such_a_limit_cannot_be(tmp_path: Path) -> None:
    wrong = refusal(tmp_path, f"{STEP}    accept: {{iae: <= 3 deg*s}}\n")
    assert "expected a unit of the dimension of Pa*s" in str(wrong)
    unknown = refusal(tmp_path, f"{STEP}    accept: {{iae: {{max: 2 K*s, channel: core_heat}}}}\n")
    assert "give its 'unit'" in str(unknown)


def _limited(folder: Path, entry: str) -> Path:
    path = folder / "s.yaml"
    path.write_text(
        "name: s\ntrials:\n  - id: a\n    mode: pressure\n    duration: 0.1 s\n"
        "    signal: {kind: step, final: 1 MPa, at: 10 ms}\n"
        f"    accept:\n      {entry}\n"
    )
    return path


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("rise_time: <= -5 ms", "no run can keep it: rise_time is never below 0"),
        ("tracking_rms: -2 MPa .. -1 MPa", "tracking_rms is never below 0"),
        (
            "rise_time: {limit: <= 41 ms, warn: <= 50 ms}",
            "nothing is ever warned: it is",
        ),
        ("rise_time: {limit: <= 41 ms, warn: <= 41 ms}", "nothing is ever warned"),
        ("peak: {limit: 1 MPa .. 2 MPa, warn: '>= 0.5 MPa'}", "nothing is ever warned"),
    ],
)
def test_limits_that_mean_nothing(tmp_path: Path, entry: str, message: str) -> None:
    path = _limited(tmp_path, entry)
    with pytest.raises(InputError, match=message) as caught:
        load_suite(path)
    assert caught.value.where.line == 8
    assert caught.value.hint


@pytest.mark.parametrize(
    "entry",
    [
        "steady_state_error: <= -1 MPa",
        "rise_time: <= 0 ms",
        "peak: {limit: 1 MPa .. 2 MPa, warn: <= 1.9 MPa}",
    ],
)
def test_limits_that_some_run_keeps(tmp_path: Path, entry: str) -> None:
    path = _limited(tmp_path, entry)
    assert len(load_suite(path).trials[0].limits) == 1

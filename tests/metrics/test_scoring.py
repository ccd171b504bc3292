"""Which scores a trial gets, and what limits say of them."""

import math
import re
import time as clock
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest

from eha_bench.core import plugins
from eha_bench.core.errors import InputError, PluginError
from eha_bench.core.limit import AcceptanceLimit, Bounds, Repeats
from eha_bench.core.metric import METRICS, MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure, ScoreStatus
from eha_bench.metrics import accepted, all_metrics, judge, score, scoring
from eha_bench.metrics.metric import Metric
from eha_bench.metrics.scoring import score_limits
from eha_bench.suites import load_suite


def limit(metric="rise_time", channel="pressure_difference", **options):
    given = {"bounds": Bounds(high=1.0), "text": "<= 1", "unit": "s", **options}
    return AcceptanceLimit(metric, channel, **given)


def step(kit, **options):
    return kit.step(([1.0], [0.02, 1.0]), hold=0.5, initial=0.0, size=5e6, **options)


def test_every_public_metric_is_there():
    assert set(METRICS) <= set(all_metrics())


def test_metrics_carry_the_public_specification():
    for name, found in all_metrics().items():
        assert found.spec.id == name
        assert name not in METRICS or found.spec is METRICS[name]


def test_limits_come_first_then_scores_then_defaults_and_nothing_twice(kit):
    recording, trial = step(kit)
    trial = replace(
        trial,
        limits=(limit("overshoot"), limit("overshoot", text="<= 2", bounds=Bounds(high=2.0))),
        scores=(("tracking_p95", "pressure_difference"), ("overshoot", "pressure_difference")),
    )
    found = score(recording, trial)
    names = [item.metric for item in found]
    assert names[:3] == ["overshoot", "overshoot", "tracking_p95"]
    assert names.count("overshoot") == 2
    assert "rise_time" in names
    assert "amplitude_ratio" not in names
    assert [item.limit for item in found[:3]] == ["<= 1", "<= 2", ""]


def test_a_sine_gets_sine_metrics_only(kit):
    names = {item.metric for item in score(*kit.sine(5.0))}
    assert {"amplitude_ratio", "phase_lag", "distortion", "tracking_rms"} <= names
    assert "rise_time" not in names
    assert "bandwidth_3db" not in names


def test_units_are_those_of_the_channel(kit):
    units = {item.metric: item.unit for item in score(*step(kit))}
    assert units["peak"] == "Pa"
    assert units["rise_time"] == "s"
    assert units["overshoot"] == ""
    assert units["holding_current"] == "A"


@pytest.mark.parametrize(
    ("unit", "said"),
    [
        ("Pa", "recorded in Pa, and the limit is in m"),
        ("", "recorded without a unit, and the limit is in m"),
        ("m", ""),
    ],
)
def test_a_limit_is_not_held_against_values_of_another_unit(unit, said) -> None:
    written = {
        "id": "a", "mode": "sledge", "duration": "1 s",
        "signal": {"kind": "step", "final": "20 mm"}, "accept": {"tracking_max": "<= 30 mm"},
    }  # fmt: skip
    trial = load_suite({"name": "s", "trials": [written]}).trials[0]
    time = np.arange(1000) / 1000
    recording = Recording(
        time,
        {"sledge": np.full(time.size, 0.02), "reference": np.full(time.size, 0.02)},
        units={"sledge": unit, "reference": "m"},
        metadata={"signal_start": "0.0"},
    )
    found = score_limits(recording, trial)[0]
    assert found.status is (ScoreStatus.NOT_SCORED if said else ScoreStatus.PASSED)
    assert found.reason == said if said else math.isfinite(found.value)


def test_a_missing_channel_is_said_and_its_limit_rejects(kit):
    recording, trial = step(kit)
    trial = replace(trial, limits=(limit("rise_time", "motor_speed"),))
    found = score(recording, trial)
    assert found[0].status is ScoreStatus.NOT_SCORED
    assert found[0].measure.reason == "no motor_speed"
    assert not accepted(found)


def test_scores_without_limits_reject_nothing(kit):
    found = score(*step(kit))
    assert any(item.status is ScoreStatus.NOT_SCORED for item in found)  # no current
    assert accepted(found)


@pytest.mark.parametrize(
    ("value", "status"),
    [
        (0.5, ScoreStatus.PASSED),
        (0.9, ScoreStatus.WARNED),
        (1.0, ScoreStatus.WARNED),
        (1.1, ScoreStatus.FAILED),
        (math.nan, ScoreStatus.NOT_SCORED),
    ],
)
def test_verdicts(value, status):
    assert judge(Measure(value), limit(warn=Bounds(high=0.8))) is status


def test_a_value_without_a_limit_has_nothing_to_fail():
    assert judge(Measure(3.0), None) is ScoreStatus.PASSED
    assert judge(Measure.none("why"), None) is ScoreStatus.NOT_SCORED


# --- plug-ins ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Answer(Metric):
    """A metric from another package."""

    spec = MetricSpec("answer", "always the same", "")

    def applies(self, trial):
        return True

    def measure(self, recording, trial, channel):
        return Measure(42.0, 42.0, 42.0, "by definition")


class Broken(Answer):
    spec = MetricSpec("broken", "fails", "")

    def measure(self, recording, trial, channel):
        raise ZeroDivisionError("oh")


class Asking(Answer):
    spec = MetricSpec("asking", "cannot say whether it applies", "")

    def applies(self, trial):
        return trial.colour == "blue"


class Unmade(Answer):
    spec = MetricSpec("unmade", "needs an argument", "")

    def __init__(self, colour):
        self.colour = colour


class Unspecified(Answer):
    spec = "unspecified"


class Talking(Answer):
    """Returns what it is told to."""

    spec = MetricSpec("talking", "says what it is told to", "")
    says: ClassVar[Any] = "hello"

    def measure(self, recording, trial, channel):
        return self.says


@pytest.fixture
def installed(monkeypatch):
    """Pretend that a package has registered metrics."""
    extra = {
        "answer": Answer, "broken": Broken(), "nonsense": 3, "misnamed": Answer, "unmade": Unmade,
        "asking": Asking, "talking": Talking, "unspecified": Unspecified,
    }  # fmt: skip
    more = ("answer", "broken", "unmade", "asking", "talking", "away")
    names, load = plugins.names, plugins.load
    monkeypatch.setattr(plugins, "names", lambda group: (*names(group), *more))
    monkeypatch.setattr(
        plugins, "load", lambda group, name, **at: extra.get(name) or load(group, name, **at)
    )
    scoring.metric.cache_clear()
    scoring.all_metrics.cache_clear()
    yield
    scoring.metric.cache_clear()
    scoring.all_metrics.cache_clear()


def test_a_metric_of_another_package_is_scored_like_our_own(kit, installed):
    found = {item.metric: item for item in score(*step(kit))}
    assert found["answer"].value == 42.0


def test_a_unit_with_the_channels_in_it_is_that_of_the_recording(kit, monkeypatch):
    recording, trial = step(kit)
    monkeypatch.setattr(Answer, "spec", MetricSpec("answer", "forty-two", "{channel}*s"))
    assert scoring._unit(Answer(), recording, trial, kit.channel) == "Pa*s"
    assert scoring._unit(Answer(), recording, trial, "joint_angle") == "rad*s"


def test_a_broken_plug_in_costs_its_own_score_only(kit, installed):
    found = {item.metric: item for item in score(*step(kit))}
    assert found["broken"].status is ScoreStatus.NOT_SCORED
    reason = found["broken"].measure.reason
    assert re.search(r"ZeroDivisionError: oh, at .*test_scoring.py:\d+ in measure", reason)
    assert found["rise_time"].status is ScoreStatus.PASSED
    assert found["asking"].status is ScoreStatus.NOT_SCORED
    assert re.search(r"AttributeError.*:\d+ in applies", found["asking"].measure.reason)


@pytest.mark.parametrize(
    ("says", "reason"),
    [
        ("hello", "metric 'talking' returned 'hello', which is no Measure, at "),
        (None, "metric 'talking' returned None, which is no Measure, at "),
        (Measure("high"), "returned 'high' as its value, which is no number, at "),
        (Measure(1.0, 0.5, 1j), "returned a complex as its high, which is no number, at "),
        (Measure(1.0, reason=3), "returned 3 as its reason, which is no text, at "),
        (Measure(1.0, budget=0.1), "returned 0.1 as its budget, which is no Budget, at "),
    ],
)
def test_what_is_no_measure_costs_its_own_score_only(kit, installed, monkeypatch, says, reason):
    monkeypatch.setattr(Talking, "says", says)
    found = {item.metric: item for item in score(*step(kit))}
    assert found["talking"].status is ScoreStatus.NOT_SCORED
    assert re.search(
        re.escape(reason) + r".*test_scoring.py:\d+ in measure", found["talking"].reason
    )
    assert found["answer"].value == 42.0


def test_numbers_of_a_plug_in_become_pythons_own(kit, installed, monkeypatch):
    monkeypatch.setattr(Talking, "says", Measure(np.float32(0.5), np.array(0.25)))
    found = {item.metric: item for item in score(*step(kit))}["talking"].measure
    assert (found.value, found.low) == (0.5, 0.25)
    assert {type(found.value), type(found.low)} == {float}


def test_a_metric_that_cannot_be_loaded_stops_only_who_asks_for_it(kit, installed, caplog):
    recording, trial = step(kit)
    scoring.load_metrics([trial])
    assert "left out: unknown metric 'away'" in caplog.text
    assert "left out: metric 'unmade' cannot be made (TypeError" in caplog.text
    assert {"unmade", "away"}.isdisjoint(item.metric for item in score(recording, trial))
    asking = replace(trial, scores=(("unmade", ""),))
    with pytest.raises(PluginError, match=r"trial '\w+' cannot be scored: metric 'unmade'"):
        scoring.load_metrics([asking])


@pytest.mark.parametrize("name", ["nonsense", "misnamed", "not_there", "unspecified"])
def test_what_is_no_metric_is_said(installed, name):
    with pytest.raises(PluginError, match=name):
        scoring.metric(name)


# --- speed ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_ten_minutes_of_twelve_channels_are_scored_in_seconds(kit):
    count = 600_000
    time = np.arange(count) / 1000.0
    rng = np.random.default_rng(0)
    trial = replace(
        kit.trial(kit.Steps((1.0,), (0.0, 1e6), 600.0), 600.0),
        scores=tuple(("rise_time", f"channel_{k}") for k in range(10)),
    )
    step = np.where(time >= 1.0, 1 - np.exp(-np.maximum(time - 1.0, 0) / 0.05), 0.0) * 1e6
    values = {f"channel_{k}": step + 1e3 * rng.normal(size=count) for k in range(10)}
    values |= {"pressure_difference": step, "reference": trial.signal(time)}
    recording = Recording(time, values, metadata={"signal_start": "0"})
    start = clock.process_time()
    found = score(recording, trial)
    spent = clock.process_time() - start
    assert sum(not math.isnan(item.value) for item in found) > 15
    assert spent < 8.0


def test_nothing_is_remembered_of_a_recording_that_is_gone(kit):
    from eha_bench.metrics import memo

    recording, trial = step(kit)
    score(recording, trial)
    before = len(memo._stores)
    del recording
    assert len(memo._stores) == before - 1


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"bounds": Bounds(high=0.041)}, "<= 0.041 s"),
        ({"bounds": Bounds(low=0.0366 * 0.94, high=0.3)}, ">= 0.034404 s, <= 0.3 s"),
        ({"bounds": Bounds(low=0.708), "unit": ""}, ">= 0.708"),
        ({"confident": True}, "<= 1 s with 95 % confidence"),
        ({"repeats": Repeats.MEDIAN}, "<= 1 s, median of the repeats"),
    ],
)
def test_a_limit_is_told_in_si(options, text):
    assert limit(**options).in_si == text


def test_who_gives_a_name_for_a_trial_is_told_where_trials_are(kit):
    recording, trial = step(kit)
    with pytest.raises(InputError, match=r"'pressure_step' is not a trial; .*load_suite"):
        score(recording, "pressure_step")
    with pytest.raises(InputError, match=r"'run.mcap' is not a recording; .*eha_bench.read"):
        score("run.mcap", trial)

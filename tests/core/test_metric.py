"""Metrics are known by id, unit and channel."""

import pytest

from eha_bench.core.errors import InputError, PluginError
from eha_bench.core.metric import METRICS, MetricSpec, metric_spec

# result.json's public ids (contract, section 8)
PUBLIC = [
    "rise_time",
    "response_time",
    "settling_time",
    "overshoot",
    "undershoot",
    "peak",
    "peak_time",
    "delay_time",
    "steady_state_error",
    "holding_current",
    "tracking_rms",
    "tracking_max",
    "tracking_nrmse",
    "amplitude_ratio",
    "phase_lag",
    "time_lag",
    "distortion",
    "bandwidth_3db",
    "bandwidth_90deg",
    "loop_overruns",
]


@pytest.mark.parametrize("name", PUBLIC)
def test_public_id_is_known(name: str) -> None:
    spec = metric_spec(name)
    assert spec.id == name
    assert spec.description


@pytest.mark.parametrize(
    ("name", "channel", "unit"),
    [
        ("peak", "pressure_a", "Pa"),
        ("peak", "joint_angle", "rad"),
        ("response_time", "pressure_a", "s"),
        ("overshoot", "pressure_a", ""),
        ("phase_lag", "pressure_a", "rad"),
        ("holding_current", "current", "A"),
        ("bandwidth_3db", "joint_angle", "Hz"),
    ],
)
def test_unit_follows_metric_or_channel(name: str, channel: str, unit: str) -> None:
    assert METRICS[name].unit_on(channel) == unit


@pytest.mark.parametrize(
    ("channel", "unit"), [("pressure_a", "Pa*s"), ("joint_angle", "rad*s"), ("my_own", "s")]
)
def test_a_channels_unit_may_be_a_part_of_a_metrics(channel: str, unit: str) -> None:
    spec = MetricSpec("iae", "integral of |error|", "{channel}*s")
    assert spec.unit_on(channel) == unit
    assert spec.by_channel
    assert spec.unit_for("m") == "m*s"


def test_a_unit_that_depends_on_something_else_is_refused() -> None:
    with pytest.raises(PluginError, match=r"'\{chanel\}'.*did you mean 'channel'"):
        MetricSpec("iae", "integral of |error|", "{chanel}*s")


def test_default_channel() -> None:
    assert METRICS["peak"].channel_for("joint_angle") == "joint_angle"
    assert METRICS["holding_current"].channel_for("pressure_difference") == "current"
    assert METRICS["loop_overruns"].channel_for("pressure_difference") == ""


def test_unknown_metric_suggests_a_near_one() -> None:
    with pytest.raises(InputError, match="unknown metric 'respons_time'; did you mean"):
        metric_spec("respons_time")

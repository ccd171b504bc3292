"""What a metric is called and in which unit it comes out; how it is computed stands elsewhere.

Suites check their acceptance limits against these specifications, and metrics carry them, so that
neither has to know the other. The ids of the table are public (result.json).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from eha_bench.core import plugins
from eha_bench.core.channels import unit_of
from eha_bench.core.errors import InputError, Place, PluginError
from eha_bench.core.near_miss import suggest
from eha_bench.core.place_unit import unit_at_place
from eha_bench.core.signal import FromRecording, Signal

STATISTICS: Final = ("mean", "min", "max", "rms", "std")
"""Statistics of a channel over the scored time that a suite's own metric may use."""


class Better(StrEnum):
    """Which of two values of a metric is the better one."""

    LOWER = "lower"
    HIGHER = "higher"
    NEARER_ZERO = "nearer to 0"
    NEARER_ONE = "nearer to 1"
    UNKNOWN = ""


class Needs(StrEnum):
    """What a trial's signal must have for a metric to have a value at all."""

    STEP = "a step"
    SINE = "a sine"
    BAND = "a sweep, a multisine or a stepped sine"

    def met_by(self, signal: Signal) -> bool:
        """Whether a signal has it; one that is known from a recording only may have anything."""
        if isinstance(signal, FromRecording):
            return True
        if self is Needs.STEP:
            return bool(signal.edges)
        if self is Needs.SINE:
            return bool(signal.tones)
        return bool(signal.lines or signal.sweeps) or len(signal.tones) > 1


@dataclass(frozen=True)
class MetricSpec:
    """Name, unit and place of a metric.

    Attributes:
        id: public name, e.g. `response_time`.
        description: what it is and by which convention, one sentence.
        unit: SI unit of its value ("" for a fraction or a count); None for the unit of the channel
            that it is scored on (a peak in Pa, a tracking error in rad); with `{channel}` where
            that is a part of it (`{channel}*s`: an integral over time).
        channel: the channel it is scored on unless the suite says otherwise: None for the channel
            that should follow the reference, "" for the recording as a whole.
        better: which of two values is the better one; UNKNOWN where that depends on the purpose.
        needs: what the signal must have; None where any will do.
        matters: the smallest difference between two results that matters where the suite does not
            say, as a suite writes it; "" for the one by unit (`matters_by_default`).
        least: the smallest value that it can have; a limit below it could never be kept.
    """

    id: str
    description: str
    unit: str | None = ""
    channel: str | None = None
    better: Better = Better.UNKNOWN
    needs: Needs | None = None
    matters: str = ""
    least: float = -math.inf

    def __post_init__(self) -> None:
        """Refuse a unit that is none.

        Raises:
            PluginError: its braces hold another word than `channel`, or it is no product of units.
        """
        self.unit_for("")

    @property
    def by_channel(self) -> bool:
        """Whether its unit depends on the channel that it is scored on."""
        return self.unit is None or "{" in self.unit

    def unit_for(self, unit: str) -> str:
        """Return the SI unit of the metric's value on a channel of that unit."""
        return unit if self.unit is None else unit_at_place(self.unit, {"channel": unit})

    def unit_on(self, channel: str) -> str:
        """Return the SI unit of the metric's value when scored on `channel`."""
        return self.unit_for(unit_of(channel))

    def channel_for(self, controlled: str) -> str:
        """Return the channel it is scored on by default in a trial that controls `controlled`."""
        return controlled if self.channel is None else self.channel


_ALL: Final = (
    MetricSpec(
        "rise_time",
        "10 to 90 % of the step, interpolated crossings",
        "s",
        better=Better.LOWER,
        needs=Needs.STEP,
        least=0.0,
    ),
    MetricSpec(
        "response_time",
        "from the command's edge to 95 % of the step",
        "s",
        better=Better.LOWER,
        needs=Needs.STEP,
    ),
    MetricSpec(
        "settling_time",
        "from the edge until within 2 % of the step for good",
        "s",
        better=Better.LOWER,
        needs=Needs.STEP,
        least=0.0,
    ),
    MetricSpec(
        "overshoot",
        "beyond the final level, as a fraction of the step",
        better=Better.LOWER,
        needs=Needs.STEP,
        matters="0.01",
        least=0.0,
    ),
    MetricSpec(
        "undershoot",
        "before the initial level, as a fraction of the step",
        better=Better.LOWER,
        needs=Needs.STEP,
        matters="0.01",
        least=0.0,
    ),
    MetricSpec(
        "peak",
        "the extreme value after the edge, in the direction of the step",
        None,
        needs=Needs.STEP,
    ),
    MetricSpec(
        "peak_time",
        "from the edge to the peak",
        "s",
        better=Better.LOWER,
        needs=Needs.STEP,
        least=0.0,
    ),
    MetricSpec(
        "delay_time",
        "from the command's edge to 50 % of the step",
        "s",
        better=Better.LOWER,
        needs=Needs.STEP,
    ),
    MetricSpec(
        "steady_state_error",
        "reference minus final level",
        None,
        better=Better.NEARER_ZERO,
        needs=Needs.STEP,
    ),
    MetricSpec(
        "holding_current",
        "mean current while the final level is held",
        "A",
        "current",
        needs=Needs.STEP,
    ),
    MetricSpec(
        "tracking_rms",
        "root mean square of reference minus measurement",
        None,
        better=Better.LOWER,
        least=0.0,
    ),
    MetricSpec(
        "tracking_max",
        "largest magnitude of reference minus measurement",
        None,
        better=Better.LOWER,
        least=0.0,
    ),
    MetricSpec(
        "tracking_nrmse",
        "tracking_rms over the span of the reference",
        better=Better.LOWER,
        matters="2 % of baseline",
        least=0.0,
    ),
    MetricSpec(
        "amplitude_ratio",
        "fundamental of the measurement over that of the reference",
        better=Better.NEARER_ONE,
        needs=Needs.SINE,
        least=0.0,
    ),
    MetricSpec(
        "phase_lag",
        "phase of the reference minus that of the measurement",
        "rad",
        better=Better.NEARER_ZERO,
        needs=Needs.SINE,
    ),
    MetricSpec(
        "time_lag",
        "phase lag as time at the frequency of the fundamental",
        "s",
        better=Better.NEARER_ZERO,
        needs=Needs.SINE,
    ),
    MetricSpec(
        "distortion",
        "total harmonic distortion of the measurement",
        better=Better.LOWER,
        needs=Needs.SINE,
        matters="0.005",
        least=0.0,
    ),
    MetricSpec(
        "bandwidth_3db",
        "where the gain has fallen by 3 dB",
        "Hz",
        better=Better.HIGHER,
        needs=Needs.BAND,
        least=0.0,
    ),
    MetricSpec(
        "bandwidth_90deg",
        "where the phase lag reaches 90 degrees",
        "Hz",
        better=Better.HIGHER,
        needs=Needs.BAND,
        least=0.0,
    ),
    MetricSpec(
        "loop_overruns",
        "ticks at which the control loop was late",
        "",
        "",
        better=Better.LOWER,
        matters="1",
        least=0.0,
    ),
)

METRICS: Final[dict[str, MetricSpec]] = {spec.id: spec for spec in _ALL}
"""Specifications of the built-in metrics by id."""


_MATTERS_NEAR_ZERO: Final = {
    "Pa": "0.05 MPa", "rad": "0.2 deg", "rad/s": "1 rpm", "m": "0.05 mm", "m/s": "0.5 mm/s",
    "N": "10 N", "N*m": "0.1 N*m", "A": "0.05 A", "K": "0.5 K", "s": "0.5 ms",
}  # fmt: skip
_MATTERS: Final = "2 %"
_MATTERS_OF_FRACTION: Final = "0.02"


def matters_by_default(metric: str, unit: str) -> str:
    """Return the smallest difference that matters where no suite says, as a suite writes it.

    The metric's own; else 2 % of the baseline, 0.02 of what has no unit, and of an error that
    should be 0 (of which a share means nothing) a quantity by its unit. It is fixed: it does not
    grow with the scatter.

    Args:
        metric: id; also of one that is not installed.
        unit: SI unit of the values.
    """
    try:
        spec = metric_spec(metric)
    except (InputError, PluginError):
        return _MATTERS if unit else _MATTERS_OF_FRACTION
    if spec.matters:
        return spec.matters
    if spec.better is Better.NEARER_ZERO:
        return _MATTERS_NEAR_ZERO.get(unit, _MATTERS if unit else _MATTERS_OF_FRACTION)
    return _MATTERS if unit else _MATTERS_OF_FRACTION


def metric_spec(name: str, *, where: Place | None = None) -> MetricSpec:
    """Return the specification of a metric: built in, or the `spec` of an installed plug-in.

    Raises:
        InputError: no metric has this id.
        PluginError: the plug-in cannot be loaded, or has no `spec`.
    """
    if name in METRICS:
        return METRICS[name]
    known = (*METRICS, *(other for other in plugins.names("metrics") if other not in METRICS))
    if name not in known:
        raise InputError(f"unknown metric '{name}'", where=where, hint=suggest(name, known))
    plugin: Any = plugins.load("metrics", name, where=where)
    spec = getattr(plugin, "spec", None)
    if not isinstance(spec, MetricSpec):
        raise PluginError(
            f"metric '{name}' does not say what it is",
            where=where,
            hint="its class needs an attribute 'spec' of type MetricSpec",
        )
    return spec

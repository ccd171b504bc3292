"""PID control of any channel by any command.

    u = k_f r + k_p (b r - y) + I - D,    dI/dt = k_i (r - y) + (u_sat - u) / T_t

D is k_d dy/dt behind a first-order low-pass of `filter_time`: the derivative is of the measurement,
so that a step of the reference does not kick, and filtered, because noise is multiplied by it. The
integral does not wind up: while the command is at its limit it is led back within the tracking time
T_t (back-calculation), sqrt(T_i T_d) by default, T_i without a derivative. Integral and
derivative are discretised by forward and backward differences.

Source: Astrom, Hagglund, Advanced PID Control, ISA 2006, sections 3.3 to 3.5 (set-point weight,
filtered derivative, windup) and 13.3 (discretisation).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated

from pydantic import AfterValidator, Field

from eha_bench.control.controller import Context, Controller, clip
from eha_bench.core.errors import InputError, Place, UnitError
from eha_bench.core.units import Unit, base_unit, parse, unit_in
from eha_bench.core.yaml_file import Real, StrictModel


def _known_unit(written: float | str) -> float | str:
    try:
        base_unit(unit_in(written))
    except UnitError as error:
        raise ValueError(str(error)) from error
    return written


_Gain = Annotated[Real | str, AfterValidator(_known_unit)]
"""A quantity whose unit follows from what is controlled and by what: `4 V/mm`; a number is SI."""


class PidGains(StrictModel):
    """Gains; a command's unit by a channel's, as the trial and its target have them."""

    k_p: Annotated[_Gain, Field(description="proportional gain, command / channel")]
    k_i: Annotated[_Gain, Field(description="integral gain, command / (channel * s)")] = 0.0
    k_d: Annotated[_Gain, Field(description="derivative gain, command * s / channel")] = 0.0
    k_f: Annotated[_Gain, Field(description="feed-forward of the reference")] = 0.0
    setpoint_weight: Annotated[Real, Field(ge=0, description="b, of the reference in k_p")] = 1.0
    filter_time: Annotated[float, Unit("s"), Field(ge=0, description="of the derivative")] = 0.0
    tracking_time: Annotated[
        float | None, Unit("s"), Field(gt=0, description="T_t, in which the integral is led back")
    ] = None
    output_limit: Annotated[
        _Gain | None, Field(description="largest command, within what the target follows")
    ] = None


class Pid(Controller):
    """PID with set-point weight, filtered derivative of the measurement and anti-windup."""

    Gains = PidGains

    def __init__(self, gains: StrictModel, context: Context) -> None:
        """Start at rest.

        Raises:
            InputError: a gain of the wrong dimension; `where` has its key.
        """
        assert isinstance(gains, PidGains)
        self._channel, h = context.channel, context.period
        command, channel = context.command_unit, context.unit
        over = _per(command, channel)
        self._k_p = _in_si(gains.k_p, over, "k_p")
        self._k_i = _in_si(gains.k_i, _per(command, _times(channel, "s")), "k_i")
        k_d = _in_si(gains.k_d, _per(_times(command, "s"), channel), "k_d")
        self._k_f = _in_si(gains.k_f, over, "k_f")
        self._weight = gains.setpoint_weight
        limit = math.inf
        if gains.output_limit is not None:
            limit = _in_si(gains.output_limit, command, "output_limit")
            if limit <= 0.0:
                raise InputError("the limit is not above 0", where=Place(key="output_limit"))
        self._limit = min(limit, context.command_limit)
        self._period = h
        self._keeps = gains.filter_time / (gains.filter_time + h)
        self._slope = k_d / (gains.filter_time + h)
        found = gains.tracking_time or _tracking_time(self._k_p, self._k_i, k_d)
        self._tracking = max(found, h)
        self._integral = self._derivative = 0.0
        self._before = math.nan

    def step(self, reference: float, reading: Mapping[str, float]) -> float:
        """Return the command for a reference in the channel's SI unit."""
        value = reading[self._channel]
        if not math.isnan(self._before):
            change = self._slope * (value - self._before)
            self._derivative = self._keeps * self._derivative + change
        self._before = value
        asked = self._k_f * reference + self._k_p * (self._weight * reference - value)
        asked += self._integral - self._derivative
        given = clip(asked, self._limit)
        if self._k_i != 0.0:
            back = (given - asked) / self._tracking
            self._integral += self._period * (self._k_i * (reference - value) + back)
        return given


def _tracking_time(k_p: float, k_i: float, k_d: float) -> float:
    """Return sqrt(T_i T_d), or T_i without a derivative, s; 0 where there is no T_i."""
    if k_p == 0.0 or k_i == 0.0:
        return 0.0
    integral = abs(k_p / k_i)
    return math.sqrt(integral * abs(k_d / k_p)) if k_d != 0.0 else integral


def _in_si(value: float | str, unit: str, key: str) -> float:
    try:
        return parse(value, unit)
    except UnitError as error:
        raise InputError(error.what, where=Place(key=key), hint=error.hint) from error


def _per(unit: str, other: str) -> str:
    """Return the unit `unit / other`, where "" is a pure number."""
    if not other:
        return unit
    return f"{unit or '1'}/({other})" if {"*", "/"} & set(other) else f"{unit or '1'}/{other}"


def _times(unit: str, other: str) -> str:
    """Return the unit `unit * other`, where "" is a pure number."""
    return f"{unit}*{other}" if unit else other

"""Torque constant, static torque and leakage from a staircase of currents, piston locked.

Section 4.2 a of the paper: after a peak static friction holds the rotor until leakage has let the
pressure sag so far that the current overcomes it: K_T I = T_sf + D_p (P1 - P2) (Eq. 21). While the
rotor rests, dP1/dt = -beta / V_10 L_in (P1 - P2) (Eq. 22).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.special import stdtrit

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.core.metric import MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Bypass, ControlMode, Piston, Trial
from eha_bench.metrics.known import plant_constant, plant_constant_or_nan
from eha_bench.metrics.memo import remembered
from eha_bench.metrics.metric import Metric, NotScored
from eha_bench.metrics.noise import white_noise
from eha_bench.metrics.step_response import require_finite
from eha_bench.metrics.window import Timeline, edges_of, timeline

_AVERAGED = 0.020  # s: window that speeds are averaged over
_REST = 0.05  # s: how long the rotor has to have rested for a break-away to count
_QUIET = 3.0  # standard deviations of the averaged speed, up to which the rotor rests
_FEWEST_LEVELS = 2


@dataclass(frozen=True)
class BreakAways:
    """Where the current overcame static friction while the pressure sagged.

    Attributes:
        current: (n,) A, mean over the hold.
        pressure: (n,) Pa, at the break-away.
        level: (n,) number of the hold.
    """

    current: FloatArray
    pressure: FloatArray
    level: IndexArray


@dataclass(frozen=True)
class _Holds:
    line: Timeline
    spans: tuple[slice, ...]
    resting: BoolArray
    speed: FloatArray  # averaged, in the direction of the current
    quiet: float


def _holds(recording: Recording, trial: Trial) -> _Holds:
    return remembered(recording, trial, "holds", lambda: _find_holds(recording, trial))


def _find_holds(recording: Recording, trial: Trial) -> _Holds:
    line = timeline(recording, trial)
    spans = tuple(line.between(edge.time, edge.until) for edge in edges_of(recording, trial))
    speed = recording["motor_speed"]
    whole = slice(spans[0].start, spans[-1].stop)
    for name in ("motor_speed", "current", "pressure_difference"):
        require_finite(line, recording[name], whole)
    count = max(round(_AVERAGED / line.period), 1)
    averaged = uniform_filter1d(speed, count)
    quiet = _QUIET * max(white_noise(speed[whole]), 1e-6) / math.sqrt(count)
    return _Holds(line, spans, np.abs(averaged) < quiet, averaged, quiet)


def break_aways(recording: Recording, trial: Trial) -> BreakAways:
    """Return every break-away of the trial.

    Raises:
        NotScored: samples without a value, or break-aways at fewer than two currents.
        MissingChannelError: no motor_speed, current or pressure_difference.
    """
    return remembered(recording, trial, "break-aways", lambda: _break_aways(recording, trial))


def _break_aways(recording: Recording, trial: Trial) -> BreakAways:
    holds = _holds(recording, trial)
    time, pressure = holds.line.time, recording["pressure_difference"]
    half = max(round(0.5 * _AVERAGED / holds.line.period), 1)
    found: list[tuple[float, float, int]] = []
    for number, span in enumerate(holds.spans):
        current = recording["current"][span]
        settled = current[current.size // 2 :]
        if settled.size < 8:
            continue
        level = float(settled.mean())
        for index in _slips(holds, span, math.copysign(1.0, level)):
            onset = int(np.searchsorted(time, _onset(holds, index, math.copysign(1.0, level))))
            if onset - half < span.start:
                continue
            found.append((level, float(pressure[onset - half : onset + half].mean()), number))
    if len({number for _, _, number in found}) < _FEWEST_LEVELS:
        raise NotScored(
            f"{len(found)} break-away(s) at {len({n for _, _, n in found})} current(s): "
            "a line needs two; hold the currents for longer"
        )
    return BreakAways(
        np.array([current for current, _, _ in found]),
        np.array([sag for _, sag, _ in found]),
        np.array([number for _, _, number in found], dtype=np.intp),
    )


def _slips(holds: _Holds, span: slice, sign: float) -> list[int]:
    """Return samples at which the rotor, after a rest, has come to four times the quiet speed."""
    resting, fast = holds.resting[span], sign * holds.speed[span] >= 4.0 * holds.quiet
    turns = np.diff(np.concatenate([[False], resting, [False]]).astype(np.int8))
    starts, ends = np.flatnonzero(turns == 1), np.flatnonzero(turns == -1)
    rested = ends[ends - starts >= round(_REST / holds.line.period)]
    moving = np.flatnonzero(~resting & fast)
    # the first fast sample after each rest; rests without one in between share theirs
    after = np.searchsorted(moving, rested)
    slips = np.unique(moving[after[after < moving.size]])
    return [span.start + int(offset) for offset in slips]


def _onset(holds: _Holds, index: int, sign: float) -> float:
    """Return when the rotor began to move.

    The torque grows in proportion to time as the pressure sags, and the speed as its square: it
    took from rest to the quiet speed as long as from there to four times that speed.
    """
    before = index
    while before > 0 and sign * holds.speed[before] > holds.quiet:
        before -= 1
    time = holds.line.time
    return float(2.0 * time[before] - time[index])


class LockedMetric(Metric):
    """Scores staircases of current with the piston locked and the ports closed."""

    def applies(self, trial: Trial) -> bool:
        """Whether the trial is the first experiment of Section 4.2."""
        return (
            trial.mode == ControlMode.CURRENT
            and trial.setup.piston is Piston.LOCKED
            and trial.setup.bypass is Bypass.CLOSED
            and 3 <= len(trial.signal.edges) <= 64
            and not trial.signal.lines
        )

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:  # noqa: ARG002 - the base class asks for it
        """Return the constant; the recording as a whole is its channel."""
        if not trial.signal.edges:
            raise NotScored("the signal holds no level: a staircase of currents is needed")
        return self.of(recording, trial)

    @abstractmethod
    def of(self, recording: Recording, trial: Trial) -> Measure:
        """Return the constant."""


@dataclass(frozen=True)
class _Line:
    """current = intercept + slope * pressure, over all break-aways."""

    slope: float
    intercept: float
    covariance: FloatArray
    quantile: float
    reason: str


def _line(recording: Recording, trial: Trial) -> _Line:
    found = break_aways(recording, trial)
    current, pressure = found.current, found.pressure
    levels = np.unique(found.level)
    side = np.sign(current)
    scale = float(np.max(np.abs(pressure)))
    design = np.column_stack([side, pressure / scale])
    solution, _, rank, _ = np.linalg.lstsq(design, current, rcond=None)
    if rank < 2:
        raise NotScored("all break-aways are at one pressure: no line goes through one point")
    freedom = current.size - 2
    rest = current - design @ solution
    scatter = float(rest @ rest) / max(freedom, 1)
    shrink = np.array([1.0, 1.0 / scale])
    covariance = scatter * np.linalg.inv(design.T @ design) * np.outer(shrink, shrink)
    quantile = float(stdtrit(freedom, 0.975)) if freedom > 0 else math.nan
    return _Line(
        float(solution[1]) / scale,
        float(solution[0]),
        covariance,
        quantile,
        f"Eq. (21), {found.current.size} break-aways at {levels.size} currents",
    )


def against_model(recording: Recording, name: str, unit: str, reason: str) -> str:
    """Return a reason that says what the model has that made the recording."""
    value = plant_constant_or_nan(recording, name)
    return f"{reason}; model: {value:.4g} {unit}" if math.isfinite(value) else reason


class TorqueConstant(LockedMetric):
    """K_T in N*m/A from the slope of current against pressure at break-away."""

    spec = MetricSpec("torque_constant", "K_T by Eq. (21), piston locked", "N*m/A", "")

    def of(self, recording: Recording, trial: Trial) -> Measure:
        """Return D_p over the slope."""
        displacement = plant_constant(recording, "pump_displacement")
        line = _line(recording, trial)
        value = displacement / line.slope
        reach = line.quantile * math.sqrt(float(line.covariance[1, 1])) / abs(line.slope) * value
        reason = against_model(recording, self.spec.id, "N*m/A", line.reason)
        return Measure(value, value - abs(reach), value + abs(reach), reason)


class StaticTorque(LockedMetric):
    """T_sf in N*m from the intercept of current against pressure at break-away."""

    spec = MetricSpec("static_torque", "T_sf by Eq. (21), piston locked", "N*m", "")

    def of(self, recording: Recording, trial: Trial) -> Measure:
        """Return D_p intercept / slope: both scatter together."""
        displacement = plant_constant(recording, "pump_displacement")
        line = _line(recording, trial)
        value = displacement * line.intercept / line.slope
        gradient = displacement * np.array([1.0 / line.slope, -line.intercept / line.slope**2])
        reach = line.quantile * math.sqrt(float(gradient @ line.covariance @ gradient))
        reason = against_model(recording, self.spec.id, "N*m", line.reason)
        return Measure(value, value - reach, value + reach, reason)


class Leakage(LockedMetric):
    """L_in in m^3/(s*Pa) from the sag of the pressure while the rotor rests."""

    spec = MetricSpec("leakage", "L_in by Eq. (22), rotor at rest", "m^3/(s*Pa)", "")

    def of(self, recording: Recording, trial: Trial) -> Measure:
        """Return the mean over rests, weighted by what each one knows."""
        compliance = plant_constant(recording, "volume_a") / plant_constant(
            recording, "bulk_modulus"
        )
        holds = _holds(recording, trial)
        require_finite(holds.line, recording["pressure_a"], slice(holds.spans[0].start, None))
        values, weights = _sags(recording, holds, compliance)
        if values.size < 2:
            raise NotScored(f"{values.size} rest(s) of {4 * _REST:g} s under pressure: two needed")
        total = float(weights.sum())
        value = float(weights @ values) / total
        # scatter between rests, each counted by what it knows
        scatter = float(weights @ (values - value) ** 2) / total
        effective = total**2 / float(weights @ weights)
        freedom = max(effective - 1.0, 0.5)
        reach = float(stdtrit(freedom, 0.975)) * math.sqrt(scatter / freedom)
        reason = against_model(
            recording, self.spec.id, "m^3/(s*Pa)", f"Eq. (22), {values.size} rests"
        )
        return Measure(value, value - reach, value + reach, reason)


def _sags(recording: Recording, holds: _Holds, compliance: float) -> tuple[FloatArray, FloatArray]:
    """Return the leakage of every rest, and its weight.

    Eq. (4) integrated over the rest: V / beta (P1(t) - P1(0)) = D_p int omega dt - L int (P1 - P2)
    dt. The speed is kept, since a rotor that seems to rest may creep as fast as the oil leaks.
    """
    line = holds.line
    displacement = plant_constant(recording, "pump_displacement")
    pressure, difference = recording["pressure_a"], recording["pressure_difference"]
    speed = recording["motor_speed"]
    values, weights = [], []
    for span in holds.spans:
        resting = np.concatenate([[False], holds.resting[span], [False]])
        changes = np.flatnonzero(np.diff(resting.astype(np.int8)))
        for first, last in zip(changes[::2], changes[1::2], strict=True):
            part = slice(span.start + int(first), span.start + int(last))
            if (part.stop - part.start) * line.period < 4.0 * _REST:
                continue
            steps = np.diff(line.time[part], prepend=line.time[part.start] - line.period)
            driving = np.cumsum(difference[part] * steps)
            moved = displacement * np.cumsum(speed[part] * steps) - compliance * pressure[part]
            driving -= driving.mean()
            moved -= moved.mean()
            power = float(driving @ driving)
            pressed = abs(float(difference[part].mean())) > 10.0 * white_noise(difference[part])
            if pressed and power > 0.0:
                values.append(float(moved @ driving) / power)
                weights.append(power)
    return np.array(values), np.array(weights)

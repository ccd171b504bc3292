"""Energy and peak power of the motor's shaft, force of the rod, torque of the joint."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.linkage import Linkage
from eha_bench.core.metric import MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.known import plant_constant, plant_constant_or_nan
from eha_bench.metrics.metric import Metric, NotScored
from eha_bench.metrics.noise import white_noise
from eha_bench.metrics.samples import samples
from eha_bench.metrics.step_response import require_finite
from eha_bench.metrics.window import timeline

_FAR = 100.0
"""How far beyond a sensor's end readings are tried, in spans of the channel."""
_OF_SHAFT = ("current", "motor_speed")
_OF_ROD = ("pressure_difference", "pressure_a", "pressure_b")


@dataclass(frozen=True)
class _Scored:
    """A quantity over the scored time: (n,) s and (n,) of its unit, with its white noise."""

    time: FloatArray
    values: FloatArray
    noise: float


class DerivedMetric(Metric):
    """Scores a quantity that follows from several channels, over the scored time."""

    by_default = False
    reads: tuple[str, ...]
    """Channels that a sensor's end may cut off."""

    def applies(self, trial: Trial) -> bool:
        """Whether the signal lasts at all."""
        return trial.duration > 0.0

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:  # noqa: ARG002 - the base class asks for it
        """Return the value; the recording as a whole is its channel."""
        line = timeline(recording, trial)
        window = line.between(0.0, trial.duration)
        if window.stop - window.start < 2:
            raise NotScored("fewer than two samples in the scored time")
        values = self.quantity(recording)
        require_finite(line, values, window)
        inside = values[window]
        scored = _Scored(line.time[window], inside, white_noise(inside))
        found = self.of(scored)
        for name, beyond in self._cut_off(recording, trial, window):
            change = self.quantity(recording.with_values({name: beyond}))[window] - inside
            if np.any(change):
                found = self.open(found, scored, change)
                reason = f"{name}: the sensor's end cut readings off; {found.reason}"
                found = replace(found, reason=reason)
        return found

    def _cut_off(
        self, recording: Recording, trial: Trial, window: slice
    ) -> Iterator[tuple[str, FloatArray]]:
        """Yield channels that a sensor's end cut off, with readings far beyond that end."""
        for name in self.reads:
            data = samples(recording, trial, name) if name in recording else None
            if data is None or data.parts:  # which are looked at themselves
                continue
            for cut in data.cut_off(window):
                beyond = recording[name].copy()
                far = _FAR * float(np.ptp(beyond[window]))
                beyond[window][cut.at] += far if cut.above else -far
                yield name, beyond

    @abstractmethod
    def quantity(self, recording: Recording) -> FloatArray:
        """Return the quantity at every sample, SI."""

    @abstractmethod
    def of(self, scored: _Scored) -> Measure:
        """Return the value from the quantity over the scored time."""

    @abstractmethod
    def open(self, found: Measure, scored: _Scored, change: FloatArray) -> Measure:
        """Return a measure that holds what a sensor's end hid.

        Args:
            found: without that. scored: the quantity. change: (n,) what readings far beyond the
                sensor's end would do to it.
        """


class LargestMagnitude(DerivedMetric):
    """Scores the largest magnitude of a quantity."""

    def open(self, found: Measure, scored: _Scored, change: FloatArray) -> Measure:
        """Return it without an upper end, and from what is certain on."""
        certain = (change == 0.0) | (np.sign(change) == np.sign(scored.values))
        least = largest(replace(scored, values=np.where(certain, scored.values, 0.0)), "")
        return replace(found, low=min(found.low, least.low), high=math.inf)


def shaft_power(recording: Recording) -> FloatArray:
    """Return the power that the motor gives to the shaft, K_T I omega, W, (n,)."""
    constant = plant_constant(recording, "torque_constant")
    return constant * recording["current"] * recording["motor_speed"]


def rod_force(recording: Recording) -> FloatArray:
    """Return the force of the pressures on the piston, A_a P_1 - A_b P_2, N, (n,)."""
    area_a, area_b = (
        plant_constant(recording, "piston_area_a"),
        plant_constant(recording, "piston_area_b"),
    )
    if area_a == area_b and "pressure_difference" in recording:
        return area_a * recording["pressure_difference"]
    return area_a * recording["pressure_a"] - area_b * recording["pressure_b"]


def joint_torque(recording: Recording) -> FloatArray:
    """Return the torque of the rod force about the joint, Eq. (9)-(10), N*m, (n,)."""
    linkage = _linkage(recording)
    position = (
        recording["piston_position"]
        if "piston_position" in recording
        else linkage.position(recording["joint_angle"])
    )
    return rod_force(recording) * linkage.arm(position)


def _linkage(recording: Recording) -> Linkage:
    """Return the triangle, by the length between its pins or by that of the cylinder."""
    a, b = plant_constant(recording, "link_a"), plant_constant(recording, "link_b")
    length = plant_constant_or_nan(recording, "link_length")
    if math.isfinite(length):
        return Linkage(a, b, length, 0.0)
    half = plant_constant(recording, "volume_a") / plant_constant(recording, "piston_area_a")
    return Linkage(a, b, plant_constant(recording, "link_c0"), half)


def largest(scored: _Scored, what: str) -> Measure:
    """Return the largest magnitude; its interval reaches as far as its sample's noise."""
    value = float(np.max(np.abs(scored.values)))
    excess = scored.noise * math.sqrt(2.0 * math.log(max(scored.values.size, 2)))
    return Measure(value, max(value - excess, 0.0), value + 1.96 * scored.noise, what)


class Energy(DerivedMetric):
    """Net mechanical energy in J that the motor gives to the shaft."""

    spec = MetricSpec("energy", "net energy given to the motor's shaft", "J", "")
    reads = _OF_SHAFT

    def quantity(self, recording: Recording) -> FloatArray:
        """Return the shaft power in W."""
        return shaft_power(recording)

    def of(self, scored: _Scored) -> Measure:
        """Return the integral by trapezoids; white noise adds up as a random walk."""
        value = float(np.trapezoid(scored.values, scored.time))
        period = float(scored.time[-1] - scored.time[0]) / (scored.time.size - 1)
        reach = 1.96 * scored.noise * period * math.sqrt(scored.time.size)
        return Measure(value, value - reach, value + reach, "integral of K_T I omega, net")

    def open(self, found: Measure, scored: _Scored, change: FloatArray) -> Measure:
        """Return it open to every side on which the hidden readings may have been."""
        del scored
        return replace(
            found,
            low=-math.inf if np.any(change < 0.0) else found.low,
            high=math.inf if np.any(change > 0.0) else found.high,
        )


class PeakPower(LargestMagnitude):
    """Largest magnitude of the shaft power in W."""

    spec = MetricSpec("peak_power", "largest magnitude of the motor's shaft power", "W", "")
    reads = _OF_SHAFT

    def quantity(self, recording: Recording) -> FloatArray:
        """Return the shaft power in W."""
        return shaft_power(recording)

    def of(self, scored: _Scored) -> Measure:
        """Return the largest magnitude."""
        return largest(scored, "largest |K_T I omega|")


class PeakForce(LargestMagnitude):
    """Largest magnitude of the pressures' force on the piston, N."""

    spec = MetricSpec("peak_force", "largest force of the pressures on the piston", "N", "")
    reads = _OF_ROD

    def quantity(self, recording: Recording) -> FloatArray:
        """Return the rod force in N."""
        return rod_force(recording)

    def of(self, scored: _Scored) -> Measure:
        """Return the largest magnitude."""
        return largest(scored, "largest |A_a P_1 - A_b P_2|")


class PeakJointTorque(LargestMagnitude):
    """Largest magnitude of the rod force's torque about the joint, N*m."""

    spec = MetricSpec("peak_joint_torque", "largest torque about the joint, Eq. (9)", "N*m", "")
    reads = _OF_ROD

    def quantity(self, recording: Recording) -> FloatArray:
        """Return the joint torque in N*m."""
        return joint_torque(recording)

    def of(self, scored: _Scored) -> Measure:
        """Return the largest magnitude."""
        return largest(scored, "largest torque of the rod force through the linkage")

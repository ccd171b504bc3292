"""Energy and peak power of the motor's shaft, force of the rod, torque of the joint."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.linkage import Linkage
from eha_bench.core.metric import MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.known import known
from eha_bench.metrics.metric import Metric, NotScored
from eha_bench.metrics.noise import white_noise
from eha_bench.metrics.step_response import require_finite
from eha_bench.metrics.window import timeline


@dataclass(frozen=True)
class _Scored:
    """A quantity over the scored time: (n,) s and (n,) of its unit, with its white noise."""

    time: FloatArray
    values: FloatArray
    noise: float


class DerivedMetric(Metric):
    """Scores a quantity that follows from several channels, over the scored time."""

    by_default = False

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
        return self.of(_Scored(line.time[window], inside, white_noise(inside)))

    @abstractmethod
    def quantity(self, recording: Recording) -> FloatArray:
        """Return the quantity at every sample, SI."""

    @abstractmethod
    def of(self, scored: _Scored) -> Measure:
        """Return the value from the quantity over the scored time."""


def shaft_power(recording: Recording) -> FloatArray:
    """Return the power that the motor gives to the shaft, K_T I omega, W, (n,)."""
    constant = known(recording, "torque_constant")
    return constant * recording["current"] * recording["motor_speed"]


def rod_force(recording: Recording) -> FloatArray:
    """Return the force of the pressures on the piston, A_a P_1 - A_b P_2, N, (n,)."""
    area_a, area_b = known(recording, "piston_area_a"), known(recording, "piston_area_b")
    if area_a == area_b and "pressure_difference" in recording:
        return area_a * recording["pressure_difference"]
    return area_a * recording["pressure_a"] - area_b * recording["pressure_b"]


def joint_torque(recording: Recording) -> FloatArray:
    """Return the torque of the rod force about the joint, Eq. (9)-(10), N*m, (n,)."""
    linkage = Linkage(
        known(recording, "link_a"),
        known(recording, "link_b"),
        known(recording, "link_c0"),
        known(recording, "volume_a") / known(recording, "piston_area_a"),
    )
    position = (
        recording["piston_position"]
        if "piston_position" in recording
        else linkage.position(recording["joint_angle"])
    )
    return rod_force(recording) * linkage.arm(position)


def largest(scored: _Scored, what: str) -> Measure:
    """Return the largest magnitude; its interval reaches as far as its sample's noise."""
    value = float(np.max(np.abs(scored.values)))
    excess = scored.noise * math.sqrt(2.0 * math.log(max(scored.values.size, 2)))
    return Measure(value, max(value - excess, 0.0), value + 1.96 * scored.noise, what)


class Energy(DerivedMetric):
    """Net mechanical energy in J that the motor gives to the shaft."""

    spec = MetricSpec("energy", "net energy given to the motor's shaft", "J", "")

    def quantity(self, recording: Recording) -> FloatArray:
        """Return the shaft power in W."""
        return shaft_power(recording)

    def of(self, scored: _Scored) -> Measure:
        """Return the integral by trapezoids; white noise adds up as a random walk."""
        value = float(np.trapezoid(scored.values, scored.time))
        period = float(scored.time[-1] - scored.time[0]) / (scored.time.size - 1)
        reach = 1.96 * scored.noise * period * math.sqrt(scored.time.size)
        return Measure(value, value - reach, value + reach, "integral of K_T I omega, net")


class PeakPower(DerivedMetric):
    """Largest magnitude of the shaft power in W."""

    spec = MetricSpec("peak_power", "largest magnitude of the motor's shaft power", "W", "")

    def quantity(self, recording: Recording) -> FloatArray:
        """Return the shaft power in W."""
        return shaft_power(recording)

    def of(self, scored: _Scored) -> Measure:
        """Return the largest magnitude."""
        return largest(scored, "largest |K_T I omega|")


class PeakForce(DerivedMetric):
    """Largest magnitude of the pressures' force on the piston, N."""

    spec = MetricSpec("peak_force", "largest force of the pressures on the piston", "N", "")

    def quantity(self, recording: Recording) -> FloatArray:
        """Return the rod force in N."""
        return rod_force(recording)

    def of(self, scored: _Scored) -> Measure:
        """Return the largest magnitude."""
        return largest(scored, "largest |A_a P_1 - A_b P_2|")


class PeakJointTorque(DerivedMetric):
    """Largest magnitude of the rod force's torque about the joint, N*m."""

    spec = MetricSpec("peak_joint_torque", "largest torque about the joint, Eq. (9)", "N*m", "")

    def quantity(self, recording: Recording) -> FloatArray:
        """Return the joint torque in N*m."""
        return joint_torque(recording)

    def of(self, scored: _Scored) -> Measure:
        """Return the largest magnitude."""
        return largest(scored, "largest torque of the rod force through the linkage")

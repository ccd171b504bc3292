"""Coulomb torque, viscous torque and Stribeck speed from constant currents, ports connected.

Section 4.2 b of the paper: without a pressure to work against, the settled speed is friction alone,
K_T I = T_cf + (T_sf - T_cf) exp(-(omega / omega_s)^2) + B_pm omega (Eq. 23).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import stdtrit

from eha_bench.core.arrays import FloatArray
from eha_bench.core.metric import MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Bypass, ControlMode, Piston, Trial
from eha_bench.metrics.known import plant_constant, plant_constant_or_nan
from eha_bench.metrics.levels import level
from eha_bench.metrics.locked_identification import against_model
from eha_bench.metrics.memo import remembered
from eha_bench.metrics.metric import Metric, NotScored
from eha_bench.metrics.noise import estimate
from eha_bench.metrics.step_response import final_window, require_finite
from eha_bench.metrics.window import edges_of, timeline

_STEADY = 0.5  # of the speed: what it may drift by along the final window ...
_STEADY_UNCORRECTED = 0.003  # ... and where the inertia is not known that this costs torque
_FEWEST = 5
_NORMAL = 1.959964
"""Two-sided 95 % quantile of the normal distribution."""


@dataclass(frozen=True)
class StribeckCurve:
    """Eq. (23) fitted to settled speeds.

    Attributes:
        parameters: T_cf (N*m), B_pm (N*m*s/rad), T_sf (N*m), omega_s (rad/s).
        covariance: (4, 4).
        quantile: two-sided 95 %: Student's where the scatter of the levels tells the interval,
            normal where their noise does.
        reason: how many levels it rests on.
    """

    parameters: FloatArray
    covariance: FloatArray
    quantile: float
    reason: str


def stribeck_curve(recording: Recording, trial: Trial) -> StribeckCurve:
    """Return the curve through the settled speeds of all holds.

    Raises:
        NotScored: fewer than five settled speeds, or samples without a value.
        MissingChannelError: no current or motor_speed.
    """
    return remembered(recording, trial, "stribeck", lambda: _curve(recording, trial))


def _curve(recording: Recording, trial: Trial) -> StribeckCurve:
    constant = plant_constant(recording, "torque_constant")
    torque, speed, noise, left_out = _settled_holds(recording, trial, constant)
    if speed.size < _FEWEST:
        raise NotScored(
            f"{speed.size} settled speeds ({left_out} not settled or at rest), 5 needed"
        )
    size, fast = float(torque.max()), float(speed.max())

    def rest(x: FloatArray) -> FloatArray:
        coulomb, viscous, extra, stribeck = x
        curve = coulomb + viscous * speed / fast + extra * np.exp(-((speed / fast / stribeck) ** 2))
        return np.asarray(curve - torque / size)

    start = np.array([0.3 * float(torque.min()) / size, 0.5, 0.1, float(np.median(speed)) / fast])
    fits = [
        least_squares(
            rest, [*start[:3], share], bounds=([0.0, 0.0, 0.0, 1e-3], [2.0, 2.0, 2.0, 1.0])
        )
        for share in (0.02, 0.05, 0.1, 0.3)
    ]
    best = min(fits, key=lambda found: found.cost)
    freedom = speed.size - 4
    jacobian = np.asarray(best.jac, dtype=np.float64)
    curvature = jacobian.T @ jacobian
    scatter = 2.0 * float(best.cost) / max(freedom, 1)
    quantile = float(stdtrit(freedom, 0.975)) if freedom > 0 else math.nan
    # so few levels may lie close to the curve by chance: not closer than their noise lets them
    slope = _slope(best.x, speed / fast) * size / fast
    expected = float(np.mean(noise[:, 0] + slope**2 * noise[:, 1])) / size**2
    if quantile**2 * scatter < _NORMAL**2 * expected:
        scatter, quantile = expected, _NORMAL
    inner = scatter * np.linalg.pinv(curvature)
    # T_sf = T_cf + what is above it at rest
    turn = np.diag([size, size / fast, size, fast])
    turn[2, 0] = size
    parameters = turn @ best.x
    return StribeckCurve(
        parameters,
        turn @ inner @ turn.T,
        quantile,
        f"Eq. (23), {speed.size} settled speeds, {left_out} levels left out",
    )


def _slope(x: FloatArray, share: FloatArray) -> FloatArray:
    """Return the curve's slope at (n,) shares of the highest speed."""
    _, viscous, extra, stribeck = x
    bend = 2.0 * share / stribeck**2 * np.exp(-((share / stribeck) ** 2))
    return np.asarray(viscous - extra * bend)


def _settled_holds(
    recording: Recording, trial: Trial, constant: float
) -> tuple[FloatArray, FloatArray, FloatArray, int]:
    """Return torque and speed of every hold that ends at a constant speed, how many do not.

    Both (n,) and positive; between them and the count their variances by the noise, (n, 2).
    """
    line = timeline(recording, trial)
    speeds, currents = recording["motor_speed"], recording["current"]
    displacement = plant_constant(recording, "pump_displacement")
    inertia = plant_constant_or_nan(recording, "rotor_inertia")
    steady = _STEADY if math.isfinite(inertia) else _STEADY_UNCORRECTED
    found: list[tuple[float, float]] = []
    variances: list[tuple[float, float]] = []
    edges = edges_of(recording, trial)
    for edge in edges:
        window = final_window(line, edge)
        require_finite(line, speeds, window)
        require_finite(line, currents, window)
        if window.stop - window.start < 20:
            continue
        noise = estimate([speeds[window]])
        speed = level(speeds[window], noise)
        drift_limit = steady * abs(speed.value) + 3.0 * math.sqrt(speed.drift_variance)
        if abs(speed.value) < 10.0 * math.sqrt(speed.variance) + 1e-9:
            continue
        if abs(speed.drift) > drift_limit or abs(speed.value) < 0.5:
            continue
        drive = constant * currents[window]
        if "pressure_difference" in recording:
            # what pressure the open valve leaves acts on the pump as well
            drive = drive - displacement * recording["pressure_difference"][window]
        length = float(line.time[window][-1] - line.time[window][0])
        share = inertia / length if math.isfinite(inertia) else 0.0
        torque = float(drive.mean()) - share * speed.drift
        if torque * speed.value > 0.0:
            found.append((abs(torque), abs(speed.value)))
            own = estimate([drive]).variance_of_mean(drive.size)
            variances.append((own + share**2 * speed.drift_variance, speed.variance))
    torques, turning = (np.array([pair[k] for pair in found]) for k in (0, 1))
    return torques, turning, np.array(variances), len(edges) - len(found)


class BypassMetric(Metric):
    """Scores staircases of current with the piston locked and the ports connected."""

    index: int

    def applies(self, trial: Trial) -> bool:
        """Whether the trial is the second experiment of Section 4.2."""
        return (
            trial.mode == ControlMode.CURRENT
            and trial.setup.piston is Piston.LOCKED
            and trial.setup.bypass is Bypass.OPEN
            and _FEWEST <= len(trial.signal.edges) <= 64
            and not trial.signal.lines
        )

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:  # noqa: ARG002 - the base class asks for it
        """Return the constant; the recording as a whole is its channel."""
        curve = stribeck_curve(recording, trial)
        value = float(curve.parameters[self.index])
        reach = curve.quantile * math.sqrt(float(curve.covariance[self.index, self.index]))
        if not reach < 10.0 * abs(value):
            raise NotScored(
                f"{self.spec.id} cannot be determined from these speeds ({curve.reason})"
            )
        reason = against_model(recording, self.spec.id, self.spec.unit or "", curve.reason)
        return Measure(value, value - reach, value + reach, reason)


class CoulombTorque(BypassMetric):
    """T_cf in N*m."""

    spec = MetricSpec("coulomb_torque", "T_cf by Eq. (23), ports connected", "N*m", "")
    index = 0


class ViscousTorque(BypassMetric):
    """B_pm in N*m*s/rad."""

    spec = MetricSpec("viscous_torque", "B_pm by Eq. (23), ports connected", "N*m*s/rad", "")
    index = 1


class StribeckSpeed(BypassMetric):
    """omega_s in rad/s."""

    spec = MetricSpec("stribeck_speed", "omega_s by Eq. (23), ports connected", "rad/s", "")
    index = 3

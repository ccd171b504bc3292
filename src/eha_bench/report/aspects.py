"""Which side of a response a metric shows: one change of speed moves five metrics at once."""

from __future__ import annotations

from typing import Final

_METRICS: Final = {
    "Speed": (
        "rise_time", "response_time", "peak_time", "delay_time", "dead_time", "phase_lag",
        "time_lag", "bandwidth_3db", "bandwidth_90deg", "resonance_frequency",
    ),
    "Damping": (
        "overshoot", "undershoot", "peak", "settling_time", "resonance_peak", "gain_margin",
        "phase_margin",
    ),
    "Accuracy": (
        "steady_state_error", "amplitude_ratio", "distortion", "sine_residual", "tracking_rms",
        "tracking_max", "tracking_nrmse", "tracking_p95", "tracking_rms_lag_compensated",
        "tracking_rms_moving", "tracking_rms_resting",
    ),
    "Effort": ("holding_current", "energy", "peak_force", "peak_joint_torque", "peak_power"),
    "Plant": (
        "backlash", "coulomb_torque", "leakage", "pressure_decay", "static_torque",
        "stribeck_speed", "stroke_friction", "torque_constant", "viscous_torque",
    ),
    "Control loop": ("loop_overruns",),
}  # fmt: skip
_BY_ID: Final = {metric: aspect for aspect, metrics in _METRICS.items() for metric in metrics}
_BY_UNIT: Final = {"s": "Speed", "Hz": "Speed", "N": "Effort", "N*m": "Effort", "A": "Effort",
                   "W": "Effort", "J": "Effort"}  # fmt: skip


def aspect_of(metric: str, unit: str) -> str:
    """Return what a metric shows: Speed, Damping, Accuracy, Effort, Plant, Control loop or Other.

    Args:
        metric: its id; one that is not ours is placed by its unit.
        unit: SI unit of its value.
    """
    return _BY_ID.get(metric) or _BY_UNIT.get(unit, "Other")

"""Whether what held-out runs show is no more than calibrated parameters are uncertain by.

A run that moves otherwise than those that were fitted is predicted as well as they determine the
parameters, not as well as they are fitted: slow drifts add up what a creep speed or a leak is off
by. So the parameters are moved to explain the held-out runs, each direction held by what the
training runs tell of it (one Gauss-Newton step of both together). If the error is then as in
training, and they moved by no more than chance moves them, nothing else acts there.

    min |r + J d|^2 + d' H d,    d' H d ~ chi2(p) of a right model

Source: Seber, Wild, Nonlinear Regression, Wiley 1989, section 2.8 (prediction).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.stats import chi2

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.least_squares import Fit, jacobian
from eha_bench.diagnosis.fit.problem import Problem, soften
from eha_bench.diagnosis.fit.thresholds import Thresholds
from eha_bench.diagnosis.replay.errors_by_channel import ChannelError, rms_by_channel


def is_within_uncertainty(
    problem: Problem, fit: Fit, trained: Mapping[str, ChannelError], limits: Thresholds
) -> bool:
    """Return whether parameters as uncertain as a fit leaves them explain held-out windows.

    Args:
        problem: windows of the held-out runs, prepared where the fit ended. fit: of training runs.
        trained: errors of these by channel. limits: of what says something.
    """
    moved, squared = _moved(problem, fit)
    if squared > chi2.ppf(1.0 - limits.p_value, len(fit.free)):
        return False
    problem.prepare(moved)
    errors = rms_by_channel(problem, moved)
    return all(
        errors[name] <= limits.windows * max(item.after_windows, item.noise_floor)
        for name, item in trained.items()
        if name in errors and item.noise_floor > 0.0
    )


def _moved(problem: Problem, fit: Fit) -> tuple[FloatArray, float]:
    """Return the parameters that explain held-out windows as well, and how far they are, chi2."""
    vector = fit.vector
    # a run's own parameters, and its log's, are those of training runs
    shared = [k for k, item in enumerate(fit.free) if not item.run and not item.of_log]
    free = [fit.free[k] for k in shared]
    residual = problem.residual(vector)
    slopes = jacobian(problem, vector, free, residual)
    _, weight = soften(fit.residual, fit.soft)
    known = np.linalg.qr(fit.jacobian[:, shared] * weight[:, None], mode="r")
    columns = np.vstack([slopes, known])
    error = np.concatenate([residual, np.zeros(len(known))])
    step = -np.linalg.lstsq(columns, error)[0]
    moved = vector.copy()
    for item, change in zip(free, step.tolist(), strict=True):
        moved[item.at] = min(max(vector[item.at] + change * item.scale, item.low), item.high)
    return moved, float(np.sum((known @ step) ** 2))

"""Whether commands were given more often than logged, asked again beside what was found.

A large effect hides it from the calibration: then a second cause is found for what a command does
between its logged samples. So what is found is looked for again with commands as they acted.
"""

from __future__ import annotations

from dataclasses import replace

from eha_bench.diagnosis.fit.baseline import Baseline
from eha_bench.diagnosis.fit.command_leads import command_leads, lead_notes, with_leads
from eha_bench.diagnosis.fit.least_squares import levenberg_marquardt
from eha_bench.diagnosis.search.state import Search


def with_led_commands(base: Baseline, search: Search) -> Baseline | None:
    """Return the model calibrated with commands as they acted, or None where the log has them all.

    Args:
        base: as calibrated. search: finished; nothing is asked where it leaves only noise.
    """
    known = any(item.given_every for item in base.measured)
    if known or not search.effects or not search.is_unexplained:
        return None
    search.problem.prepare(search.fit.vector)
    periods, _, _ = command_leads(search.problem, search.fit)
    if not periods:
        return None
    measured, windows = with_leads(base.measured, base.problem.windows, periods)
    problem = base.problem.over(windows)
    problem.prepare(base.fit.vector)
    problem.scale_to(problem.residual(base.fit.vector))
    fit = levenberg_marquardt(problem, base.fit.vector, base.fit.free)
    notes = (*base.notes, *lead_notes(measured))
    return replace(base, measured=measured, problem=problem, fit=fit, notes=notes)

"""The block `matters` of a trial: the smallest difference that matters, by metric."""

from __future__ import annotations

from eha_bench.core.errors import InputError, UnitError
from eha_bench.core.located import Located
from eha_bench.core.margin import EquivalenceMargin, parse_margin
from eha_bench.core.trial import ControlMode
from eha_bench.suites.acceptance.specs import NONE, Specs, spec_named


def margins(matters: Located, mode: ControlMode, own: Specs = NONE) -> dict[str, EquivalenceMargin]:
    """Return the smallest difference that matters between two results, by metric.

    `own` are the suite's own metrics.

    Raises:
        InputError: an unknown metric, or not a difference in the metric's unit.
    """
    found = {}
    for metric, entry in matters.mapping("differences by metric").items():
        spec = spec_named(metric, own, entry.place())
        channel = spec.channel_for(mode.channel)
        controlled = channel == mode.channel
        unit = spec.unit_for(mode.unit) if controlled else spec.unit_on(channel)
        try:
            found[metric] = parse_margin(entry.value, unit)
        except UnitError as error:
            raise InputError(error.what, where=entry.place(), hint=error.hint) from error
    return found

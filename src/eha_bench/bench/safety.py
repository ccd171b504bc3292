"""Safety limits held against a recording: whoever made it may not have looked at them.

The rule is that of the targets that stop by themselves: one reading outside of a limit breaks it,
whatever its noise. Where nothing was read nothing is broken; a target that runs may not go on then,
and a recording says no more.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from eha_bench.core.errors import UnitError
from eha_bench.core.limit import SafetyLimit
from eha_bench.core.recording import Recording
from eha_bench.core.trial import Trial
from eha_bench.core.units import factor_and_offset

_POWER = re.compile(r"(?<=[^\W\d_])([23])\b")
"""A power that is written without a sign for it: m/s2."""


def breach(recording: Recording, trial: Trial) -> str:
    """Return the first reading outside of a safety limit, with value and time; "" for none."""
    first, said = len(recording), ""
    for limit in trial.safety:
        if _why_unchecked(limit, recording):
            continue
        values, bounds = recording[limit.channel], limit.bounds
        outside = np.flatnonzero((values < bounds.low) | (values > bounds.high))
        if outside.size and outside[0] < first:
            first = int(outside[0])
            time = float(recording.time[first])
            said = f"{limit.broken_by(float(values[first]))} at {time:.6g} s"
    return said


def unchecked(recording: Recording, trial: Trial) -> Iterator[str]:
    """Say which safety limits a recording cannot be held to, one sentence each."""
    for limit in trial.safety:
        why = _why_unchecked(limit, recording)
        if why:
            yield f"safety limit {limit.channel} {limit.text} not checked: {why}"


def _why_unchecked(limit: SafetyLimit, recording: Recording) -> str:
    """Return why a recording does not tell whether a limit was kept, "" where it does."""
    name = limit.channel
    if name not in recording or np.isnan(recording[name]).all():
        return f"no {name} was recorded"
    recorded, meant = recording.unit(name), limit.si_unit
    if not recorded or not meant or _same_unit(recorded, meant):
        return ""
    return f"it was recorded in {recorded}"


def _same_unit(recorded: str, meant: str) -> bool:
    """Whether two texts are one unit, however it is written: Nm and N*m are."""
    if recorded == meant:
        return True
    try:
        factor, offset = factor_and_offset(_POWER.sub(r"^\1", recorded), meant)
    except UnitError:
        return False
    return math.isclose(factor, 1.0, rel_tol=1e-12) and offset == 0.0

"""How well the loop that made a recording was kept, as a sentence for people."""

from __future__ import annotations

import math
from collections.abc import Mapping


def loop_note(metadata: Mapping[str, str]) -> str:
    """Return the loop health that a recording's metadata carries; "" where it carries none."""
    period = _number(metadata, "loop_period_p50")
    if not math.isfinite(period):
        return ""
    p999, most = _number(metadata, "loop_period_p99_9"), _number(metadata, "loop_period_max")
    count = {
        key: metadata.get(f"loop_{key}", "?")
        for key in ("overruns", "ticks", "lost_frames", "late_frames", "frames")
    }
    return (
        f"loop: period {period * 1e3:.3f} ms at the median, {p999 * 1e3:.3f} ms at 99.9 %, "
        f"{most * 1e3:.3f} ms at most; {count['overruns']} overruns of {count['ticks']} ticks, "
        f"{count['lost_frames']} lost and {count['late_frames']} late of {count['frames']} frames; "
        f"{metadata.get('loop_scheduling', 'ordinary')} scheduling"
    )


def _number(metadata: Mapping[str, str], key: str) -> float:
    try:
        return float(metadata.get(key, "nan"))
    except ValueError:
        return math.nan

"""A trial's response as small as a line of text: the reference, and what followed it."""

from __future__ import annotations

from typing import Final

import numpy as np
from markupsafe import Markup

from eha_bench.report.envelope import envelope_indices
from eha_bench.report.panels import Panel
from eha_bench.report.scene import Scene

_WIDTH: Final = 160.0
_HEIGHT: Final = 32.0
_EDGE: Final = 2.0
_POINTS: Final = 120


def spark(scene: Scene) -> Markup:
    """Return the first panel of a scene as a small plot without axes; nothing for an empty one."""
    if not scene.panels:
        return Markup()
    panel, time = scene.panels[0], scene.recording.time
    low, high = _range(scene, panel)
    paths = []
    for trace in panel.traces:
        values = scene.recording[trace.channel]
        kept = envelope_indices(values, _POINTS)
        kept = kept[np.isfinite(values[kept])]
        if kept.size < 2:
            continue
        x = _WIDTH * (time[kept] - time[0]) / (time[-1] - time[0])
        y = _EDGE + (_HEIGHT - 2.0 * _EDGE) * (high - values[kept]) / (high - low)
        places = "L".join(f"{a:.0f} {b:.1f}" for a, b in zip(x, y, strict=True))
        dashes = ' stroke-dasharray="3 2"' if trace.dashed else ""
        paths.append(f'<path d="M{places}" stroke="var(--{trace.colour})"{dashes}/>')
    return Markup(
        f'<svg class="spark" viewBox="0 0 {_WIDTH:.0f} {_HEIGHT:.0f}" preserveAspectRatio="none" '
        f'aria-hidden="true" focusable="false"><g fill="none" stroke-width="1.4">'
        f"{''.join(paths)}</g></svg>"
    )


def _range(scene: Scene, panel: Panel) -> tuple[float, float]:
    values = np.concatenate([scene.recording[name] for name in panel.channels])
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    lacking = max(0.0, (panel.least_span or (low == high)) - (high - low)) / 2.0
    return low - lacking, high + lacking

"""A history in Markdown: what the newest run is, a line an event, for a chat, a mail or a page."""

from __future__ import annotations

from typing import Final

from eha_bench.report.causes_text import wear_sentence
from eha_bench.report.markdown import as_text
from eha_bench.report.trend_site import event_sentence, headline
from eha_bench.trends.history import History

_SIGNS: Final = {"drifted": "❌", "steady": "✅", "undecided": "⚠️"}
_MOST: Final = 20


def history_markdown(history: History) -> str:
    """Return status, headline, and an item an event that the newest run shows."""
    parts = [
        f"## {_SIGNS[history.status]} {as_text(history.folder)}: {history.status}",
        as_text(headline(history)),
    ]
    if history.causes is not None and history.causes.wear:
        parts.append("\n".join(f"- {as_text(wear_sentence(wear))}" for wear in history.causes.wear))
    now = [event for event in history.events if event.now]
    if now:
        lines = [f"- {as_text(event_sentence(event))}" for event in now[:_MOST]]
        lines += [f"- and {len(now) - _MOST} more"] if len(now) > _MOST else []
        parts.append("\n".join(lines))
    if history.problems:
        lines = [f"- ⚠️ left out: {as_text(problem)}" for problem in history.problems[:_MOST]]
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"

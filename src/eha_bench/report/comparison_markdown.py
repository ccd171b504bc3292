"""A comparison in Markdown, for a merge request."""

from __future__ import annotations

from typing import Final

from eha_bench.comparison.comparison import Comparison
from eha_bench.comparison.verdict import ComparisonVerdict
from eha_bench.report.comparison_report import headline, limits_turned, verdict_of
from eha_bench.report.comparison_rows import Row, rows_of
from eha_bench.report.markdown import as_text, table

_SIGNS: Final = {
    "failed": "❌",
    "passed": "✅",
    "warned": "⚠️",
    "undecided": "❔",
    "incomplete": "⚠️",
}
_HEADING: Final = ("Trial", "Metric", "Baseline", "Candidate", "Difference (95 %)", "Verdict")


def comparison_markdown(comparison: Comparison) -> str:
    """Return verdict, caveats and what is not the same; what is the same is folded away."""
    suite = as_text(" and ".join(sorted(comparison.candidate.suites)))
    look, word = verdict_of(comparison)
    parts = [
        f"## {_SIGNS[look]} {suite}: {word[0].lower()}{word[1:]}",
        as_text(headline(comparison)),
    ]
    if comparison.stopped:
        parts.append(as_text(comparison.stopped))
    if comparison.caveats:
        parts.append("\n".join(f"- ⚠️ {as_text(caveat)}" for caveat in comparison.caveats))
    missed, kept = limits_turned(comparison)
    turned = [f"- ❌ limit newly missed: {as_text(text)}" for text in missed]
    turned += [f"- ✅ limit kept again: {as_text(text)}" for text in kept]
    if turned:
        parts.append("\n".join(turned))
    others = [verdict for verdict in ComparisonVerdict if verdict is not ComparisonVerdict.SAME]
    notable = rows_of(comparison.of(*others))
    if notable:
        parts.append(table(_HEADING, (_cells(row) for row in notable)))
    same = rows_of(comparison.of(ComparisonVerdict.SAME))
    if same:
        body = table(_HEADING, (_cells(row) for row in same))
        parts.append(f"<details><summary>{len(same)} the same</summary>\n\n{body}\n\n</details>")
    return "\n\n".join(parts) + "\n"


def _cells(row: Row) -> tuple[str, ...]:
    name = ", ".join(part for part in (row.metric, row.channel) if part)
    unit = f" {row.unit}" if row.unit else ""
    difference = row.difference + (f" ({row.share})" if row.share else "")
    if row.interval:
        difference += f" [{row.interval}]"
    verdict = f"{row.sign} {row.verdict}" + (f": {row.note}" if row.note else "")
    return (
        as_text(row.trial),
        as_text(name),
        as_text(row.baseline + unit),
        as_text(row.candidate + unit),
        as_text(difference),
        as_text(verdict),
    )

"""The page of a loop that was closed in rounds: each diagnosis, and the experiment after it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eha_bench.report.engineering import number
from eha_bench.report.page import Fact, write_page


@dataclass(frozen=True)
class RoundRow:
    """One round."""

    number: int
    verdict: str
    causes: str
    open: str
    experiment: str
    right: str
    seconds: str
    status: str
    diagnosis: str
    page: str


_WORDS = {
    "settled": ("passed", "Settled", "Nothing is open."),
    "none_permitted": ("undecided", "Not settled", "No permitted experiment would go further."),
    "out_of_rounds": ("undecided", "Not settled", "The permitted number of rounds was reached."),
    "stopped": ("fault", "Stopped", "A run did not finish."),
}  # fmt: skip


def write_rounds_report(path: Path, content: Mapping[str, Any]) -> Path:
    """Write the page of all rounds and return its path.

    Args:
        path: of the page. content: of rounds.json.
    """
    status, word, sentence = _WORDS[content["ending"]]
    last = content["rounds"][-1]
    if last["ending"] not in (None, "proposed"):
        sentence = f"{last['experiment'][:1].upper()}{last['experiment'][1:]}."
    notes = tuple(content["notes"])
    if reason := last.get("reason"):
        sentence = (
            f"Round {last['round']} did not come to its end. {reason[:1].upper()}{reason[1:]}"
        )
        notes = tuple(note for note in notes if not note.endswith(reason))
    rows = tuple(_row(item) for item in content["rounds"])
    seconds = f"{number(content['bench_seconds'], 2)} s"
    page = {
        "name": path.resolve().parent.name,
        "status": status,
        "word": word,
        "sentence": sentence,
        "rows": rows,
        "notes": notes,
        "facts": (Fact("Rounds", str(len(rows))), Fact("Bench time of all experiments", seconds)),
    }
    return write_page(path, "rounds.html.j2", page, title="Rounds of a closed loop")


def _experiment(item: Mapping[str, Any]) -> str:
    """Return what is run after a diagnosis; its own page says what it is worth."""
    if item["ending"] == "nothing_open":
        return "none needed"
    text = "; then ".join(item["trials"]) or "–"
    return text[:1].upper() + text[1:]


def _row(item: Mapping[str, Any]) -> RoundRow:
    right, seconds = item["probability_right"], item["bench_seconds"]
    asked = item["ending"] == "proposed"
    return RoundRow(
        item["round"],
        item["verdict"],
        ", ".join(item["effects"]) or "–",
        "; ".join(" / ".join(group) for group in item["equivalent"]) or "–",
        _experiment(item),
        "–" if right is None else f"{number(100.0 * right, 0)} %",
        "–" if not asked else f"{number(seconds, 2)} s",
        item["status"] or "–",
        f"{item['folder']}/diagnosis/diagnosis.html",
        f"{item['folder']}/next.html" if item["ending"] else "",
    )

"""Decision records are short, numbered once, and say what was decided and at what price."""

import re
from collections import Counter
from pathlib import Path

import pytest
from pages import ROOT

RECORDS = sorted((ROOT / "docs" / "decisions").glob("[0-9]*.md"))
MOST_WORDS = 300


def words(text: str) -> int:
    """The number of words, where a sign by itself (a table's bar, a dash) is none."""
    return sum(1 for piece in text.split() if re.search(r"\w", piece))


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.stem)
def test_a_record_is_short_and_says_what_was_decided(record: Path) -> None:
    text = record.read_text(encoding="utf-8")
    number = record.name[:4]
    assert text.startswith(f"# {number} "), f"{record.name} begins with another number"
    for part in ("**Context.**", "**Decision.**", "**Consequences.**"):
        assert part in text, f"{record.name} lacks {part}"
    assert words(text) <= MOST_WORDS, f"{record.name} has {words(text)} words"


def test_every_number_is_given_once() -> None:
    numbers = Counter(record.name[:4] for record in RECORDS)
    assert not [number for number, count in numbers.items() if count > 1]


def test_signs_alone_are_no_words() -> None:
    assert words("| a | b - c ≥ 3 |") == 4

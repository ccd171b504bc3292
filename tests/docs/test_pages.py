"""What the documentation shows is what happens: every page with commands is run."""

from pathlib import Path

import pytest
from pages import ROOT, Bench, blocks_of, differs

DOCS = ROOT / "docs"
PAGES = sorted(
    page
    for page in (DOCS / "tutorial.md", *(DOCS / "how-to").glob("*.md"))
    if any(block.language in ("sh", "python") and not block.title for block in blocks_of(page))
)
LONGEST = {"next": 28, "plant": 38, "tutorial": 27, "causes": 12}
"""About how many seconds a page takes by itself, of those that take long."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.slow(LONGEST.get(page.stem, 0))) for page in PAGES],
    ids=lambda page: page.stem,
)
def test_a_page_does_what_it_shows(page: Path, tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.run(page)
    assert bench.ran


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("a 1.00 s", "a 1.01 s", True),
        ("a 1.00 s", "a 1.05 s", False),
        ("a 1 s", "b 1 s", False),
        ("a\n...\nc", "a\nx\ny\nc", True),
        ("...\nc", "a\nc\nd", False),
        ("a\n...", "a\nb", True),
        ("a", "a\nb", False),
        ("a\nb", "a", False),
    ],
)
def test_outputs_are_compared_in_words_and_numbers(shown: str, printed: str, same: bool) -> None:
    assert (differs(shown, printed) == "") is same

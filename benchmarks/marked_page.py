"""Figures of a benchmark in a page of the documentation, between two marks."""

from pathlib import Path


def write_between(page: Path, marks: tuple[str, str], text: str) -> None:
    """Put a text into a page, between its marks.

    Raises:
        SystemExit: the page has none.
    """
    before, _, rest = page.read_text(encoding="utf-8").partition(marks[0])
    _, mark, after = rest.partition(marks[1])
    if not mark:
        raise SystemExit(f"{page} has no lines '{marks[0]}' and '{marks[1]}' to write between")
    whole = f"{before}{marks[0]}\n\n{text}\n\n{marks[1]}{after}"
    page.write_text(whole, encoding="utf-8")

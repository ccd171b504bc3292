"""The page of effects says what the code does."""

from pathlib import Path

from eha_bench.plants.catalogue import markdown


def test_page_of_effects_is_what_the_code_says(repository: Path) -> None:
    page = (repository / "docs" / "effects.md").read_text(encoding="utf-8")
    again = "write it anew: python -m eha_bench.plants.catalogue > docs/effects.md"
    assert page == markdown(), again


def test_page_names_every_parameter() -> None:
    page = markdown()
    for name in ("entrained_air", "learned", "`air_fraction`", "`values`", "0 × 24", "neutral 0"):
        assert name in page

"""Files and links that README and pages name are there; YAML that is shown is of a known kind."""

import re
from pathlib import Path

import pytest
from pages import ROOT, blocks_of
from ruamel.yaml import YAML

from eha_bench.core.file_kind import kinds

DOCS = ROOT / "docs"
TEXTS = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "examples/README.md")),
    *sorted(DOCS.glob("*.md")),
    *sorted(DOCS.glob("[!gs]*/*.md")),
]
MADE = ("gallery/", "../figures/")  # by `make docs`, which checks the links to them


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: str(page.relative_to(ROOT)))
def test_local_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" in link or link.startswith(("#", *MADE)):
            continue
        assert (page.parent / link.partition("#")[0]).exists(), f"{page.name} links to {link}"


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: str(page.relative_to(ROOT)))
def test_yaml_that_is_shown_is_yaml(page: Path) -> None:
    known = set().union(*(kind.keys for kind in kinds()))
    for block in blocks_of(page):
        if block.language != "yaml":
            continue
        content = YAML(typ="safe").load(block.text)
        if block.title and block.title != "workflow.yml":
            assert known & set(content), f"{page.name}:{block.line} is not a file of ours"


def test_every_command_of_the_readme_is_there() -> None:
    import typer

    from eha_bench.cli.app import app

    commands = set(getattr(typer.main.get_command(app), "commands", {}))
    named = set(re.findall(r"`eha-bench ([a-z-]+)", (ROOT / "README.md").read_text()))
    assert named
    assert named <= commands


def test_a_file_that_a_page_shows_is_named_in_any_renderer() -> None:
    """A fence's `title` shows on the site only: the name stands in a line before it as well."""
    for page in sorted((ROOT / "docs").rglob("*.md")):
        lines = page.read_text(encoding="utf-8").splitlines()
        for number, line in enumerate(lines):
            title = re.match(r'```\w+.*title="([^"]+)"', line)
            if title:
                before = next((text for text in reversed(lines[:number]) if text.strip()), "")
                assert f"`{title[1]}`" in before, f"{page.name}:{number + 1}"

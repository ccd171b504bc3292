"""The walks through the code that the documentation tells name what is there."""

import importlib
import re

import pytest
from pages import ROOT

PAGES = sorted((ROOT / "docs" / "explanation").glob("walk-*.md"))
NAMES = [
    (page.stem, name)
    for page in PAGES
    for name in sorted(set(re.findall(r"`(eha_bench\.[\w.]+)`", page.read_text("utf-8"))))
]


@pytest.mark.parametrize(("page", "name"), NAMES)
def test_every_hop_is_there(page: str, name: str) -> None:
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            found = getattr(found, part)
        return
    raise AssertionError(name)


@pytest.mark.parametrize("walk", ["walk-of-a-suite", "walk-of-a-residual"])
def test_every_walk_names_its_hops(walk: str) -> None:
    assert sum(page == walk for page, _ in NAMES) > 10

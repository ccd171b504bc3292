"""axe-core finds nothing serious on the page, in light and dark, wide and narrow."""

import gzip
import json
from pathlib import Path

import pytest
from chromium import Page

AXE = Path(__file__).parent / "vendor" / "axe.min.js.gz"


def serious(page: Page) -> list[str]:
    """Violations that axe-core calls serious or critical, with the elements they are found on."""
    page.run(gzip.decompress(AXE.read_bytes()).decode("utf-8") + ";0")
    found = json.loads(page.run("axe.run(document).then(r => JSON.stringify(r.violations))"))
    return [
        f"{item['id']}: {item['help']}: {[node['html'][:120] for node in item['nodes'][:3]]}"
        for item in found
        if item["impact"] in ("serious", "critical")
    ]


@pytest.mark.parametrize(
    ("width", "scheme"),
    [
        (1280, "light"),
        pytest.param(1280, "dark", marks=pytest.mark.slow),
        pytest.param(390, "light", marks=pytest.mark.slow),
        pytest.param(390, "dark", marks=pytest.mark.slow),
    ],
)
def test_no_serious_finding(tab: Page, page_file: Path, width: int, scheme: str) -> None:
    tab.emulate(width, scheme=scheme)
    tab.open(page_file, "#trial=pressure_step-20MPa&repeat=1")
    tab.wait("document.querySelector('.canvas[data-drawn]')")
    assert serious(tab) == []


@pytest.mark.slow
def test_axe_would_find_something(tab: Page, page_file: Path) -> None:
    tab.open(page_file)
    tab.run("document.querySelector('h1').insertAdjacentHTML('afterend', '<button></button>')")
    assert any(text.startswith("button-name") for text in serious(tab))

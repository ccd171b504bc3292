"""axe-core finds nothing serious on the page, in light and dark, wide and narrow."""

import gzip
import json
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from chromium import Page

import eha_bench as eb
from forked import Forked

sys.path.insert(0, str(Path(__file__).parents[1] / "comparison"))
sys.path.insert(0, str(Path(__file__).parents[2] / "docs" / "tools"))
import terminal
from results import folder, result

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


@pytest.fixture(scope="module")
def nights_and_comparison(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The pages of a history with a jump in it, and of a comparison."""
    nights = tmp_path_factory.mktemp("nights")
    first = datetime(2025, 1, 1, 2, tzinfo=UTC)
    for i in range(30):
        value = (1.0 + 0.001 * (i * 7 % 5)) * (1.2 if i >= 20 else 1.0)
        made = result([value], started=(first + timedelta(days=i)).isoformat(), revision=f"r{i}")
        folder(nights / f"night-{i:02d}", made)
        (nights / f"night-{i:02d}" / "report.html").write_text("a report", encoding="utf-8")
    eb.history(nights)
    sides = tmp_path_factory.mktemp("sides")
    for name, factor in (("a", 1.0), ("b", 1.1)):
        folder(sides / name, result([factor * (0.04 + 1e-5 * i) for i in range(5)]))
    eb.compare(sides / "a", sides / "b", out=sides)
    pages = [*nights.rglob("history/**/*.html"), sides / "comparison.html"]
    assert len(pages) == 3
    return pages


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_no_serious_finding_in_nights_and_comparisons(
    tab: Page, nights_and_comparison: list[Path], width: int, scheme: str
) -> None:
    tab.emulate(width, scheme=scheme)
    for page in nights_and_comparison:
        tab.open(page)
        assert serious(tab) == [], page.name


@pytest.fixture(scope="module")
def pages_of_the_loop(forked: Forked, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Every other page, as the commands write it in a new project."""
    work = tmp_path_factory.mktemp("project")
    for name, text in terminal.FILES.items():
        (work / name).write_text(text, encoding="utf-8")
    for words in (
        "init",
        "run suite.yaml --target target.yaml",
        "diagnose dataset.yaml --out diagnosis",
        *(terminal.COMMANDS[name].partition(" ")[2] for name in terminal.LOOP),
        "close dataset.yaml --target target.yaml --out loop --rounds 1",
    ):
        done = forked.run(*words.split(), folder=work)
        assert done.returncode in (0, 1), done.stderr
    pages = [
        "diagnosis/diagnosis.html", "swept/sweep.html", "tuned/tuning.html",
        "after/probability.html", "before_after.html", "loop/rounds.html",
        "loop/round-1/next.html",
    ]  # fmt: skip
    return [work / page for page in pages]


@pytest.mark.slow(16)
def test_no_serious_finding_in_the_pages_of_the_loop(
    tab: Page, pages_of_the_loop: list[Path]
) -> None:
    for width in (1280, 390):
        for scheme in ("light", "dark"):
            tab.emulate(width, scheme=scheme)
            for page in pages_of_the_loop:
                tab.open(page)
                assert serious(tab) == [], page.name
                wide = tab.run("document.documentElement.scrollWidth")
                assert wide <= width, f"{page.name} is {wide} px wide at {width}"


@pytest.mark.slow
def test_axe_would_find_something(tab: Page, page_file: Path) -> None:
    tab.open(page_file)
    tab.run("document.querySelector('h1').insertAdjacentHTML('afterend', '<button></button>')")
    assert any(text.startswith("button-name") for text in serious(tab))

"""The page of a sweep: true without scripts, quiet in a browser, and brushed."""

from pathlib import Path

import numpy as np
import pytest
from chromium import Page

from eha_bench.api import sweep
from eha_bench.report.sweep_plots import Axis, conflict, front

SUITE = {
    "name": "hold",
    "trials": [
        {
            "id": "step",
            "mode": "pressure",
            "setup": {"piston": "locked"},
            "duration": "60 ms",
            "signal": {"kind": "step", "initial": "0 MPa", "final": "10 MPa", "at": "1 ms"},
            "accept": {"tracking_rms": "<= 4.8 MPa", "peak": "<= 11 MPa"},
        }
    ],
}
OVER = {
    "over": {
        "gains": {
            "pressure.k_p": {"from": "2 A/MPa", "to": "14 A/MPa", "steps": 3, "scale": "log"},
            "pressure.k_2": ["0.5 A*s/rad", "2 A*s/rad"],
        }
    }
}


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("sweep")
    found = sweep(SUITE, OVER, "simulator", out / "out")
    return found.folder / "sweep.html"


def test_what_stands_there_without_scripts(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "of 6 points keep all limits" in text
    assert text.count("<circle") == 6
    assert "eha-bench sweep" in text


def test_the_page_is_quiet_and_a_brush_filters(tab: Page, page: Path) -> None:
    tab.open(page)
    tab.wait("document.querySelectorAll('#sweep-heat select').length === 3")
    assert tab.run("document.querySelectorAll('#sweep-points tbody tr').length") == 6
    paths = "document.querySelectorAll('#sweep-parallel path')"
    grey = f"[...{paths}].filter(e => e.getAttribute('stroke') === 'var(--grid)').length"
    assert tab.run(grey) == 0
    # from the middle of the first axis to its top: the upper two of three levels
    tab.run(
        "(() => { const handle = document.querySelector('#sweep-parallel rect[cursor]');"
        "const box = handle.getBoundingClientRect(), x = box.x + box.width / 2;"
        "const at = (kind, share, on) => on.dispatchEvent(new PointerEvent(kind,"
        "{bubbles: true, clientX: x, clientY: box.y + box.height * (1 - share)}));"
        "at('pointerdown', 0.4, handle); at('pointerup', 1, window); })()"
    )
    tab.wait("document.querySelectorAll('#sweep-points tbody tr').length === 4")
    assert tab.run(grey) == 2
    assert tab.run("document.getElementById('sweep-count').textContent").startswith("4 of 6 points")
    tab.run("document.querySelector('#sweep-parallel button').click()")
    tab.wait("document.querySelectorAll('#sweep-points tbody tr').length === 6")
    assert tab.complaints == []
    assert [url for url in tab.requests if not url.startswith("data:")] == [page.as_uri()]


def test_a_front_is_what_nothing_beats_in_both() -> None:
    first = np.array([1.0, 2.0, 3.0, 2.0, np.nan])
    second = np.array([3.0, 2.0, 1.0, 1.5, 9.0])
    assert front(first, second) == [0, 1, 2]


def test_limits_in_conflict_are_those_that_go_against_each_other() -> None:
    up = np.arange(5.0)
    assert conflict(np.stack([up, up**2, -up, np.ones(5)], axis=1)) in {(0, 2), (1, 2)}
    assert conflict(np.ones((4, 2))) is None


def test_many_levels_are_put_into_bins() -> None:
    axis = Axis("k", "", np.geomspace(1.0, 100.0, 60), log=True)
    places, names = axis.bins()
    assert len(names) == 12
    assert np.bincount(places).tolist() == [5] * 12

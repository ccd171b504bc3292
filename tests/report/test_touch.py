"""Fingers on the charts of a narrow screen: pinch, double tap, cursor."""

from pathlib import Path

import pytest
from chromium import Page
from test_browser import DRAWN, FIGURE, box, quiet

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")
RANGE = "location.hash.split('t=')[1] ?? ''"


@pytest.fixture
def phone(tab: Page, page_file: Path) -> Page:
    tab.emulate(390, 844)
    tab.send("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    tab.open(page_file, "#trial=pressure_step-15MPa")
    tab.wait(f"{DRAWN} > 0")
    return tab


def test_two_fingers_zoom_every_panel(phone: Page, page_file: Path) -> None:
    area = box(phone)
    y, at = area["y"] + area["height"] / 2, lambda share: area["x"] + share * area["width"]
    phone.touch("touchStart", (at(0.4), y), (at(0.6), y))
    for spread in (0.15, 0.2, 0.3):
        phone.touch("touchMove", (at(0.5 - spread), y), (at(0.5 + spread), y))
    phone.touch("touchEnd")
    phone.wait("location.hash.includes('t=')")
    start, stop = map(float, phone.run(RANGE).split(".."))
    # what lay under the fingers, 0.4 and 0.6 of -50 .. 599 ms, lies now at 0.2 and 0.8
    width = 0.649
    assert stop - start == pytest.approx(width / 3.0, rel=0.05)
    assert (start + stop) / 2 == pytest.approx(-0.05 + width / 2, abs=0.01)
    assert phone.run(f"{DRAWN} > 0")
    quiet(phone, page_file)


def test_a_double_tap_shows_the_whole(phone: Page, page_file: Path) -> None:
    phone.run("location.hash = '#trial=pressure_step-15MPa&t=0.02..0.08'")
    phone.wait(f"document.querySelector('{FIGURE} .permalink').hash.includes('t=')")
    area = box(phone)
    for _ in range(2):
        phone.touch("touchStart", (area["x"] + 100, area["y"] + 50))
        phone.touch("touchEnd")
    phone.wait(f"!document.querySelector('{FIGURE} .permalink').hash.includes('t=')")
    quiet(phone, page_file)


def test_one_finger_reads_values_out_and_leaves_the_zoom(phone: Page, page_file: Path) -> None:
    area = box(phone)
    y = area["y"] + area["height"] / 2
    phone.touch("touchStart", (area["x"] + 60, y))
    for x in (80, 110, 140):
        phone.touch("touchMove", (area["x"] + x, y))
    phone.touch("touchEnd")
    when = phone.run(f"document.querySelector('{FIGURE} .when').textContent")
    assert when.startswith("t = ")
    assert "t=" not in phone.run("location.hash").split("trial=")[1]
    quiet(phone, page_file)

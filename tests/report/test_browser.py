"""The page in a real browser: quiet, offline, usable by mouse, keyboard, link, without scripts."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chromium import Browser, Page
from sample_run import NASTY, SampleRun

from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.report import write_report

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")

FIGURE = '.figure[data-trial="pressure_step-15MPa"]'
DRAWN = f"document.querySelectorAll('{FIGURE} .canvas[data-drawn]').length"


def ticks(page: Page) -> str:
    """What the readings of the first run's charts say."""
    return page.run(
        f"[...document.querySelectorAll('{FIGURE} .reading')].map(e => e.textContent).join('|')"
    )


def box(page: Page) -> dict[str, float]:
    """The plotting area of the first panel of the first run."""
    return page.run(
        f"(() => {{ const e = document.querySelector('{FIGURE} .u-over'); e.scrollIntoView({{block:"
        "'center'}); const r = e.getBoundingClientRect();"
        "return {x: r.x, y: r.y, width: r.width, height: r.height}; })()"
    )


def opened(tab: Page, path: Path) -> Page:
    tab.open(path, "#trial=pressure_step-15MPa")
    tab.wait(f"{DRAWN} === 4")
    return tab


def quiet(page: Page, path: Path) -> None:
    assert page.complaints == []
    assert [url for url in page.requests if not url.startswith("data:")] == [path.as_uri()]


def test_no_complaint_and_no_request(tab: Page, page_file: Path) -> None:
    tab.open(page_file)
    height = tab.run("document.documentElement.scrollHeight")
    for top in range(0, int(height), 700):
        tab.run(f"scrollTo(0, {top})")
        tab.run("new Promise(done => setTimeout(done, 30))")
    tab.wait("document.querySelectorAll('.canvas[data-drawn]').length > 0")
    quiet(tab, page_file)


def test_the_policy_stops_what_comes_from_outside(tab: Page, page_file: Path) -> None:
    tab.open(page_file)
    tab.run(
        """(() => {
          const image = new Image(); image.src = 'https://example.org/x.png';
          document.body.append(image);
          const script = document.createElement('script'); script.textContent = 'window.ran = 1';
          document.body.append(script);
        })()"""
    )
    assert tab.run("fetch('https://example.org/').then(() => 'came', () => 'stopped')") == "stopped"
    assert tab.run("typeof window.ran") == "undefined"
    assert sum("Content Security Policy" in text for text in tab.complaints) >= 3


SHOWN = "[...document.querySelectorAll('.canvas')].filter(canvas => canvas.checkVisibility())"


def test_charts_of_what_is_open_are_drawn_where_nobody_scrolls(tab: Page, page_file: Path) -> None:
    tab.open(page_file)
    tab.wait(f"{SHOWN}.length > 4 && {SHOWN}.every(canvas => canvas.dataset.drawn !== undefined)")
    tab.run("window.one = document.getElementById('trial=pressure_step-15MPa'); one.open = false")
    tab.wait("one.querySelectorAll('.canvas[data-drawn]').length === 0")
    assert tab.run("one.querySelectorAll('.spark path').length") == 2
    tab.run("one.open = true")
    tab.wait("one.querySelectorAll('.canvas[data-drawn]').length > 0")
    quiet(tab, page_file)


def test_the_filter_shows_some_trials_and_a_link_brings_back_one(
    tab: Page, page_file: Path
) -> None:
    tab.open(page_file)
    there = "[...document.querySelectorAll('details.trial')].filter(trial => !trial.hidden)"
    every = tab.run(f"{there}.length")
    tab.run("document.querySelector('[data-show=failed]').click()")
    failed = tab.run(f"{there}.map(trial => trial.dataset.group).join()")
    assert set(failed.split(",")) == {"failed"}
    assert 0 < len(failed.split(",")) < every
    tab.run("location.hash = '#trial=pressure_step-15MPa'")
    tab.wait("document.getElementById('trial=pressure_step-15MPa').open")
    assert tab.run(f"{there}.length") == every
    tab.run(
        "(() => { const jump = document.querySelector('.jump select');"
        " jump.value = 'trial=knee_sine-1Hz'; jump.dispatchEvent(new Event('change')); })()"
    )
    assert tab.run(f"{there}.map(trial => trial.id).join()") == "trial=knee_sine-1Hz"
    tab.run("document.querySelector('[data-show=all]').click()")
    tab.run("document.querySelector('[data-fold=open]').click()")
    assert tab.run("document.querySelectorAll('details.trial:not([open])').length") == 0
    tab.run("scrollTo(0, document.body.scrollHeight / 2)")
    assert tab.run("document.querySelector('.contents').getBoundingClientRect().top") == 0
    quiet(tab, page_file)


def test_charts_are_saved_as_a_picture_and_a_table(
    tab: Page, page_file: Path, sample: SampleRun
) -> None:
    opened(tab, page_file)
    tab.run(
        "window.saved = []; URL.createObjectURL = (blob) => (saved.push(blob), 'blob:none');"
        "HTMLAnchorElement.prototype.click = function () { saved.push(this.download); }"
    )
    for name in ("PNG", "CSV"):
        tab.run(
            f"[...document.querySelectorAll('{FIGURE} .tool')]"
            f".find(tool => tool.textContent === '{name}').click()"
        )
    tab.wait("saved.length === 4")
    assert set(tab.run("saved.filter(item => typeof item === 'string')")) == {
        "pressure_step-15MPa.png", "pressure_step-15MPa.csv",
    }  # fmt: skip
    assert tab.run("saved.find(item => item.type === 'image/png').size") > 5000
    table = tab.run("saved.find(item => item.type === 'text/csv').text()").splitlines()
    recording = sample.recordings[("pressure_step-15MPa", 0)]()
    names = table[0].split(",")
    assert names[0] == "time / s"
    assert len(table) == len(recording) + 1
    place = names.index("pressure_difference / MPa")
    found = np.array([float(line.split(",")[place]) for line in table[1:]])
    assert found == pytest.approx(1e-6 * recording["pressure_difference"], abs=1e-3)
    quiet(tab, page_file)


def test_drag_zooms_every_panel_and_a_double_click_shows_the_whole(
    tab: Page, page_file: Path
) -> None:
    opened(tab, page_file)
    area = box(tab)
    y = area["y"] + area["height"] / 2
    # the axis runs from -50 to 599 ms
    tab.drag((area["x"] + area["width"] * 0.1, y), (area["x"] + area["width"] * 0.3, y))
    tab.wait("location.hash.includes('t=')")
    start, stop = map(float, tab.run("location.hash.split('t=')[1]").split(".."))
    assert start == pytest.approx(-0.05 + 0.1 * 0.649, abs=0.01)
    assert stop == pytest.approx(-0.05 + 0.3 * 0.649, abs=0.01)
    link = tab.run(f"document.querySelector('{FIGURE} .permalink').getAttribute('href')")
    assert link == tab.run("location.hash")
    for kind in ("mousePressed", "mouseReleased") * 2:
        count = 2 if tab.run("window.again = (window.again ?? 0) + 1") > 2 else 1
        tab.mouse(kind, area["x"] + 200, y, button="left", clickCount=count)
    tab.wait("!location.hash.includes('t=')")
    quiet(tab, page_file)


def test_a_link_opens_a_trial_and_a_stretch_of_time(tab: Page, page_file: Path) -> None:
    tab.open(page_file, "#trial=pressure_step-30MPa&t=0.02..0.08")
    figure = '.figure[data-trial="pressure_step-30MPa"]'
    tab.wait(f"document.querySelectorAll('{figure} .canvas[data-drawn]').length >= 1")
    top = tab.run(f"document.querySelector('{figure}').getBoundingClientRect().top")
    assert abs(top) < 200
    href = tab.run(f"document.querySelector('{figure} .permalink').getAttribute('href')")
    assert href == "#trial=pressure_step-30MPa&t=0.02..0.08"


def test_a_link_opens_a_repeat(tab: Page, page_file: Path) -> None:
    tab.open(page_file)
    assert tab.run("document.querySelectorAll('details.repeat-details[open]').length") == 0
    tab.run("location.hash = '#trial=pressure_step-20MPa&repeat=2&t=0.02..0.08'")
    tab.wait("document.querySelectorAll('details.repeat-details[open]').length === 1")
    tab.wait("document.querySelectorAll('details[open] .canvas[data-drawn]').length >= 1")


@pytest.mark.parametrize(
    "fragment",
    ["#trial=no%20such&t=1..2", "#trial=%E0%A4%A", "#t=..", "#trial=pressure_step-15MPa&t=5..1"],
)
def test_a_wrong_link_does_no_harm(tab: Page, page_file: Path, fragment: str) -> None:
    tab.open(page_file, fragment)
    tab.run("scrollTo(0, 0)")
    assert tab.complaints == []


def test_the_keyboard_moves_the_cursor_and_zooms(tab: Page, page_file: Path) -> None:
    opened(tab, page_file)
    tab.run(f"document.querySelector('{FIGURE} .charts').focus()")
    tab.key("ArrowRight")
    when = f"document.querySelector('{FIGURE} .when').textContent"
    first, reading = tab.run(when), ticks(tab)
    assert first.startswith("t = 2")  # one per cent right of the middle, 281 ms
    assert all(part for part in reading.split("|"))
    tab.key("ArrowLeft")
    assert tab.run(when) != first
    said = tab.run(f"document.querySelector('{FIGURE} [role=status]').textContent")
    assert "Pressure difference" in said
    assert "MPa" in said
    tab.key("+")
    tab.wait("location.hash.includes('t=')")
    tab.key("0")
    tab.wait("!location.hash.includes('t=')")
    quiet(tab, page_file)


def test_every_control_is_reached_by_tab(tab: Page, page_file: Path) -> None:
    opened(tab, page_file)
    unreachable = tab.run(
        "[...document.querySelectorAll('button, a[href], summary, .charts')]"
        ".filter(e => e.tabIndex < 0).length"
    )
    unnamed = tab.run(
        "[...document.querySelectorAll('button')]"
        ".filter(e => !(e.getAttribute('aria-label') || e.textContent).trim()).length"
    )
    assert (unreachable, unnamed) == (0, 0)


def test_a_channel_can_be_hidden(tab: Page, page_file: Path) -> None:
    opened(tab, page_file)
    toggle = f"document.querySelector('{FIGURE} .toggle')"
    assert tab.run(f"{toggle}.getAttribute('aria-pressed')") == "true"
    tab.run(f"{toggle}.click()")
    assert tab.run(f"{toggle}.getAttribute('aria-pressed')") == "false"
    tab.run(f"{toggle}.click()")
    assert tab.run(f"{toggle}.getAttribute('aria-pressed')") == "true"
    quiet(tab, page_file)


def test_what_is_read_out_is_what_was_recorded(
    tab: Page, page_file: Path, sample: SampleRun
) -> None:
    opened(tab, page_file)
    found = tab.run(
        f"""(async () => {{
          const figure = document.querySelector('{FIGURE}');
          const scene = JSON.parse(figure.querySelector('script.scene').textContent);
          const {{time, full}} = await unpack.clock(scene.clock);
          const curves = {{}};
          for (const panel of scene.panels) for (const trace of panel.traces) {{
            const values = await unpack.curve(
              document.getElementById(`${{figure.dataset.key}}-curve-${{trace.curve}}`).textContent,
              trace.middle, trace.step);
            curves[trace.channel] = Array.from(values);
          }}
          return JSON.stringify({{time: Array.from(time), full: Array.from(full), curves}});
        }})()"""
    )
    data = json.loads(found)
    recording = sample.recordings[("pressure_step-15MPa", 0)]()
    assert data["time"] == pytest.approx(recording.time.tolist(), abs=1e-9)
    assert set(data["full"]) == {1}
    for name, factor in (("pressure_a", 1e-6), ("current", 1.0), ("motor_speed", 30 / np.pi)):
        values = recording[name] * factor
        step = np.ptp(values) / 65534
        assert np.max(np.abs(np.array(data["curves"][name]) - values)) <= 0.51 * step


def test_a_broken_language_does_no_harm(browser: Browser, page_file: Path) -> None:
    for broken in (
        "Object.defineProperty(Navigator.prototype, 'language', {get: () => 'no_such@language'})",
        "Object.defineProperty(navigator, 'language', {value: 'x', configurable: false})",
        "Object.defineProperty(Navigator.prototype, 'language', {get: () => undefined})",
    ):
        page = browser.page(broken)
        opened(page, page_file)
        quiet(page, page_file)
        page.close()


def test_a_name_that_is_a_script_is_text(tab: Page, tmp_path: Path) -> None:
    time = np.arange(400) / 1000.0
    recording = Recording(time, {NASTY: np.sin(20 * time)}, units={NASTY: NASTY})
    run = TrialResult(NASTY, 0, Status.PASSED, NASTY, NASTY, (), NASTY, (NASTY,))
    result = Result(NASTY, NASTY, Status.PASSED, (run,), {NASTY: NASTY}, NASTY)
    path = write_report(tmp_path, result, {(NASTY, 0): lambda: recording}, {})
    tab.open(path)
    tab.run("document.querySelector('.figure').scrollIntoView()")
    tab.wait("document.querySelector('.canvas[data-drawn]')")
    assert tab.run("document.querySelector('h1').textContent") == NASTY
    assert tab.run("document.querySelector('.panel-name').textContent") == f"{NASTY} / {NASTY}"
    quiet(tab, path)


def test_it_reads_without_javascript(tab: Page, page_file: Path) -> None:
    tab.send("Emulation.setScriptExecutionDisabled", value=True)
    tab.open(page_file)
    root = tab.send("DOM.getDocument")["root"]["nodeId"]
    found = tab.send("DOM.querySelector", nodeId=root, selector=f"{FIGURE} .plot svg")["nodeId"]
    model = tab.send("DOM.getBoxModel", nodeId=found)["model"]
    assert model["width"] > 600
    assert model["height"] > 300
    charts = tab.send("DOM.querySelectorAll", nodeId=root, selector=".charts")["nodeIds"]
    assert charts == []


def test_it_prints_the_static_plots(tab: Page, page_file: Path, tmp_path: Path) -> None:
    opened(tab, page_file)
    tab.emulate(800, media="print", scheme="dark")
    style = "getComputedStyle(document.querySelector('{}'))"
    assert tab.run(style.format(f"{FIGURE} .charts") + ".display") == "none"
    assert tab.run(style.format(f"{FIGURE} .plot") + ".display") == "block"
    assert tab.run(style.format("body") + ".backgroundColor") == "rgb(255, 255, 255)"
    tab.pdf(tmp_path / "report.pdf")
    assert (tmp_path / "report.pdf").stat().st_size > 20_000


@pytest.mark.parametrize(
    ("width", "media"), [(1280, ""), (1000, ""), (760, ""), (390, ""), (320, ""), (718, "print")]
)
def test_nothing_sticks_out_sideways(tab: Page, page_file: Path, width: int, media: str) -> None:
    tab.emulate(width, media=media)
    tab.open(page_file)
    assert tab.run("document.documentElement.scrollWidth") <= width
    clipped = tab.run(
        "[...document.querySelectorAll('td, th, p, h1, h2, dd')].filter(e => e.offsetWidth > 1 &&"
        f" e.getBoundingClientRect().right > {width} + 1).map(e => e.textContent.slice(0, 40))"
    )
    assert clipped == []


def test_dark_and_light_differ(tab: Page, page_file: Path) -> None:
    colours = []
    for scheme in ("light", "dark"):
        tab.emulate(1280, scheme=scheme)
        opened(tab, page_file)
        colours.append(tab.run("getComputedStyle(document.body).backgroundColor"))
    assert colours == ["rgb(244, 246, 248)", "rgb(14, 18, 22)"]
    tab.emulate(1280, scheme="light")
    tab.wait(f"{DRAWN} === 4")
    assert tab.complaints == []


def test_long_recordings_keep_every_sample_around_the_edge(
    tab: Page, tmp_path: Path, sample: SampleRun
) -> None:
    trial = sample.trials["pressure_step-15MPa"]
    run = sample.result.trials[0]
    rng = np.random.default_rng(3)
    time = np.arange(100_000) / 1000.0
    values = 15e6 * (time > 50.0) + 1e4 * rng.standard_normal(time.size)
    values[20_000] = 40e6
    trial = replace(
        trial, duration=100.0, signal=replace(trial.signal, at=50.0, length=100.0), settle=0.0
    )
    recording = Recording(
        time,
        {"pressure_difference": values, "reference": trial.reference(time)},
        metadata={"signal_start": "0.0"},
    )
    path = write_report(tmp_path, replace(sample.result, trials=(run,)),
                        {(run.id, 0): lambda: recording}, {run.id: trial})  # fmt: skip
    assert path.stat().st_size < 400_000
    tab.open(path, f"#trial={run.id}")
    tab.wait("document.querySelector('.canvas[data-drawn]')")
    data = json.loads(
        tab.run(
            """(async () => {
              const scene = JSON.parse(document.querySelector('script.scene').textContent);
              const trace = scene.panels[0].traces[1];
              const key = document.querySelector('.figure').dataset.key;
              const packed = document.getElementById(`${key}-curve-${trace.curve}`).textContent;
              const {time, full} = await unpack.clock(scene.clock);
              const values = await unpack.curve(packed, trace.middle, trace.step);
              return JSON.stringify({time: Array.from(time), full: Array.from(full),
                                     values: Array.from(values)});
            })()"""
        )
    )
    stored, full = np.array(data["time"]), np.array(data["full"])
    assert np.all(np.diff(stored) > 0)
    near = (stored >= 49.99) & (stored <= 50.2)
    assert np.all(full[near] == 1)
    assert near.sum() == pytest.approx(211, abs=2)
    assert max(data["values"]) == pytest.approx(40.0, abs=0.01)
    assert stored.size < 12_000
    quiet(tab, path)

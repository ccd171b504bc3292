"""Static plots: small, deterministic, with own ids, in the page's colours."""

import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from sample_run import NASTY, SampleRun

from eha_bench.core.recording import Recording
from eha_bench.report.embed_svg import SHADES
from eha_bench.report.panels import panels_of
from eha_bench.report.scene import Scene, scene_of
from eha_bench.report.scene_figure import scene_svg


def draw(sample: SampleRun, key: str = "k", points: int = 2000) -> str:
    run = sample.result.trials[0]
    trial = sample.trials[run.id]
    recording = sample.recordings[(run.id, 0)]()
    return str(scene_svg(scene_of(recording, run, trial), key=key, title="t", points=points))


def test_equal_input_gives_equal_text(sample: SampleRun) -> None:
    assert draw(sample) == draw(sample)


def test_a_figure_is_xml_without_style_and_with_own_ids(sample: SampleRun) -> None:
    svg = draw(sample, "fig-7")
    root = ET.fromstring(svg)
    assert "style" not in {name for element in root.iter() for name in element.attrib}
    assert "<style" not in svg
    ids = [element.get("id") for element in root.iter() if element.get("id")]
    assert len(ids) == len(set(ids))
    assert all(name.startswith("fig-7-") for name in ids)
    for reference in re.findall(r"url\(#([^)]+)\)|href=\"#([^\"]+)\"", svg):
        assert (reference[0] or reference[1]) in ids


def test_every_colour_is_the_pages(sample: SampleRun) -> None:
    svg = draw(sample)
    assert not re.search(r"#[0-9a-fA-F]{6}\b", svg)
    assert set(re.findall(r"var\(--(\w+)\)", svg)) <= set(SHADES)
    assert "var(--limit)" in svg
    assert "var(--good)" in svg


def test_labels_of_levels_and_limits_are_there(sample: SampleRun) -> None:
    svg = draw(sample)
    for text in (
        "response time 39 ms ± 6 %",
        "holding current 11 A ± 6 %",
        "overshoot ≤ 35 %",
        "Pressure difference / MPa",
        "Motor speed / rpm",
        "Chamber pressures / MPa",
        "time / ms",
    ):
        assert text in svg.replace("\u00a0", " ")


@pytest.mark.parametrize("name", [NASTY, "$x^2$", "a_b", "温度", "x y & <b>"])
def test_a_channels_name_is_text(name: str) -> None:
    time = np.arange(50) / 1000.0
    recording = Recording(time, {name: np.sin(time)})
    svg = str(scene_svg(Scene(recording, panels_of(recording)), key="k", title=name))
    texts = [element.text for element in ET.fromstring(svg).iter() if element.text]
    assert name in texts
    assert "<script" not in svg


def test_size_follows_the_points_not_the_samples() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(100_000) / 1000.0
    recording = Recording(time, {"pressure_a": 1e6 * rng.standard_normal(time.size)})
    svg = scene_svg(Scene(recording, panels_of(recording)), key="k", title="t", points=2000)
    assert len(svg) < 30_000


def test_gaps_stay_gaps() -> None:
    time = np.arange(300) / 1000.0
    values = np.sin(20 * time)
    values[100:150] = np.nan
    recording = Recording(time, {"force": values})
    svg = str(scene_svg(Scene(recording, panels_of(recording)), key="k", title="t"))
    curve = next(d for d in re.findall(r' d="([^"]*)"', svg) if d.count("l") > 100)
    assert curve.count("M") == 2

"""Recordings as they come: gaps, infinities, huge numbers, hardly any samples, uneven clocks."""

import base64
import itertools
import json
import math
import zlib
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from sample_run import SampleRun

from eha_bench.core.recording import Recording
from eha_bench.core.result import Status, TrialResult
from eha_bench.report.charts import chart_data
from eha_bench.report.figure_view import figure_of
from eha_bench.report.packing import FULL, packed_clock, packed_curve, stretches
from eha_bench.report.scene import scene_of

RUN = TrialResult("odd", 0, Status.PASSED, "", "")


def unpacked(curve: dict) -> np.ndarray:
    """What charts.js makes of a packed curve."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(curve["data"])), np.uint8)
    low, high = planes.reshape(2, -1).astype(np.int64)
    levels = np.cumsum(low + 256 * high).astype(np.uint16).view(np.int16)
    values = curve["middle"] + curve["step"] * levels
    return np.where(levels == -32768, np.nan, values)


def clock_of(entries: list[dict]) -> np.ndarray:
    parts = []
    for entry in entries:
        if "packed" in entry:
            planes = np.frombuffer(zlib.decompress(base64.b64decode(entry["packed"])), np.uint8)
            steps = planes.reshape(4, -1).T.copy().view("<u4").ravel()
            ticks = np.cumsum(steps.astype(np.uint64))
            parts.append(entry["start"] + ticks / 0xFFFFFFFF * entry["span"])
        else:
            parts.append(entry["start"] + entry["period"] * np.arange(entry["n"]))
    return np.concatenate(parts)


@settings(max_examples=25)
@given(
    arrays(
        np.float64,
        st.integers(2, 60),
        elements=st.sampled_from([0.0, 1.0, -1e300, 1e300, 1e-300, math.nan, math.inf, -math.inf]),
    )
)
def test_any_values_are_drawn(values: np.ndarray) -> None:
    recording = Recording(np.arange(values.size) / 10.0, {"force": values, "mine": values})
    scene = scene_of(recording, RUN, None)
    if not np.isfinite(values).any():
        assert scene.panels == ()
        return
    view = figure_of(scene, key="k", title="t")
    ET.fromstring(view.svg)
    json.dumps(view.data.scene, allow_nan=False)


@pytest.mark.parametrize("samples", [0, 1])
def test_hardly_any_samples_are_no_plot(samples: int) -> None:
    recording = Recording(np.arange(samples, dtype=float), {"force": np.zeros(samples)})
    assert scene_of(recording, RUN, None).panels == ()


def test_a_recording_without_the_trials_reference_is_drawn_unmarked(sample: SampleRun) -> None:
    run = sample.result.trials[0]
    time = np.arange(100) / 100.0
    recording = Recording(time, {"pressure_a": time})
    scene = scene_of(recording, run, sample.trials[run.id])
    assert scene.marks == ()
    assert scene.panels[0].channels == ("pressure_a",)


@given(
    arrays(
        np.float64,
        st.integers(1, 300),
        elements=st.one_of(st.floats(-1e9, 1e9, allow_subnormal=False), st.just(math.nan)),
    )
)
def test_packed_values_come_back_to_half_a_level(values: np.ndarray) -> None:
    parts = stretches(np.arange(values.size, dtype=float), ())
    found = unpacked(packed_curve(values, parts))
    finite = np.isfinite(values)
    assert np.array_equal(np.isfinite(found), finite)
    if finite.any():
        level = np.ptp(values[finite]) / 65534
        tolerance = 0.5 * level * 1.001 + 1e-6 * np.max(np.abs(values[finite])) * 1e-6
        assert np.max(np.abs(found[finite] - values[finite])) <= tolerance


@given(arrays(np.float64, st.integers(3, 200), elements=st.floats(1e-4, 2.0)))
def test_uneven_clocks_come_back(steps: np.ndarray) -> None:
    time = np.cumsum(steps) - 3.0
    found = clock_of(packed_clock(time, stretches(time, ())))
    assert found == pytest.approx(time, abs=0.02 * float(np.mean(steps)) + 1e-6)


@settings(max_examples=20)
@given(
    st.integers(FULL + 1, 60_000),
    st.lists(st.floats(-1.0, 70.0), max_size=300),
    st.integers(0, 59_000),
)
def test_long_recordings_keep_order_extremes_and_events(
    count: int, events: list[float], spike: int
) -> None:
    time = np.arange(count) / 1000.0
    values = np.zeros(count)
    values[spike % count] = 1.0
    parts = stretches(time, events)
    assert parts[0].start == 0
    assert parts[-1].stop == count
    assert all(a.stop == b.start for a, b in itertools.pairwise(parts))
    stored = np.concatenate([part.times(time) for part in parts])
    assert np.all(np.diff(stored) > 0)
    assert stored.size < 2 * FULL + 10_000
    found = unpacked(packed_curve(values, parts))
    assert found.max() == pytest.approx(1.0, abs=1e-4)
    full = [part for part in parts if part.group == 1]
    for event in sorted(events)[:100]:
        place = int(np.searchsorted(time, event))
        if 0 < place < count:
            assert any(part.start <= place < part.stop for part in full)


def test_an_envelope_says_that_it_is_one() -> None:
    time = np.arange(20_000) / 1000.0
    entries = packed_clock(time, stretches(time, [10.0]))
    assert [entry["envelope"] for entry in entries] == [True, False, True]
    assert all("packed" not in entry for entry in entries)


def test_chart_data_names_the_display_units(sample: SampleRun) -> None:
    run = sample.result.trials[0]
    scene = scene_of(sample.recordings[(run.id, 0)](), run, sample.trials[run.id])
    data = chart_data(scene).scene
    assert [panel["unit"] for panel in data["panels"]] == ["MPa", "A", "rpm", "MPa"]
    kinds = {mark["kind"] for mark in data["panels"][0]["marks"]}
    assert kinds >= {"TimeBand", "ValueBand", "TimeLine", "Point", "LevelLine"}
    band = next(mark for mark in data["panels"][0]["marks"] if mark["kind"] == "ValueBand")
    assert band["high"] - band["low"] == pytest.approx(0.04 * 15.4, rel=0.05)

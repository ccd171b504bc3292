"""Topics of different rates onto one clock: how, and what is said about it."""

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from eha_bench import recordings
from eha_bench.core.errors import RecordingError
from eha_bench.recordings.align import align
from eha_bench.recordings.channel_map import load_channel_map
from eha_bench.recordings.track import Track

MS = 1_000_000


def mapping(*names: str, **options: Any) -> dict[str, Any]:
    """A map with one Float64 topic a channel."""
    known = {"pressure_a": "Pa", "current": "A", "current_command": "A", "oil_temperature": "K"}
    return {
        **options,
        "channels": {
            name: {"topic": f"/{name}", "field": "data", "unit": known.get(name, "V")}
            for name in names
        },
    }


def rows(stamps: Any, values: Any) -> list[tuple[int, float]]:
    return [(int(stamp), float(value)) for stamp, value in zip(stamps, values, strict=True)]


def test_equal_stamps_are_never_interpolated(float_log: Any) -> None:
    stamps = np.cumsum(np.random.default_rng(0).integers(MS // 2, 2 * MS, 500))
    left, right = np.random.default_rng(1).normal(size=(2, 500)) * 1e-3
    path = float_log({"/pressure_a": rows(stamps, left), "/current": rows(stamps, right)})
    back = recordings.read(path, channels=mapping("pressure_a", "current"))
    assert back["pressure_a"].tolist() == left.tolist()
    assert back["current"].tolist() == right.tolist()
    assert back.time[0] == 0.0
    assert not any("interpolated" in note for note in back.notes)
    assert back.resampled == frozenset()


def test_a_slow_measurement_is_interpolated_and_a_command_held(float_log: Any) -> None:
    fast = np.arange(1000) * MS
    slow = np.arange(0, 1000, 10) * MS
    events = np.array([0, 200, 700]) * MS
    path = float_log(
        {
            "/pressure_a": rows(fast, fast),
            "/oil_temperature": rows(slow, 3.0 * slow),
            "/current_command": rows(events, [1.0, 2.0, 3.0]),
        }
    )
    back = recordings.read(
        path, channels=mapping("pressure_a", "oil_temperature", "current_command")
    )
    assert back.time[-1] == pytest.approx(0.990)
    assert back.resampled == {"oil_temperature", "current_command"}
    assert np.allclose(back["oil_temperature"], 3.0 * back["pressure_a"], rtol=1e-12)
    command = back["current_command"]
    assert set(command) == {1.0, 2.0, 3.0}
    assert command[np.searchsorted(back.time, 0.2)] == 2.0
    assert command[np.searchsorted(back.time, 0.2) - 1] == 1.0
    assert command[-1] == 3.0
    text = " ".join(back.notes)
    assert "oil_temperature interpolated linearly" in text
    assert "current_command held" in text
    assert "cut to the time that all topics cover: 0.009 s at the end" in text


def test_a_command_stamped_just_after_its_tick_belongs_to_it(float_log: Any) -> None:
    ticks = np.arange(200) * MS
    path = float_log(
        {
            "/pressure_a": rows(ticks, ticks),
            "/current_command": rows(ticks + 5000, np.arange(200.0)),
        }
    )
    back = recordings.read(path, channels=mapping("pressure_a", "current_command"))
    assert back["current_command"].tolist() == list(range(200))


def test_nothing_is_extrapolated(float_log: Any) -> None:
    fast = np.arange(100) * MS
    path = float_log({"/pressure_a": rows(fast, fast), "/current": rows(fast[20:60:5], np.ones(8))})
    common = recordings.read(path, channels=mapping("pressure_a", "current"))
    assert common["pressure_a"][0] == 20 * MS
    assert np.isfinite(common["current"]).all()
    whole = recordings.read(path, channels=mapping("pressure_a", "current", range="all"))
    assert len(whole) == 100
    assert np.isnan(whole["current"][:20]).all()
    assert np.isfinite(whole["current"][20:56]).all()
    assert np.isnan(whole["current"][56:]).all()
    assert any("not finite, first at 0 s" in note for note in whole.notes)


def test_no_common_time_is_an_error(float_log: Any) -> None:
    path = float_log(
        {
            "/pressure_a": rows(np.arange(10) * MS, range(10)),
            "/current": rows(np.arange(100, 110) * MS, range(10)),
        }
    )
    with pytest.raises(RecordingError, match="no time in common"):
        recordings.read(path, channels=mapping("pressure_a", "current"))


def test_the_base_can_be_chosen(float_log: Any) -> None:
    path = float_log(
        {
            "/pressure_a": rows(np.arange(100) * MS, range(100)),
            "/current": rows(np.arange(0, 100, 10) * MS, range(10)),
        }
    )
    names = ("pressure_a", "current")
    assert len(recordings.read(path, channels=mapping(*names))) == 91
    slow = recordings.read(path, channels=mapping(*names, base="current"))
    assert slow["current"].tolist() == list(range(10))
    assert slow["pressure_a"].tolist() == list(range(0, 100, 10))


def test_gaps_are_reported_and_not_bridged(float_log: Any) -> None:
    fast = np.arange(400) * MS
    slow = np.concatenate([np.arange(0, 100, 2), np.arange(200, 400, 2)]) * MS
    holed = np.delete(fast, slice(300, 310))
    path = float_log({"/pressure_a": rows(holed, holed), "/current": rows(slow, slow)})
    names = ("pressure_a", "current")
    back = recordings.read(path, channels=mapping(*names))
    text = " ".join(back.notes)
    assert "topic '/pressure_a': 1 gap in time, the longest 0.011 s after 0.299 s" in text
    assert "topic '/current': 1 gap in time, the longest 0.102 s after 0.098 s" in text
    inside = (back.time > 0.0985) & (back.time < 0.1995)
    assert np.isnan(back["current"][inside]).all()
    assert np.isfinite(back["current"][~inside]).all()
    filled = recordings.read(path, channels=mapping(*names, repair={"gaps": "interpolate"}))
    assert np.allclose(filled["current"], filled["pressure_a"])


def test_duplicates_need_a_word_in_the_map(float_log: Any) -> None:
    stamps = np.array([0, 1, 2, 2, 3, 4]) * MS
    path = float_log({"/current": rows(stamps, range(6))})
    with pytest.raises(RecordingError, match=r"1 samples repeat.*0\.002 s.*duplicates"):
        recordings.read(path, channels=mapping("current"))
    for keep, expected in (("first", [0, 1, 2, 4, 5]), ("last", [0, 1, 3, 4, 5])):
        back = recordings.read(path, channels=mapping("current", repair={"duplicates": keep}))
        assert back["current"].tolist() == expected
        assert any(f"the {keep} of each was kept" in note for note in back.notes)


def test_steps_back_need_a_word_in_the_map(typed_log: Any, stamped: str) -> None:
    seconds = [0, 1, 2, 5, 3, 4, 6]
    path = typed_log(
        "/s",
        "rig/msg/Stamped",
        stamped,
        [
            (k * MS, {"header": {"stamp": {"sec": s, "nanosec": 7}, "frame_id": ""}, "value": s})
            for k, s in enumerate(seconds)
        ],
    )
    entry = {"current": {"topic": "/s", "field": "value", "unit": "A"}}
    by_log = recordings.read(path, channels={"channels": entry})
    assert by_log["current"].tolist() == seconds
    header = {"clock": "header", "channels": entry}
    with pytest.raises(RecordingError, match=r"once the time steps back, first at 3 s by 2 s"):
        recordings.read(path, channels=header)
    sort = recordings.read(path, channels={**header, "repair": {"steps_back": "sort"}})
    assert sort["current"].tolist() == sorted(seconds)
    assert sort.epoch_ns == 7
    drop = recordings.read(path, channels={**header, "repair": {"steps_back": "drop"}})
    assert drop["current"].tolist() == [0, 1, 2, 5, 6]
    assert any("2 samples were dropped" in note for note in drop.notes)


def test_a_clock_that_stands_still_is_an_error(typed_log: Any, stamped: str) -> None:
    rows_ = [
        (k * MS, {"header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}, "value": 1.0})
        for k in range(5)
    ]
    path = typed_log("/s", "rig/msg/Stamped", stamped, rows_)
    entry = {"current": {"topic": "/s", "field": "value", "unit": "A"}}
    with pytest.raises(RecordingError, match=r"time stands still.*another clock"):
        recordings.read(path, channels={"clock": "header", "channels": entry})


def test_publish_time_is_another_clock(float_log: Any) -> None:
    path = float_log({"/current": rows(np.arange(5) * MS, range(5))})
    log = recordings.read(path, channels=mapping("current"))
    publish = recordings.read(path, channels=mapping("current", clock="publish"))
    assert log.epoch_ns - publish.epoch_ns == 500


def test_a_topic_without_header_has_no_header_clock(float_log: Any) -> None:
    path = float_log({"/current": rows(np.arange(5) * MS, range(5))})
    with pytest.raises(RecordingError, match=r"'/current'.*no header\.stamp.*clock: log"):
        recordings.read(path, channels=mapping("current", clock="header"))


def test_a_nan_in_a_log_is_kept_and_said(float_log: Any) -> None:
    values = np.arange(100.0)
    values[[40, 41]] = np.nan
    path = float_log({"/current": rows(np.arange(100) * MS, values)})
    back = recordings.read(path, channels=mapping("current"))
    assert np.array_equal(back["current"], values, equal_nan=True)
    assert any(
        "'current': 2 of 100 samples are not finite, first at 0.04 s" in n for n in back.notes
    )


def test_wrapped_integers_are_reported_and_repaired_on_demand(typed_log: Any) -> None:
    counts = np.arange(30_000, 36_000, 100)
    wrapped = counts.astype(np.uint16).view(np.int16)
    path = typed_log(
        "/adc",
        "std_msgs/msg/Int16",
        "int16 data",
        [(k * MS, {"data": int(v)}) for k, v in enumerate(wrapped)],
    )
    entry = {"topic": "/adc", "field": "data", "unit": "bar", "scale": 0.01, "offset": -1.0}
    raw = recordings.read(path, channels={"channels": {"pressure_a": entry}})
    assert raw["pressure_a"].min() < 0
    note = " ".join(raw.notes)
    assert "raw 16-bit integer wraps around once, first at 0.028 s; not repaired" in note
    repaired = recordings.read(path, channels={"channels": {"pressure_a": {**entry, "unwrap": 16}}})
    assert np.allclose(repaired["pressure_a"], (counts * 0.01 - 1.0) * 1e5)
    assert any("it was unwrapped" in note for note in repaired.notes)


@pytest.mark.parametrize(("size", "said"), [(2**53, False), (2**60, True)])
def test_whole_numbers_that_a_double_does_not_hold_are_told(
    typed_log: Any, size: int, said: bool
) -> None:
    rows = [(k * MS, {"data": size - 3 + k}) for k in range(4)]
    path = typed_log("/stamp", "std_msgs/msg/Int64", "int64 data", rows)
    entry = {"topic": "/stamp", "field": "data", "unit": "V"}
    back = recordings.read(path, channels={"channels": {"probe": entry}})
    notes = [note for note in back.notes if "rounded to multiples of" in note]
    assert len(notes) == said
    if said:
        assert "'probe'" in notes[0]
        assert notes[0].endswith("rounded to multiples of 256")


def test_two_channels_of_one_field_do_not_disturb_each_other(float_log: Any) -> None:
    path = float_log({"/p": rows(np.arange(10) * MS, range(10))})
    entry = {"topic": "/p", "field": "data"}
    back = recordings.read(
        path,
        channels={
            "channels": {
                "pressure_a": {**entry, "unit": "bar"},
                "pressure_b": {**entry, "unit": "kPa", "scale": -1},
                "probe": {**entry, "unit": "V"},
            }
        },
    )
    assert back["pressure_a"].tolist() == [k * 1e5 for k in range(10)]
    assert back["pressure_b"].tolist() == [-k * 1e3 for k in range(10)]
    assert back["probe"].tolist() == list(range(10))
    assert back.units["probe"] == "V"


def test_two_channels_of_one_field_that_is_cut_do_not_disturb_each_other(float_log: Any) -> None:
    stamps = np.arange(100) * MS
    path = float_log({"/p": rows(stamps, range(100)), "/q": rows(stamps[10:50:4], range(10))})
    entry = {"topic": "/p", "field": "data"}
    back = recordings.read(
        path,
        channels={
            "channels": {
                "pressure_a": {**entry, "unit": "bar"},
                "pressure_b": {**entry, "unit": "MPa"},
                "current": {"topic": "/q", "field": "data", "unit": "A", "scale": 2},
            }
        },
    )
    assert back["pressure_a"].tolist() == [k * 1e5 for k in range(10, 47)]
    assert back["pressure_b"].tolist() == [k * 1e6 for k in range(10, 47)]


@given(
    start=st.integers(-50, 50),
    periods=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    counts=st.tuples(st.integers(30, 80), st.integers(30, 80)),
)
@settings(max_examples=60)
def test_a_straight_line_survives_any_two_rates(
    start: int, periods: tuple[int, int], counts: tuple[int, int]
) -> None:
    tracks = {}
    for name, offset, period, count in zip("ab", (0, start), periods, counts, strict=True):
        stamps = (offset + period * np.arange(count)).astype(np.int64) * MS
        tracks[name] = Track(name, stamps, {"v": 2e-6 * stamps + 1.0})
    chosen = load_channel_map(
        {
            "channels": {
                "current": {"topic": "a", "field": "v", "unit": "A"},
                "force": {"topic": "b", "field": "v", "unit": "N"},
            }
        }
    )
    low = max(track.stamps[0] for track in tracks.values())
    high = min(track.stamps[-1] for track in tracks.values())
    keys = {"current": ("a", "v"), "force": ("b", "v")}
    assume(low + 9 * MS <= high)
    found = align(chosen, tracks, keys, "x")
    assert found.stamps[0] >= low
    assert found.stamps[-1] <= high
    expected = 2e-6 * found.stamps + 1.0
    for column in found.columns.values():
        assert np.allclose(column, expected, rtol=1e-9, atol=1e-9)


def test_topics_that_tick_together_are_not_interpolated_when_cut(float_log: Any) -> None:
    stamps = np.arange(100) * MS
    path = float_log(
        {
            "/p": rows(stamps, range(100)),
            "/q": rows(stamps, range(100)),
            "/r": rows(stamps[10:80:2], range(35)),
        }
    )
    entries = {"pressure_a": ("/p", "bar"), "pressure_b": ("/q", "bar"), "current": ("/r", "A")}
    channels = {
        name: {"topic": topic, "field": "data", "unit": unit}
        for name, (topic, unit) in entries.items()
    }
    back = recordings.read(path, channels={"channels": channels})
    assert back["pressure_b"].tolist() == [k * 1e5 for k in range(10, 79)]
    assert not any("'/q'" in note for note in back.notes)
    assert any("'/r' (every 0.002 s) was carried" in note for note in back.notes)

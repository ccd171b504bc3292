"""The first channel map of a log: short names, with units at their ends or without."""

from pathlib import Path

import pytest

from eha_bench.recordings import guessing, info, read
from eha_bench.recordings.budget import OutOfTime
from eha_bench.recordings.guessing import first_map


@pytest.mark.parametrize(
    ("column", "line"),
    [
        ("p_a", "pressure_a: {column: p_a, unit: Pa}"),
        ("p_b", "pressure_b: {column: p_b, unit: Pa}"),
        ("x_mm", "piston_position: {column: x_mm, unit: mm}"),
        ("motor current_a", 'current: {column: "motor current_a", unit: A}'),
        ("T_c", "{column: T_c, unit: degC}"),
    ],
)
def test_what_a_column_is(tmp_path: Path, column: str, line: str) -> None:
    (tmp_path / "log.csv").write_text(f"t_s,{column}\n0,1\n0.1,2\n0.2,4\n")
    found = first_map(tmp_path / "log.csv")
    assert line in found
    assert "time: {column: t_s, unit: s}" in found


@pytest.mark.parametrize("unit", ["s", "ms", "sec", "min"])
def test_a_clock_in_any_unit_of_time(tmp_path: Path, unit: str) -> None:
    (tmp_path / "log.csv").write_text(f"Time [{unit}],p_a\n0,1\n0.1,2\n0.2,4\n")
    assert f'time: {{column: "Time [{unit}]", unit: {unit}}}' in first_map(tmp_path / "log.csv")


def test_a_column_of_dates_is_the_clock(tmp_path: Path) -> None:
    rows = "".join(f"2025-11-09T09:27:0{k}.5Z,{k}\n" for k in range(4))
    (tmp_path / "log.csv").write_text(f"stamp,p_a\n{rows}")
    assert "time: {column: stamp}" in first_map(tmp_path / "log.csv")


def test_a_column_of_seconds_is_the_clock_beside_one_of_dates(tmp_path: Path) -> None:
    rows = "".join(f"2025-11-09T09:27:00Z,{k / 10},{k}\n" for k in range(4))
    (tmp_path / "log.csv").write_text(f"stamp,time_s,p_a\n{rows}")
    assert "time: {column: time_s, unit: s}" in first_map(tmp_path / "log.csv")


def test_thousands_of_columns_like_nothing_are_not_compared_letter_by_letter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [f"topic{number}_col_{number}" for number in range(2000)]
    row = ",".join(["1.5"] * 2001)
    (tmp_path / "wide.csv").write_text("\n".join([",".join(["time", *names]), row, row]) + "\n")

    def never(*_: object) -> None:
        raise AssertionError("compared")

    monkeypatch.setattr(guessing, "SequenceMatcher", never)
    assert first_map(tmp_path / "wide.csv").count("guessed: no channel") == 2000


def test_names_that_differ_in_signs_alone_are_numbered_at_once() -> None:
    names = guessing._Names(["x"])
    found = [names.unlike("x") for _ in range(50_000)]
    assert found[:2] == ["x_2", "x_3"]
    assert len(set(found)) == 50_000


def test_of_a_very_wide_table_the_first_columns_are_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eha_bench.recordings.information._MOST_COLUMNS", 2)
    (tmp_path / "wide.csv").write_text("t_s,p_a,p_b,x\n0,1,2,3\n1,1,2,3\n")
    found = info(tmp_path / "wide.csv")
    assert [topic.name for topic in found.topics] == ["t_s", "p_a"]
    assert "2 of its 4 columns were not looked at" in found.notes
    assert found.unseen == 2
    assert "# 2 more topics or columns were not looked at" in first_map(tmp_path / "wide.csv")


def test_no_column_is_looked_at_when_time_is_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "wide.csv").write_text("t_s,p_a,p_b,x\n0,1,2,3\n1,1,2,3\n")
    asked: list[str] = []

    def late(_: object, name: str) -> None:
        asked.append(name)
        raise OutOfTime("it takes more than 3 s")

    monkeypatch.setattr("eha_bench.recordings.tables.csv_source.CsvSource.column", late)
    found = info(tmp_path / "wide.csv")
    assert asked == ["t_s"]
    assert found.notes[-2:] == ("it takes more than 3 s", "4 of its 4 columns were not looked at")


def test_groups_with_clocks_of_their_own_can_be_read_by_the_map(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    lines = [f'{{"topic": "/a", "t": {k / 1e3}, "v": {k}}}' for k in range(60)]
    lines += [f'{{"topic": "/b", "t": {k / 500}, "w": {2 * k}, "v": 0}}' for k in range(30)]
    log.write_text("\n".join(lines))
    (tmp_path / "map.yaml").write_text(first_map(log))
    found = read(log, channels=tmp_path / "map.yaml")
    assert {*found.values} == {"a_v", "w", "b_v"}
    # each by its own clock: w is 2 every 2 ms, and v 1 every ms
    assert found["w"] == pytest.approx(found["a_v"])


def test_what_the_clock_is_not_of_is_left_out_and_said(tmp_path: Path) -> None:
    log = tmp_path / "log.json"
    log.write_text('{"t": [0, 1, 2], "p_a": [1, 2, 3], "p_b": [1, 2]}')
    text = first_map(log)
    assert "  # left out, as the clock above is not theirs" in text
    assert "  # pressure_b: {column: p_b, unit: Pa}" in text
    (tmp_path / "map.yaml").write_text(text)
    assert list(read(log, channels=tmp_path / "map.yaml").values) == ["pressure_a"]


def test_a_clock_of_nothing_is_none(tmp_path: Path) -> None:
    log = tmp_path / "log.json"
    log.write_text('{"t": [0, 1, 2, 4], "p_a": [1, 2, 3], "p_b": [1, 2, 4]}')
    (tmp_path / "map.yaml").write_text(first_map(log))
    assert "ASSUMED: no column" in (tmp_path / "map.yaml").read_text()
    assert len(read(log, channels=tmp_path / "map.yaml")) == 3


def _written(folder: Path, text: str) -> Path:
    path = folder / "log.csv"
    path.write_text(text)
    return path


TICKS = [0.0069, 0.0130, 0.0192, 0.0249, 0.0305, 0.0372, 0.0424, 0.0488, 0.0542, 0.0612]


def test_the_only_column_that_rises_is_the_time_of_a_table_without_names(tmp_path: Path) -> None:
    log = _written(tmp_path, "".join(f"100; {t};{k // 2};-5\n" for k, t in enumerate(TICKS)))
    text = first_map(log)
    assert 'time: {column: "1", unit: s}  # guessed: no other column rises' in text
    assert "its unit is assumed" in text
    assert 'column: "1"' not in text.partition("channels:")[2]
    (tmp_path / "map.yaml").write_text(text)
    found = read(log, channels=tmp_path / "map.yaml")
    assert found.time == pytest.approx([t - TICKS[0] for t in TICKS])


@pytest.mark.parametrize(
    "rows",
    [
        "".join(f"{t},{2 * t},5\n" for t in TICKS),  # two rise
        "".join(f"{k},{k % 2},5\n" for k in range(20)),  # the numbers of the rows
        "".join(f"{t},3,5\n" for t in TICKS[:5]),  # a few rise by chance
        "".join(f"{2.0**k},3,5\n" for k in range(20)),  # no clock ticks so
        "u,v,w\n" + "".join(f"{t},3,5\n" for t in TICKS),  # it has a name, of no time
    ],
)
def test_what_rises_is_not_always_the_time(tmp_path: Path, rows: str) -> None:
    assert "sample_rate: 1 kHz  # ASSUMED" in first_map(_written(tmp_path, rows))


def test_a_name_that_ends_like_a_time_is_one_where_no_other_is(tmp_path: Path) -> None:
    rows = "".join(f"7;{80 * k};{k};{90 * k}\n" for k in range(5))
    log = _written(tmp_path, f"idle_time [s];sensor_time [ms];pos_m;motor_time [ms]\n{rows}")
    text = first_map(log)
    assert 'time: {column: "sensor_time [ms]", unit: ms}' in text
    for left in ("idle_time [s]", "motor_time [ms]"):
        assert f'column: "{left}"' in text.partition("channels:")[2]
    log = _written(tmp_path, f"idle_time [s];sensor_time [ms];pos_m;time [ms]\n{rows}")
    assert 'time: {column: "time [ms]", unit: ms}' in first_map(log)


@pytest.mark.parametrize(
    ("column", "line"),
    [
        ("cmd volts", 'voltage: {column: "cmd volts", unit: V}'),
        ("cmd", "current_command: {column: cmd, unit: A}"),
        ("motor amps", 'current: {column: "motor amps", unit: A}'),
        ("Boom Ms", 'boom_ms: {column: "Boom Ms", unit: ""}'),
        ("delay_ms", "delay_ms: {column: delay_ms, unit: ms}"),
        ("DELAY_MS", "delay_ms: {column: DELAY_MS, unit: ms}"),
    ],
)
def test_a_unit_that_a_name_ends_in(tmp_path: Path, column: str, line: str) -> None:
    assert line in first_map(_written(tmp_path, f"Time,{column}\n0,1\n0.1,2\n0.2,4\n"))


@pytest.mark.parametrize(
    ("column", "largest", "said"),
    [("p_a", 114, True), ("p_a", 3e6, False), ("p_a [Pa]", 114, False), ("x", 114, False)],
)
def test_a_pressure_that_looks_like_bar_is_said_to(
    tmp_path: Path, column: str, largest: float, said: bool
) -> None:
    text = first_map(_written(tmp_path, f"t,{column}\n0,9\n0.1,{largest}\n0.2,40\n"))
    assert ("unit assumed: its values, up to 114, look like bar" in text) is said


def test_pairs_of_x_and_y_have_their_own_time(tmp_path: Path) -> None:
    rows = "".join(f"{k},{3 * k},{k + 0.5},{k * k}\n" for k in range(12))
    log = _written(tmp_path, f"Speed [rpm],,Current [mA],\nX,Y,X,Y\n{rows}")
    text = first_map(log)
    assert "time: {column: X, unit: ms}  # guessed: its columns come in pairs of X and Y" in text
    (tmp_path / "map.yaml").write_text(text)
    found = read(log, channels=tmp_path / "map.yaml")
    assert {*found.values} == {"motor_speed", "current"}

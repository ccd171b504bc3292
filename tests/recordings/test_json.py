"""JSON and JSON lines: records, columns and groups, however they are written."""

import json
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pytest

from eha_bench import recordings
from eha_bench.core.errors import RecordingError

COUNT = 200
TIME = np.arange(COUNT) / 50
ANGLE = np.sin(TIME) * 180 / np.pi
RAW = 2048 + np.arange(COUNT)
RECORDS: list[dict[str, Any]] = [
    {"t": t, "present": {"position": [a, int(r)]}, "names": ["hip", "knee"], "load": None}
    for t, a, r in zip(TIME.tolist(), ANGLE.tolist(), RAW.tolist(), strict=True)
]
ROWS = [record["present"]["position"] for record in RECORDS]
SHAPES = {
    "lines.jsonl": "\n".join(map(json.dumps, RECORDS)) + "\n",
    "list.json": json.dumps(RECORDS),
    "inside.json": json.dumps({"mass": 1.5, "entries": RECORDS}, indent=1),
    "columns.json": json.dumps(
        {"mass": 1.5, "t": TIME.tolist(), "names": ["hip", "knee"], "present.position": ROWS}
    ),
    "joint by joint.json": json.dumps(
        {
            "t": TIME.tolist(),
            "names": ["hip", "knee"],
            "present": {"position": np.transpose(ROWS).tolist()},
            "load": [None] * COUNT,
        }
    ),
}
SHAPES["one of a list.json"] = f"[{SHAPES['columns.json']}]"
INSIDE = {"t": TIME.tolist(), "names": ["hip", "knee"], "present.position": ROWS}
SHAPES["one of a list inside.json"] = json.dumps({"mass": 1.5, "data": [INSIDE]})
MAP: dict[str, Any] = {
    "time": {"column": "t"},
    "channels": {
        "hip_angle": {"column": "present.position[0]", "unit": "deg"},
        "knee_angle": {
            "column": "present.position[knee]",
            "unit": "rad",
            "scale": 0.00153398,
            "offset": -np.pi,
        },
    },
}


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_gives_the_same(tmp_path: Path, name: str) -> None:
    found = recordings.read(written(tmp_path, name, SHAPES[name]), channels=MAP)
    assert np.array_equal(found.time, TIME)
    assert np.allclose(found["hip_angle"], np.sin(TIME), rtol=1e-14)
    assert np.array_equal(found["knee_angle"], RAW * 0.00153398 - np.pi)
    assert found.units == {"hip_angle": "rad", "knee_angle": "rad"}
    if "mass" in SHAPES[name]:
        assert found.metadata["mass"] == "1.5"


def test_groups_tick_at_their_own_rates(tmp_path: Path) -> None:
    fast = [{"topic": "/drive", "t": t, "msg": {"speed": 2 * t}} for t in TIME.tolist()]
    slow = [{"topic": "/block", "t": t, "msg": {"p": 3 * t}} for t in TIME[::10].tolist()]
    rows = sorted(fast + slow, key=lambda row: float(row["t"]))
    path = written(tmp_path, "log.jsonl", "\n".join(map(json.dumps, rows)))
    found = recordings.read(
        path,
        channels={
            "time": {"column": "t"},
            "channels": {
                "motor_speed": {"topic": "/drive", "field": "msg.speed", "unit": "rad/s"},
                "pressure_a": {"topic": "/block", "field": "msg.p", "unit": "bar"},
            },
        },
    )
    assert np.allclose(found["motor_speed"], 2 * found.time)
    assert np.allclose(found["pressure_a"], 3e5 * found.time)
    assert any("interpolated" in note for note in found.notes)


def test_dates_and_known_names_need_no_map(tmp_path: Path) -> None:
    rows = [
        {"time": f"2025-03-01T12:00:{k:02d}.5Z", "pressure_a": 1e5 + k, "reference": k}
        for k in range(50)
    ]
    found = recordings.read(written(tmp_path, "a.json", json.dumps(rows)))
    assert np.array_equal(found.time, np.arange(50.0))
    assert found.epoch_ns == 1_740_830_400_500_000_000
    assert np.array_equal(found["reference"], np.arange(50.0))


def test_a_damaged_line_is_left_out_and_said(tmp_path: Path) -> None:
    lines = list(map(json.dumps, RECORDS))
    lines[20] = lines[20][:-9]
    lines[-1] = lines[-1][:30]
    path = written(tmp_path, "torn.jsonl", "\n".join(lines))
    found = recordings.read(path, channels=MAP)
    assert len(found) == COUNT - 2
    assert any("line 21" in note for note in found.notes)
    assert any(f"line {COUNT}" in note for note in found.notes)
    assert recordings.info(path).health == "damaged"


def test_a_torn_list_is_read_to_its_tear(tmp_path: Path) -> None:
    path = written(tmp_path, "torn.json", SHAPES["list.json"][:2000])
    found = recordings.read(path, channels=MAP)
    assert 0 < len(found) < COUNT
    assert any("torn" in note for note in found.notes)


def test_a_key_that_stands_twice_is_said(tmp_path: Path) -> None:
    text = SHAPES["lines.jsonl"].replace('"load": null', '"load": 1, "load": 2')
    found = recordings.read(written(tmp_path, "a.jsonl", text), channels=MAP)
    assert any("occur twice" in note for note in found.notes)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not JSON"),
        ('{"a": 1, "b": "x"}', "no list of numbers"),
        ('{"t": [1' + "0" * 400 + "]}", "no list of numbers"),
        ('[{"t": 1' + "0" * 400 + "}]", "too many digits|damaged"),
        ("[" * 100_000, "damaged|no list|deeper"),
        ('{"a": ' * 100_000, "not JSON"),
        ('{"a":' * 60 + "[1]" + "}" * 60, "deeper"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(RecordingError, match=said):
        recordings.read(written(tmp_path, "a.json", text), channels=MAP)


def test_a_name_that_is_not_there_is_guessed(tmp_path: Path) -> None:
    path = written(tmp_path, "a.jsonl", SHAPES["lines.jsonl"])
    wrong = {"hip_angle": {"column": "present.positon[0]", "unit": "deg"}}
    with pytest.raises(RecordingError, match=r"did you mean 'present\.position\[0\]'"):
        recordings.read(path, channels={**MAP, "channels": wrong})


def test_a_strangers_channel_needs_only_its_unit(tmp_path: Path) -> None:
    path = written(tmp_path, "a.jsonl", SHAPES["lines.jsonl"])
    entry = {"column": "present.position[0]", "unit": "mm"}
    found = recordings.read(path, channels={**MAP, "channels": {"spool_position": entry}})
    assert found.unit("spool_position") == "m"
    assert np.allclose(found["spool_position"], ANGLE / 1000)


PLAIN = {
    "time": {"column": "t", "unit": "s"},
    "channels": {"force": {"column": "p", "unit": "N"}},
}


def test_lines_that_are_no_objects_are_left_out_and_said(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    whole = [f'{{"t": {k}, "p": {k}}}' for k in range(9)]
    path.write_text("\n".join([*whole[:5], "3", "null", "{x", "y", '"z"', *whole[5:], '{"t": 9']))
    rec = recordings.read(path, channels=PLAIN)
    assert rec["force"].tolist() == list(range(9))
    assert [note for note in rec.notes if "line" in note] == [
        "it is damaged or torn in line 6 (it is not an object); this line was left out",
        "it is damaged or torn in line 7 (it is not an object); this line was left out",
        "it is damaged or torn in line 8 (Expecting property name enclosed in double quotes); "
        "this line was left out",
        "it is damaged or torn in line 9 (Expecting value); this line was left out",
        "it is damaged or torn in line 10 (it is not an object); this line was left out",
        "1 more lines were left out",
    ]
    assert recordings.info(path).health == "damaged"


def test_thousands_of_damaged_lines_cost_as_much_as_whole_ones(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    costs = []
    for count in (5_000, 20_000):
        path.write_text('{"t": 0, "p": 1}\n{"t": 1, "p": 1}\n' + "{x\n" * count)
        begun = process_time()
        assert len(recordings.read(path, channels=PLAIN)) == 2
        costs.append(process_time() - begun)
    assert costs[1] < 10 * costs[0]  # each line counted anew would make it 16 and more


def test_a_key_of_its_own_in_each_line_is_held_against_the_budget(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    path.write_text("\n".join(f'{{"t": {k}, "p": {k}, "k{k}": 1}}' for k in range(6000)))
    with pytest.raises(RecordingError, match="different values each"):
        recordings.read(path, channels=PLAIN)


@pytest.mark.parametrize(
    "record",
    [
        {"t": 0.1, "position": [1.0, 2.0, 3.0]},
        {"names": ["hip", "knee"], "position": [1.0, 2.0]},
        {"header": {"stamp": 0.1}, "position": [1.0, 2.0, 3.0]},
        {"stamp": "2026-01-01T00:00:00", "position": [1.0, 2.0, 3.0]},
        {"position": [1.0]},
    ],
)
def test_the_only_record_of_a_list_is_a_sample_where_it_looks_like_one(
    tmp_path: Path, record: dict[str, Any]
) -> None:
    path = written(tmp_path, "log.json", json.dumps([record]))
    assert "position[0]" in [column.name for column in recordings.info(path).topics]


def test_the_only_record_of_a_list_may_hold_columns_beside_text(tmp_path: Path) -> None:
    data = {"type": "drop", "command": [0.0, 0.0, None, None], "angle": [0.1, 0.2, 0.4, 0.7]}
    path = written(tmp_path, "log.json", json.dumps({"rate": 50, "data": [data]}))
    found = recordings.info(path)
    assert [(column.name, column.count) for column in found.topics] == [
        ("command", 4),
        ("angle", 4),
    ]
    assert found.metadata == {"json": {"rate": "50", "data.type": "drop"}}
    entries = {"angle": {"column": "angle", "unit": "rad"}}
    read = recordings.read(path, channels={"sample_rate": "50 Hz", "channels": entries})
    assert read["angle"].tolist() == [0.1, 0.2, 0.4, 0.7]

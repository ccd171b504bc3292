"""channels.yaml: what is accepted, and what a mistake is told."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.errors import InputError
from eha_bench.recordings import load_channel_map, read
from eha_bench.recordings.encodings.field_path import ArrayItem, Attribute, FieldPath, NamedElement


def load(tmp_path: Path, text: str) -> Any:
    path = tmp_path / "channels.yaml"
    path.write_text(text)
    return load_channel_map(path)


def test_the_contracts_example(tmp_path: Path) -> None:
    mapping = load(
        tmp_path,
        """
clock: log            # log | publish | header
channels:
  current_command: {topic: /drive/current_cmd, field: data, unit: A}
  motor_speed:     {topic: /drive/state, field: "velocity[0]", unit: rpm}
  pressure_a: {topic: /block/p_a, field: fluid_pressure, unit: bar, scale: 1.0, offset: 0.0}
  piston_position: {column: pos_mm, unit: mm}          # CSV / Parquet / MAT
""",
    )
    assert mapping.to_si("pressure_a") == (pytest.approx(1e5), 0.0)
    assert mapping.si_unit("motor_speed") == "rad/s"
    assert mapping.channels["current_command"].scale == 1.0


@pytest.mark.parametrize(
    ("unit", "si"), [("MPa", "Pa"), ("deg", "rad"), ("A", "A"), ("mm", "m"), ("rpm", "rad/s")]
)
def test_the_reference_takes_any_unit(tmp_path: Path, unit: str, si: str) -> None:
    mapping = load(tmp_path, f"channels: {{reference: {{topic: /r, field: data, unit: {unit}}}}}")
    assert mapping.si_unit("reference") == si


@pytest.mark.parametrize(
    ("text", "message", "line"),
    [
        ("channels: {current: {topic: /a, field: data, unit: bar}}", "wrong dimension", 1),
        ("channels: {current: {topic: /a, field: data, unit: amperes2x}}", "unit", 1),
        ("channels: {motor_speed: {topic: /a, field: d, unit: Hz}}", "ambiguous|dimension", 1),
        ("channels:\n  current: {topic: /a, unit: A}", "field are needed", 2),
        ("channels:\n  current: {topic: /a, field: d, column: c, unit: A}", "not both", 2),
        ("channels:\n  current: {topic: /a, field: 'a..b', unit: A}", "not a field path", 2),
        (
            "channels:\n  current: {topic: /a, field: d, unit: A, clock: wall}",
            "known: log, publish",
            2,
        ),
        ("channels:\n  current: {topic: /a, feld: d, unit: A}", "unknown key|feld", 2),
        ("channels:\n  probe: {topic: /a, field: d}", "needs a unit", 1),
        ("channels:\n  reference: {topic: /a, field: d}", "needs a unit", 1),
        ("channels: {}", "at least one", 1),
        ("clock: log", "missing", 0),
        ("base: x\nchannels: {current: {topic: /a, field: d, unit: A}}", "base", 0),
        ("time: {column: t, unit: bar}\nchannels: {current: {column: c, unit: A}}", "dimension", 1),
        ("sample_rate: -1 Hz\nchannels: {current: {column: c, unit: A}}", "positive", 1),
        ("channels: {time: {topic: /a, field: d, unit: s}}", "cannot be the name", 1),
        ("repair: {gaps: fill}\nchannels: {current: {column: c, unit: A}}", "known: nan", 1),
        ("channels:\n  current: {topic: /a, field: d, unit: A, scale: .nan}", "finite", 2),
        ("channels:\n  current: {topic: /a, field: d, unit: 9**9**9**9}", "unit", 1),
        ("channels:\n  probe: {topic: /a, field: d, unit: 9**9**9**9}", "unit", 1),
    ],
)
def test_a_mistake_is_told_with_its_place(
    tmp_path: Path, text: str, message: str, line: int
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        load(tmp_path, text)
    assert "channels.yaml" in str(caught.value)
    assert caught.value.where.line >= line


GOOD = "  motor_speed: {topic: /a, field: d, unit: rpm}\n"


@pytest.mark.parametrize(
    ("text", "line", "key", "message"),
    [
        (f"channels:\n{GOOD}  current: {{topic: /a, field: d, unit: bar}}\n", 3,
         "channels.current.unit", "wrong dimension"),
        (f"channels:\n{GOOD}  current:\n    topic: /a\n    field: d\n    unit: bar\n", 6,
         "channels.current.unit", "wrong dimension"),
        (f"channels:\n{GOOD}  reference: {{topic: /a, field: d}}\n", 3,
         "channels.reference.unit", "needs a unit"),
        (f"channels:\n{GOOD}  probe: {{topic: /a, field: d, unit: 9**9}}\n", 3,
         "channels.probe.unit", "unit"),
        (f"channels:\n{GOOD}  time: {{topic: /a, field: d, unit: s}}\n", 3,
         "channels.time", "cannot be the name"),
        (f"clock: log\nbase: motor_sped\nchannels:\n{GOOD}", 2, "base",
         "did you mean 'motor_speed'"),
        (f"channels:\n{GOOD}  force: {{column: f, unit: N}}\nbase: force\n", 4, "base",
         "is a column"),
        ("time: {column: t, unit: ms}\nsample_rate: 1 kHz\nchannels:\n  force: {column: f}\n", 2,
         "sample_rate", "not both"),
        ("time:\n  column: t\n  unit: bar\nchannels:\n  force: {column: f}\n", 3, "time.unit",
         "dimension"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_with_its_line_and_key(
    tmp_path: Path, text: str, line: int, key: str, message: str
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        load(tmp_path, text)
    assert (caught.value.where.line, caught.value.where.key) == (line, key)


def test_a_missing_map_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_channel_map(tmp_path / "none.yaml")


def test_field_paths() -> None:
    assert FieldPath.parse("velocity[0]").steps == (Attribute("velocity"), ArrayItem(0))
    assert FieldPath.parse("pose.position.z").steps == tuple(
        map(Attribute, ("pose", "position", "z"))
    )
    assert FieldPath.parse("velocity[motor]").steps == (
        Attribute("velocity"),
        NamedElement("motor"),
    )
    assert FieldPath.parse("velocity['left knee']").steps[1] == NamedElement("left knee")
    assert len(FieldPath.parse("a.b[1].c[2]").steps) == 5


@given(
    st.lists(
        st.one_of(
            st.from_regex(r"[a-z][a-z0-9_]{0,5}", fullmatch=True).map(Attribute),
            st.integers(0, 99).map(ArrayItem),
        ),
        max_size=5,
    )
)
def test_a_path_is_read_as_it_is_written(steps: list[Any]) -> None:
    path = FieldPath((Attribute("a"), *steps))
    assert FieldPath.parse(str(path)) == path


@pytest.mark.parametrize("text", ["", ".", "a.", "[0]", "a[", "a[]", "a b", "a[0", "9a", "a..b"])
def test_what_is_no_path(text: str) -> None:
    with pytest.raises(ValueError, match="not a field path"):
        FieldPath.parse(text)


def test_misspelt_keys_and_channels_are_guessed() -> None:
    entry = {"topic": "/a", "field": "data"}
    with pytest.raises(InputError, match="unknown key 'feld'; did you mean 'field'"):
        load_channel_map({"channels": {"current": {"topic": "/a", "feld": "data", "unit": "A"}}})
    with pytest.raises(InputError, match=r"needs a unit.*did you mean 'current'"):
        load_channel_map({"channels": {"curent": entry}})
    with pytest.raises(InputError, match="there is no channel"):
        load_channel_map({"channels": {}})
    mapping = load_channel_map(
        {"channels": {name: {**entry, "unit": "bar"} for name in ("presure_a", "pressure_b", "p")}}
    )
    assert mapping.strangers() == [
        "channel 'presure_a' is not one that eha-bench knows; did you mean 'pressure_a'?"
    ]
    # a plant may call its own so
    assert mapping.knowing(["presure_a"]).strangers() == []
    assert mapping.knowing(["presure_a"]).read.strangers() == []


@pytest.mark.parametrize("rate", ["3 GHz", "0 Hz", "-1 kHz"])
def test_a_sample_rate_that_cannot_be_is_refused(rate):
    with pytest.raises(InputError, match="must be positive, and at most 1 GHz"):
        load_channel_map({"sample_rate": rate, "channels": {"current": {"column": "i"}}})


ONE_MAP = {
    "time": {"column": "t", "unit": "ms"},
    "base": "current",
    "channels": {
        "current": {"topic": "/i", "field": "data", "unit": "A"},
        "piston_position": {"column": "pos_mm", "unit": "mm"},
        "forse": {"column": "f", "unit": "N"},
    },
}


def test_one_map_for_a_log_and_a_table(tmp_path: Path, float_log: Any) -> None:
    log = float_log({"/i": [(k * 1_000_000, k) for k in range(20)]})
    table = tmp_path / "piston.csv"
    table.write_text("t,pos_mm,f\n" + "".join(f"{k},{2 * k},1\n" for k in range(20)))
    from_log, from_table = read(log, channels=ONE_MAP), read(table, channels=ONE_MAP)
    assert tuple(from_log.values) == ("current",)
    assert from_log["current"].tolist() == list(range(20))
    assert tuple(from_table.values) == ("piston_position", "forse")
    assert from_table["piston_position"][1] == pytest.approx(0.002)
    assert any("piston_position, forse from columns" in note for note in from_log.notes)
    assert any("current from topics" in note for note in from_table.notes)
    assert any("did you mean 'force'" in note for note in from_table.notes)


@pytest.mark.parametrize("tables", [True, False])
def test_a_map_of_the_other_kind_alone_is_refused(
    tmp_path: Path, float_log: Any, tables: bool
) -> None:
    log = float_log({"/i": [(k * 1_000_000, k) for k in range(20)]})
    (tmp_path / "a.csv").write_text("t,p\n0,1\n1,2\n")
    column = {"column": "p", "unit": "A"}
    topic = {"topic": "/i", "field": "data", "unit": "A"}
    path, entry, what = (
        (tmp_path / "a.csv", topic, "names topics, but the recording is a table")
        if tables
        else (log, column, "names columns, but the recording has topics")
    )
    with pytest.raises(InputError, match=what):
        read(path, channels={"sample_rate": "1 kHz", "channels": {"current": entry}})


def test_a_scale_of_nothing_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    path.write_text("sample_rate: 1 kHz\nchannels:\n  force: {column: F, unit: N, scale: 0}\n")
    with pytest.raises(InputError, match=r"yaml:3, key 'channels\.force\.scale': a scale of 0"):
        load_channel_map(path)

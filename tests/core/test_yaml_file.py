"""YAML files are read with line numbers, and every problem is one sentence with a place."""

from pathlib import Path
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from eha_bench.core import yaml_file
from eha_bench.core.errors import InputError, Place
from eha_bench.core.units import Unit
from eha_bench.core.yaml_file import (
    NUMBER,
    Real,
    StrictModel,
    file_beside,
    load,
    parse,
    validate,
)


class Pump(StrictModel):
    displacement: Annotated[float, Unit("m^3/rad")]
    speed: Annotated[float, Unit("rad/s")] = 0.0
    kind: Literal["gear", "piston"] = "piston"


class Rig(StrictModel):
    name: str
    pumps: tuple[Pump, ...] = ()
    count: int = Field(default=1, ge=1)


def refusal(tmp_path: Path, text: str) -> InputError:
    path = tmp_path / "rig.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        yaml_file.load_model(Rig, path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    return caught.value


def test_file_becomes_model(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text("name: knee\npumps:\n  - displacement: 0.69 cm^3/rev\n", encoding="utf-8")
    rig = yaml_file.load_model(Rig, path)
    assert rig.pumps[0].displacement == pytest.approx(1.0982e-7, rel=1e-4)


def test_yaml_is_1_2() -> None:
    content = yaml_file.plain(yaml_file.parse("{a: 20e6, b: 1e3, c: 12:30, d: on, e: no}", "x"))
    assert content == {"a": 20e6, "b": 1e3, "c": "12:30", "d": "on", "e": "no"}


@pytest.mark.parametrize(
    ("text", "line", "key", "what", "hint"),
    [
        ("name: a\ncuont: 2\n", 2, "cuont", "unknown key 'cuont'", "did you mean 'count'?"),
        ("count: 2\n", 0, "name", "key 'name' is missing", "add a line 'name: ...'"),
        (
            "name: a\npumps:\n  - speed: 3\n",
            3,
            "pumps.0.displacement",
            "is missing",
            "add a line 'displacement: ...'",
        ),
        (
            "name: a\npumps:\n  - displacement: 1e-7\n    sped: 1\n",
            4,
            "pumps.0.sped",
            "unknown key 'sped'",
            "did you mean 'speed'?",
        ),
        (
            "name: a\npumps:\n  - displacement: 1e-7\n    speed: 3 m\n",
            4,
            "pumps.0.speed",
            "unit 'm' has the wrong dimension",
            "expected a unit of the dimension of rad/s",
        ),
        ("name: a\ncount: 0\n", 2, "count", "greater than or equal to 1", ""),
        ("name: a\ncount: [1]\n", 2, "count", "this should be a whole number", ""),
        (
            "name: a\npumps:\n- displacement: 1e-7\n  kind: vane\n",
            4,
            "pumps.0.kind",
            "'vane' is not known here",
            "known: gear, piston",
        ),
    ],
)
def test_problem_is_placed(
    tmp_path: Path, text: str, line: int, key: str, what: str, hint: str
) -> None:
    error = refusal(tmp_path, text)
    assert error.where.line == line
    assert error.where.key == key
    assert what in error.what
    assert error.hint == hint


def test_several_problems_are_counted_and_the_misspelt_key_comes_first(tmp_path: Path) -> None:
    error = refusal(tmp_path, "nmae: a\ncount: 0\n")
    assert error.what == "unknown key 'nmae'"
    assert str(error).endswith("(and 1 more)")
    # 'name' is missing because it is misspelt: that is one mistake
    assert [item.where.key for item in error.also] == ["count"]
    assert error.hint == "did you mean 'name'?"


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "empty"),
        ("# nothing\n", "empty"),
        ("- 1\n", "found a list"),
        ("just text\n", "found the text"),
        ("a: [1\n", "not valid YAML"),
        ("name: a\nname: b\n", "not valid YAML"),
        ("a: *b\n", "not valid YAML"),
        ("\tname: a\n", "not valid YAML"),
    ],
)
def test_what_is_no_mapping_is_refused(tmp_path: Path, text: str, what: str) -> None:
    assert what in refusal(tmp_path, text).what


def test_missing_file_and_folder_and_bytes(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        yaml_file.load(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="cannot be read"):
        yaml_file.load(tmp_path)
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is not a text file in UTF-8"):
        yaml_file.load(tmp_path / "binary.yaml")


def test_content_put_together_elsewhere_brings_its_own_places() -> None:
    where = Place(file="base.yaml", line=7, key="defaults.name")
    with pytest.raises(InputError) as caught:
        yaml_file.validate(Rig, {"name": 3}, "rig.yaml", places=lambda keys: where)
    assert caught.value.where == where


def test_prefix_stands_before_the_key() -> None:
    with pytest.raises(InputError) as caught:
        yaml_file.validate(Pump, {"displacement": "1 m"}, "rig.yaml", ("pumps", 3))
    assert caught.value.where.key == "pumps.3.displacement"


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
        max_leaves=10,
    )
)
def test_any_content_is_a_model_or_an_input_error(content: object) -> None:
    try:
        outcome = yaml_file.validate(Rig, content, "rig.yaml").name
    except InputError as error:
        outcome = error.where.file
    assert outcome == "rig.yaml" or (isinstance(content, dict) and outcome == content["name"])


def test_a_file_beside_another_is_found_or_named_with_file_line_and_key(tmp_path):
    path = tmp_path / "target.yaml"
    path.write_text("target: replay\nlogs:\n  first: d.csv\n", encoding="utf-8")
    content = load(path)
    with pytest.raises(
        InputError, match=r"target.yaml:3, key 'logs.first': there is no file 'd.csv'; name it"
    ):
        file_beside(path, content, "logs", "first")
    (tmp_path / "d.csv").touch()
    assert file_beside(path, content, "logs", "first") == tmp_path / "d.csv"


class Numbers(StrictModel):
    """Numbers of a file."""

    ratio: Real = 1.0
    count: Annotated[int, Field(ge=1), NUMBER] = 1
    size: Real | str = 1.0
    names: Annotated[list[str], Field(min_length=1)] = Field(default_factory=lambda: ["a"])
    by_name: dict[str, Real] = Field(default_factory=dict)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ratio: true", r"key 'ratio': 'true' is not a number$"),
        ("count: true", r"key 'count': 'true' is not a number$"),
        ("size: false", r"key 'size': 'false' is not a number$"),
        ("by_name: {x: true}", r"key 'by_name.x': 'true' is not a number$"),
        ("ratio: .nan", r"key 'ratio': 'nan' is not a finite number$"),
        ("ratio: -.inf", r"key 'ratio': '-inf' is not a finite number$"),
        ("names: []", r"key 'names': 'names' is empty: it needs at least 1; write"),
        ("names: a", r"key 'names': expected a list; write \[a, b\], or a line '- a' for each$"),
        ("by_name: [1]", r"key 'by_name': expected keys and values; write it as"),
    ],
)
def test_what_is_no_number_or_no_list_is_said_in_words_of_a_file(text, said):
    with pytest.raises(InputError, match=said):
        validate(Numbers, parse(text, "f.yaml"), "f.yaml")

"""What libyaml reads, ruamel.yaml reads the same: values, and the line of every key and item."""

import random
from io import StringIO
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from eha_bench.core import fast_yaml
from eha_bench.core.errors import InputError
from eha_bench.core.located import Located
from eha_bench.core.yaml_file import DEEPEST, parse

BITS = (
    ": ", "- ", "[", "]", "{", "}", ", ", "\n", "\n  ", "\n    ", "#", " #", "'", '"', "|\n  ",
    ">-\n  ", "&a ", "*a", "<<: ", "!x ", "~", "null", "1", "0x1", "1e3", "1.5", "-", "?", "? ",
    ":", "a", "b: c", "@", "`", "%", "\\n", "\\x41", "\\/", "...", "---", "\t", "true", "é", "=",
    "<<", "2020-01-01", "1_0", "+1", "-0", ".5", "5.", "0o7", "012", "12:30", "\\u00e9", "\u00a0",
    "\x01", "😀",
)  # fmt: skip


def same(text: str) -> bool:
    """Whether both read a text alike; a text that is left to ruamel.yaml is."""
    try:
        found = fast_yaml.parse(text, DEEPEST)
    except fast_yaml.NeedsFullParser:
        return True
    fast = Located.of(found, "x")
    slow = Located.of(YAML(typ="rt").load(StringIO(text)), "x")
    return repr(fast.value) == repr(slow.value) and fast.places == slow.places


@pytest.fixture(scope="module")
def files(repository: Path) -> list[str]:
    return [
        path.read_text()
        for folder in ("suites", "fixtures", "examples")
        for path in sorted((repository / folder).rglob("*.yaml"))
    ]


def test_files_are_read_alike_and_nearly_all_fast(files: list[str]) -> None:
    assert len(files) > 30
    slow = 0
    for text in files:
        assert same(text)
        try:
            fast_yaml.parse(text, DEEPEST)
        except fast_yaml.NeedsFullParser:
            slow += 1
    assert slow <= 2  # hexadecimal numbers


@given(number=st.integers(0, 2**32))
@settings(max_examples=200, deadline=None)
def test_altered_files_are_read_alike(number: int, files: list[str]) -> None:
    choice = random.Random(number)
    text = choice.choice([text for text in files if len(text) < 1500])
    for _ in range(choice.choice((1, 2, 4))):
        place = choice.randrange(len(text) + 1)
        text = text[:place] + choice.choice(BITS) + text[place + choice.randrange(3) :]
    assert same(text)


@given(parts=st.lists(st.sampled_from(BITS), max_size=24))
@settings(max_examples=200, deadline=None)
def test_any_text_is_read_alike(parts: list[str]) -> None:
    assert same("".join(parts))


@pytest.mark.parametrize(
    "text",
    [
        "a: 0x10", "a: .5", "a: 1_000", "a: .inf", "a: 2020-01-01", "a: 012", "a: 5.", "<<: {a: 1}",
        "a: !x b", "%YAML 1.1\n---\na: yes", "--- a\n--- b", "a:\tb", "a: 1\na: 2", "? [a]\n: b",
        "a: &x 1\nb: *x", "|# no\n", "[" * 50 + "]" * 50, "a: [", "", "\ufeffa: 1", "a: \x85b",
        "a: " + "9" * 5000, "|\n  \n    ", "a: >\n\n  \n    b",
    ],
)  # fmt: skip
def test_what_is_not_plain_is_left_to_ruamel(text: str) -> None:
    with pytest.raises(fast_yaml.NeedsFullParser):
        fast_yaml.parse(text, DEEPEST)


def test_lists_that_hold_themselves_are_refused() -> None:
    with pytest.raises(InputError, match="is nested too deeply"):
        parse("a: &x [*x]", "rig.yaml")


def test_without_libyaml_everything_is_left_to_ruamel(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "yaml.cyaml", None)
    with pytest.raises(fast_yaml.NeedsFullParser):
        fast_yaml.parse("a: 1", DEEPEST)
    assert parse("a: 1", "rig.yaml") == {"a": 1}


def test_a_suite_of_thousands_of_trials_keeps_its_lines() -> None:
    text = "trials:\n" + "".join(f"  - id: s{k}\n    signal: {{kind: step}}\n" for k in range(3000))
    content = Located.of(fast_yaml.parse(text, DEEPEST), "x")
    assert content.place(("trials", 2999, "signal", "kind")).line == 6001

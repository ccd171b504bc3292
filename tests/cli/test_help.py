"""What help shows: words for values, no type names, one line a command."""

import re
from typing import Any

import pytest
import typer

from eha_bench.cli.app import app
from eha_bench.cli.help import WORDS, WORDS_OF

from .conftest import Cli

# typer says that it gives a command, and gives a group of them
COMMANDS: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]
TYPE_NAME = re.compile(r"<\w[\w \[\]|]*>|\b(TEXT|INTEGER|FLOAT|PATH|RANGE|x[<>]=|<=x)\b|\[\[")


def help_of(name: str) -> str:
    command = COMMANDS[name]
    context = type(command).context_class(command, info_name=f"eha-bench {name}")
    return str(command.get_help(context))


@pytest.mark.parametrize("name", COMMANDS)
def test_a_value_is_named_by_what_to_write_there(name: str) -> None:
    # a folder in a default ("reports/<suite>/<time>") is no type
    told = help_of(name).replace("/<suite>", "").replace("-ab", "").replace("/<time>", "")
    assert not TYPE_NAME.search(told)
    for parameter in COMMANDS[name].params:
        if not getattr(parameter, "is_flag", False):
            key = parameter.opts[0]
            word = WORDS_OF.get((name, key)) or WORDS[key]
            assert f"{key} {word}" in told if key.startswith("-") else f"  {word}" in told


def test_no_word_is_left_over() -> None:
    there = {
        (name, parameter.opts[0])
        for name, command in COMMANDS.items()
        for parameter in command.params
    }
    assert WORDS_OF.keys() <= there
    assert WORDS.keys() <= {key for _, key in there}


def test_every_command_has_a_line_that_is_not_cut_off(cli: Cli) -> None:
    told = cli("-h", check=0).stdout
    lines = told[told.index("Commands:") :].splitlines()[1:]
    assert [line.split()[0] for line in lines] == list(COMMANDS)
    assert not [line for line in lines if line.endswith("...")]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--draws", "x"), "'x' is given, and a whole number, 1 or more, is expected"),
        (("--draws=0",), "'0' is given, and a whole number, 1 or more, is expected"),
        (("--p-pass", "7"), "'7' is given, and a number from 0 to 1 is expected"),
    ],
)
def test_a_number_that_cannot_be_read_is_quoted(
    cli: Cli, words: tuple[str, ...], expected: str
) -> None:
    told = cli("run", "smoke", *words, check=2).stderr
    assert f"'{words[0].partition('=')[0]}': {expected}" in told


def test_ranges_are_words() -> None:
    assert "[0 to 1]" in help_of("run")
    assert "1 or more]" in " ".join(help_of("run").split())
    assert "Usage: eha-bench score [OPTIONS] LOG..." in help_of("score")
    assert "Usage: eha-bench init [OPTIONS] [DIR]" in help_of("init")


@pytest.mark.parametrize("name", [name for name in COMMANDS if "--workers" in help_of(name)])
def test_help_says_what_no_workers_mean(name: str) -> None:
    assert "(0: one a processor)" in " ".join(help_of(name).split())

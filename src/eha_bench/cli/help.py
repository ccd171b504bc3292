"""How commands show themselves in help and name a value that cannot be read.

typer names the type of a value (`<str>`, `<int range>`); a person asks what to write there.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import typer
from typer.core import TyperCommand

from eha_bench.cli.console import leave_interrupted

WORDS: Mapping[str, str] = {
    "--a": "TARGET",
    "--b": "TARGET",
    "--budget": "TIME",
    "--by": "NAME",
    "--candidates": "NUMBER",
    "--channels": "FILE",
    "--conditions": "FILE",
    "--config": "FILE",
    "--controller": "FILE",
    "--diagnose": "FILE",
    "--draws": "NUMBER",
    "--fault": "FAULT",
    "--fmi": "VERSION",
    "--for": "TIME",
    "--from": "FILE",
    "--host": "ADDRESS",
    "--listen": "ADDRESS",
    "--log": "FILE",
    "--max-memory": "SIZE",
    "--max-time": "TIME",
    "--model": "MODEL",
    "--out": "DIR",
    "--over": "FILE",
    "--p-pass": "PROBABILITY",
    "--plant": "PLANT",
    "--point": "NUMBER",
    "--port": "NUMBER",
    "--posterior": "FILE",
    "--priority": "NUMBER",
    "--probability": "PROBABILITY",
    "--repeats": "NUMBER",
    "--retries": "NUMBER",
    "--robust": "worst|cvar",
    "--rounds": "NUMBER",
    "--safety": "FILE",
    "--seed": "NUMBER",
    "--suite": "SUITE",
    "--target": "TARGET",
    "--time-limit": "TIME",
    "--token": "TOKEN",
    "--trial": "TRIAL",
    "--vary": "FILE",
    "--warm-up": "NUMBER",
    "--watchdog": "TIME",
    "--within": "PERCENT",
    "--workers": "WORKERS",
    "baseline": "BASELINE",
    "candidate": "CANDIDATE",
    "dataset": "DATASET",
    "diagnosis": "DIAGNOSIS",
    "file": "FILE",
    "files": "FILE",
    "folder": "DIR",
    "folders": "DIR",
    "kind": "KIND",
    "logs": "LOG",
    "model": "MODEL",
    "recording": "LOG",
    "recordings": "LOG",
    "results": "RESULT",
    "source": "LOG",
    "suite": "SUITE",
    "target": "TARGET",
}
"""What stands for the value of an option, or for an argument by its name, in every command."""

WORDS_OF: Mapping[tuple[str, str], str] = {
    ("before-after", "--out"): "FILE",
    ("channels", "--out"): "FILE",
    ("export", "target"): "FILE",
    ("export-fmu", "--out"): "FILE",
    ("layout", "--out"): "FILE",
    ("layout", "source"): "FILE",
    ("next", "--out"): "FILE",
    ("recover", "target"): "FILE",
}
"""... and in single commands."""

_RANGE = re.compile(r"(?:(-?[\d.]+)<=)?\bx(?:<=(-?[\d.]+)|>=(-?[\d.]+))")


class WordedCommand(TyperCommand):
    """A command whose help says in words what its options and arguments take."""

    def __init__(self, name: str | None, **options: Any) -> None:
        """Give every parameter its word."""
        super().__init__(name, **options)
        for parameter in self.params:
            if not getattr(parameter, "is_flag", False):
                key = parameter.opts[0]
                parameter.metavar = WORDS_OF.get((name or "", key)) or WORDS.get(key)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: ARG002 - typer's signature
        """Return what follows the command's name in its usage line."""
        return [self.options_metavar or "", *(_usage(one) for one in self._arguments())]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the tables of arguments and options."""
        arguments, options = [], []
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is None:
                continue
            text = _RANGE.sub(_range_in_words, record[1])
            if parameter.param_type_name == "argument":
                arguments.append((_argument_label(parameter), text))
            else:
                options.append((record[0], text))
        for title, rows in (("Arguments", arguments), ("Options", options)):
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Return what is left of a command line; say in words what a number must be.

        Raises:
            typer.BadParameter: a value cannot be read.
        """
        given = list(args)
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            wanted = _number_range(error.param)
            if wanted and error.message.startswith("Input should be"):
                error.message = f"{_value_as_written(error.param, given)}{wanted} is expected"
            raise

    def invoke(self, ctx: Any) -> Any:
        """Run the command; Ctrl-C is a sentence, where typer leaves without a word."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            leave_interrupted(error)

    def _arguments(self) -> list[Any]:
        return [one for one in self.params if one.param_type_name == "argument"]


def _argument_label(argument: Any) -> str:
    word = argument.metavar or argument.name
    return f"{word}..." if argument.nargs != 1 else word


def _usage(argument: Any) -> str:
    return _argument_label(argument) if argument.required else f"[{_argument_label(argument)}]"


def _range_in_words(found: re.Match[str]) -> str:
    low, high, least = found.groups()
    if least is not None:
        return f"{float(least):g} or more"
    if low is None:
        return f"{float(high):g} or less"
    return f"{float(low):g} to {float(high):g}"


def _number_range(parameter: Any) -> str:
    """Return what a number must be, or "" for what is no number."""
    kinds = {"int": "a whole number", "float": "a number"}
    kind = kinds.get(getattr(parameter, "bare_type", str)())
    low, high = getattr(parameter, "min", None), getattr(parameter, "max", None)
    if kind is None or (low is None and high is None):
        return kind or ""
    if high is None:
        return f"{kind}, {low:g} or more,"
    return f"{kind}, {high:g} or less," if low is None else f"{kind} from {low:g} to {high:g}"


def _value_as_written(parameter: Any, args: list[str]) -> str:
    """Return the value as it was written, or "" where it is not found again."""
    for place, word in enumerate(args):
        name, _, value = word.partition("=")
        if name in parameter.opts:
            value = value or "".join(args[place + 1 : place + 2])
            return f"'{value}' is given, and "
    return ""

"""`eha-bench list`: what there is to write into a file or to name on the command line."""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Callable, Iterator
from typing import Annotated, Final

import typer

from eha_bench.cli.console import say
from eha_bench.cli.terminal import Paint, columns, fitted_rows, paint, shows_colour

Row = tuple[str, str, str]
"""Name, a word about it (unit, kind), one sentence."""


def _or_broken(name: str, row: Callable[[str], Row]) -> Row:
    """Return the row of a plug-in, or that it is broken: it may hide none of the others."""
    from eha_bench.core.error_text import error_text
    from eha_bench.core.errors import EhaBenchError

    try:
        return row(name)
    except EhaBenchError as error:
        return name, "broken", str(error)
    except Exception as error:  # what was loaded is not of the kind that it is registered as
        return name, "broken", error_text(error)


def _suites() -> Iterator[Row]:
    from eha_bench.core.shipped import names
    from eha_bench.suites import load_suite

    def row(name: str) -> Row:
        suite = load_suite(name)
        return name, f"{len(suite.trials)} trials", _sentence(suite.description)

    yield from (_or_broken(name, row) for name in names("suites"))


def _metrics() -> Iterator[Row]:
    from eha_bench.core import plugins
    from eha_bench.core.metric import METRICS, metric_spec

    def row(name: str) -> Row:
        spec = metric_spec(name)
        unit = "of its channel" if spec.unit is None else spec.unit or "-"
        needs = f" (needs {spec.needs.value})" if spec.needs else ""
        return spec.id, unit, spec.description + needs

    names = (*METRICS, *(name for name in plugins.names("metrics") if name not in METRICS))
    yield from (_or_broken(name, row) for name in names)


def _effects() -> Iterator[Row]:
    from eha_bench.core import plugins

    def row(name: str) -> Row:
        effect = plugins.load("effects", name)
        return name, ", ".join(effect.actions), _sentence(effect.summary)

    yield from (_or_broken(name, row) for name in plugins.names("effects"))


def _plants() -> Iterator[Row]:
    from eha_bench.core import plugins
    from eha_bench.core.shipped import names, shipped_file
    from eha_bench.plants.registry import get_plant

    def shipped(name: str) -> Row:
        plant = get_plant(name)
        lines = shipped_file(f"plants/{name}.yaml").read_text(encoding="utf-8").splitlines()
        about = " ".join(line.lstrip("# ") for line in lines if line.startswith("#"))
        return name, ", ".join(plant.inputs), _sentence(about)

    def installed(name: str) -> Row:
        kind = plugins.load("plants", name)
        return name, ", ".join(kind.inputs), _sentence(kind.__doc__ or "")

    yield from (_or_broken(name, shipped) for name in names("plants"))
    yield from (_or_broken(name, installed) for name in plugins.names("plants"))


def _elements() -> Iterator[Row]:
    from eha_bench.core import plugins
    from eha_bench.plants.network.network import element_kind

    def row(name: str) -> Row:
        kind = element_kind(name)
        return name, ", ".join(port.name for port in kind.ports), _sentence(kind.summary)

    yield from (_or_broken(name, row) for name in plugins.names("elements"))


def _targets() -> Iterator[Row]:
    from eha_bench.core import plugins
    from eha_bench.core.shipped import names

    yield "simulator", "shipped", "the paper's model under its controllers, or the suite's own"
    for name in names("targets"):
        yield name, "shipped", f"the simulator with model and controllers '{name}'"
    kinds = {
        "can": "a drive on a CAN bus, by a DBC file",
        "fmu": "a plant of another tool, as an FMU",
        "simulator": "a model.yaml under a controller.yaml",
    }

    def row(name: str) -> Row:
        made_by = None if name in kinds else plugins.load("targets", name)
        what = kinds.get(name) or _sentence(getattr(made_by, "__doc__", "") or "from a plug-in")
        return f"target: {name}", "in a target.yaml", what

    yield from (_or_broken(name, row) for name in plugins.names("targets"))


def _signals() -> Iterator[Row]:
    from eha_bench.core import plugins

    def row(name: str) -> Row:
        signal = plugins.load("signals", name)
        keys = [field.alias or key for key, field in signal.model_fields.items() if key != "kind"]
        return name, ", ".join(keys) or "-", _sentence(signal.__doc__ or "")

    yield from (_or_broken(name, row) for name in plugins.names("signals"))


LISTS: Final[dict[str, Callable[[], Iterator[Row]]]] = {
    "suites": _suites,
    "metrics": _metrics,
    "effects": _effects,
    "plants": _plants,
    "elements": _elements,
    "targets": _targets,
    "signals": _signals,
}
"""What can be listed; a further kind is a line here."""

_HEADINGS: Final = {
    "suites": ("suite", "size"),
    "metrics": ("metric", "unit"),
    "effects": ("effect", "acts on"),
    "plants": ("plant", "inputs"),
    "elements": ("element", "joins"),
    "targets": ("target", "where"),
    "signals": ("signal", "keys"),
}


def complete_lists(incomplete: str) -> list[str]:
    """Return what can be listed."""
    return [name for name in LISTS if name.startswith(incomplete)]


def show(
    kind: Annotated[
        str,
        typer.Argument(help=", ".join(LISTS) + ".", autocompletion=complete_lists),
    ],
    json: Annotated[bool, typer.Option("--json", help="Print JSON on standard output.")] = False,
) -> None:
    """List what there is: suites, metrics, effects and more.

    Also plants, elements, targets and signals.
    """
    from eha_bench.core.errors import InputError
    from eha_bench.core.near_miss import suggest

    if kind not in LISTS:
        raise InputError(f"'{kind}' cannot be listed", hint=suggest(kind, LISTS))
    rows = list(LISTS[kind]())
    if json:
        import json as encoder

        about = _HEADINGS.get(kind, (kind, "about"))[1]
        found = [{"name": one, about: two, "description": text} for one, two, text in rows]
        typer.echo(encoder.dumps({"schema_version": 1, kind: found}, indent=1, ensure_ascii=False))
        return
    on = shows_colour()
    table = [(*_HEADINGS.get(kind, (kind, "about")), ""), *rows]
    wraps = shows_colour(sys.stdout)  # in a pipe each has one line, to be searched
    width = shutil.get_terminal_size().columns
    for number, cells in enumerate(fitted_rows(table, width) if wraps else columns(table)):
        line = "  ".join(cells).rstrip()
        typer.echo(paint(line, Paint.QUIET, on=on) if not number else line)
    if kind == "suites":
        say("run one: eha-bench run NAME")


def _sentence(text: str) -> str:
    """Return the first sentence of a text, on one line, without its full stop."""
    line = " ".join(text.split("\n\n", maxsplit=1)[0].split())
    # a full stop before a capital letter: not that of "Eq. (5)"
    return re.split(r"\.\s+(?=[A-Z`])", line)[0].rstrip(".")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("list")(show)

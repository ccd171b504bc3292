"""`eha-bench info`, `channels`, `export` and `recover`."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eha_bench.cli.console import say, write_out
from eha_bench.cli.reading_limits import MaxMemory, MaxTime, reading_limits

if TYPE_CHECKING:
    from eha_bench.recordings import RecordingInformation

Json = Annotated[bool, typer.Option("--json", help="Print JSON on standard output.")]


def info(
    recording: Annotated[Path, typer.Argument(help="Recording of any format.")],
    json: Json = False,
    max_memory: MaxMemory = None,
    max_time: MaxTime = None,
) -> None:
    """Say what a recording holds: topics, rates, gaps, health.

    Also types, ranges and metadata.
    """
    from eha_bench.recordings import info as describe

    with reading_limits(max_memory, max_time):
        found = describe(recording)
    if json:
        import json as encoder

        typer.echo(encoder.dumps(found.as_dict(), indent=1, ensure_ascii=False))
    else:
        _show(found)


def channels(
    recording: Annotated[Path, typer.Argument(help="Log of any format.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="File to write (default: standard output).")
    ] = None,
    max_memory: MaxMemory = None,
    max_time: MaxTime = None,
) -> None:
    """Write a first channels.yaml for a log.

    Channels and units are guessed, and marked as guessed.
    """
    from eha_bench.core.output_folder import spare_inputs
    from eha_bench.recordings.guessing import first_map

    if out is not None:
        spare_inputs((out,), (recording,), "name another file with --out")
    with reading_limits(max_memory, max_time):
        text = first_map(recording)
    if out is None:
        typer.echo(text, nl=False)
        return
    write_out(out, text)
    say("every line is a guess: check it before you score with it")
    typer.echo(str(out))


def export(
    recording: Annotated[Path, typer.Argument(help="Recording of any readable format.")],
    target: Annotated[Path, typer.Argument(help="File to write; ends in .csv, .parquet or .mf4.")],
    channels: Annotated[
        Path | None, typer.Option("--channels", help="channels.yaml of a foreign log.")
    ] = None,
    max_memory: MaxMemory = None,
    max_time: MaxTime = None,
) -> None:
    """Write a recording as CSV, Parquet or MDF 4.

    Time in s, channels in SI, bit for bit.
    """
    from eha_bench.core.output_folder import spare_inputs
    from eha_bench.recordings import export as write
    from eha_bench.recordings import read

    spare_inputs((target,), (recording, channels), "give another target")
    with reading_limits(max_memory, max_time):
        found = read(recording, channels=channels)
    for note in found.notes:
        say(note)
    write(target, found)
    if found.attachments:
        say(f"left out: its attachments ({', '.join(found.attachments)})")
    typer.echo(str(target))


def recover(
    source: Annotated[Path, typer.Argument(help="Torn MCAP file.")],
    target: Annotated[
        Path | None, typer.Argument(help="Clean file to write (default: SOURCE-recovered.mcap).")
    ] = None,
    json: Json = False,
    max_memory: MaxMemory = None,
    max_time: MaxTime = None,
) -> None:
    """Write what can be read of a torn MCAP file to a clean one."""
    from eha_bench.recordings import recover as mend

    clean = target or source.with_name(f"{source.stem}-recovered.mcap")
    with reading_limits(max_memory, max_time):
        report = mend(source, clean)
    for note in report.notes:
        say(note)
    total = sum(report.messages.values())
    say(f"{total} messages over {report.duration:.3f} s saved from {len(report.messages)} topics")
    if json:
        import json as encoder
        from dataclasses import asdict

        typer.echo(encoder.dumps(asdict(report), indent=1, ensure_ascii=False))
    else:
        typer.echo(str(clean))


_MOST_ROWS = 1000
"""Rows of a table that people are shown."""


def _show(found: RecordingInformation) -> None:
    """Print a table of topics and what else was found."""
    from datetime import UTC, datetime

    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    of_table = all(topic.rate != topic.rate and not topic.encoding for topic in found.topics)
    left = ("column", "type") if of_table else ("topic", "type", "encoding")
    right = ("rows",) if of_table else ("messages", "rate / Hz", "gaps", "longest / s")
    odd = [
        (title, key)
        for title, key in (("repeated", "duplicates"), ("steps back", "steps_back"))
        if any(getattr(topic, key) for topic in found.topics)
    ]
    for name in (*left, *right, *(title for title, _ in odd)):
        table.add_column(name, justify="left" if name in left else "right")
    for topic in found.topics[:_MOST_ROWS]:
        cells = [topic.name, topic.type] if of_table else [topic.name, topic.type, topic.encoding]
        cells.append(str(topic.count))
        if not of_table:
            cells.append(f"{topic.rate:.6g}" if topic.rate == topic.rate else "-")
            cells += [str(topic.gaps), f"{topic.longest_gap:.4g}" if topic.gaps else "-"]
        table.add_row(*map(_printable, cells), *(str(getattr(topic, key)) for _, key in odd))
    # into a pipe nothing is cut short
    width = None if sys.stdout.isatty() else 240
    console = Console(highlight=False, markup=False, soft_wrap=True, width=width)
    span = f", {found.duration:.3f} s" if found.duration == found.duration else ""
    console.print(f"{found.path}: {found.format}, {found.size} bytes{span}")
    if found.start_ns > 0:
        begin = datetime.fromtimestamp(found.start_ns / 1e9, UTC)
        console.print(f"begins {begin.isoformat(' ', 'milliseconds')}")
    console.print(table)
    if len(found.topics) > _MOST_ROWS:
        console.print(f"... and {len(found.topics) - _MOST_ROWS} more: --json lists all")
    _show_values(found)
    if found.channels:
        channels = ", ".join(f"{name} [{unit}]" for name, unit in found.channels.items())
        console.print(f"channels: {_printable(channels)}")
    for record, entries in found.metadata.items():
        for key, value in entries.items():
            console.print(_printable(f"{record}: {key} = {_short(value)}"))
    for name, size in found.attachments.items():
        console.print(_printable(f"attachment: {name}, {size} bytes"))
    for topic in [topic for topic in found.topics if topic.readable][:_MOST_ROWS]:
        console.print(_printable(f"not read: {topic.name}: {topic.readable}"))
    for note in found.notes:
        console.print(_printable(f"note: {note}"))
    console.print(f"health: {found.health}")


def _show_values(found: RecordingInformation) -> None:
    """Print the range of every number that was looked at."""
    from rich.console import Console
    from rich.table import Table

    rows = [(topic, value) for topic in found.topics for value in topic.values]
    if not rows:
        return
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("value", "unit"):
        table.add_column(name)
    for name in ("min", "max", "NaN / %", "resolution"):
        table.add_column(name, justify="right")
    for topic, value in rows[:_MOST_ROWS]:
        name = value.name if not topic.encoding or found.own else f"{topic.name} {value.name}"
        numbers = (value.minimum, value.maximum, 100 * value.nan_share, value.resolution)
        cells = ["-" if math.isnan(number) else f"{number:.6g}" for number in numbers]
        table.add_row(_printable(name), _printable(value.unit), *cells)
    width = None if sys.stdout.isatty() else 240
    console = Console(highlight=False, markup=False, soft_wrap=True, width=width)
    console.print(table)
    if len(rows) > _MOST_ROWS:
        console.print(f"... and {len(rows) - _MOST_ROWS} more: --json lists all")


def _short(value: str) -> str:
    """Return a value as it fits into a line; all of it is in the JSON."""
    line = value.partition("\n")[0][:160]
    return value if line == value else f"{line} ... ({len(value)} characters)"


def _printable(text: str) -> str:
    """Return text from a file without what would drive a terminal."""
    return "".join(c if c.isprintable() else "?" for c in text)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(info)
    app.command()(channels)
    app.command()(export)
    app.command()(recover)

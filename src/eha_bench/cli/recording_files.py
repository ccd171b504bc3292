"""`eha-bench info` and `eha-bench recover`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eha_bench.cli.console import say

if TYPE_CHECKING:
    from eha_bench.recordings import RecordingInformation

Json = Annotated[bool, typer.Option("--json", help="Print JSON on standard output.")]


def info(
    recording: Annotated[Path, typer.Argument(metavar="FILE", help="Recording of any format.")],
    json: Json = False,
) -> None:
    """Say what a recording holds: topics, types, rates, gaps, duration, metadata, health."""
    from eha_bench.recordings import info as describe

    found = describe(recording)
    if json:
        import json as encoder

        typer.echo(encoder.dumps(found.as_dict(), indent=1, ensure_ascii=False))
    else:
        _show(found)


def recover(
    source: Annotated[Path, typer.Argument(help="Torn MCAP file.")],
    target: Annotated[
        Path | None, typer.Argument(help="Clean file to write (default: SOURCE-recovered.mcap).")
    ] = None,
    json: Json = False,
) -> None:
    """Write all that can be read of a torn MCAP file to a clean, indexed one."""
    from eha_bench.recordings import recover as mend

    clean = target or source.with_name(f"{source.stem}-recovered.mcap")
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
    for topic in found.topics:
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
    if found.channels:
        channels = ", ".join(f"{name} [{unit}]" for name, unit in found.channels.items())
        console.print(f"channels: {_printable(channels)}")
    for record, entries in found.metadata.items():
        for key, value in entries.items():
            console.print(_printable(f"{record}: {key} = {_short(value)}"))
    for name, size in found.attachments.items():
        console.print(_printable(f"attachment: {name}, {size} bytes"))
    for topic in found.topics:
        if topic.readable:
            console.print(_printable(f"not read: {topic.name}: {topic.readable}"))
    for note in found.notes:
        console.print(_printable(f"note: {note}"))
    console.print(f"health: {found.health}")


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
    app.command()(recover)
